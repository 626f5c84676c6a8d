import dataclasses
import json
import logging

import numpy as np
import pytest

from langwm_data.scenes.catalogue import cache
from langwm_data.scenes.catalogue.cache import max_error_m, ready_mesh
from langwm_data.scenes.catalogue.catalogue import Catalogue
from langwm_data.scenes.meshes.store import read_mesh


@pytest.fixture
def model(write_catalogue):
    return Catalogue.open(write_catalogue({})).models[0]


def test_a_model_is_made_ready_once(model, tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    name, mesh = ready_mesh(model, folder)
    monkeypatch.setattr(cache, "load_mesh", None)
    again, stored = ready_mesh(model, folder)
    assert again == name
    assert (stored.vertices == mesh.vertices).all()
    assert (read_mesh(folder, name).triangles == mesh.triangles).all()


def test_another_size_and_another_file_are_made_anew(model, tmp_path, write_catalogue):
    name, _ = ready_mesh(model, tmp_path)
    larger = dataclasses.replace(model, size=(2.0, 2.0, 2.0))
    assert ready_mesh(larger, tmp_path)[0] != name
    other = Catalogue.open(write_catalogue({}, files={"step/step.mtl": "newmtl top\nKd 0 1 0\n"})).models[0]
    assert ready_mesh(other, tmp_path)[1].materials[0].color == (0.0, 1.0, 0.0)


def test_a_damaged_cache_is_noticed_and_made_again(model, tmp_path, caplog):
    name, mesh = ready_mesh(model, tmp_path)
    (tmp_path / f"{name}.npz").write_bytes(b"hello")
    with caplog.at_level(logging.WARNING):
        again, stored = ready_mesh(model, tmp_path)
    assert "its content does not match its name" in caplog.text
    assert again == name
    assert (read_mesh(tmp_path, name).vertices == mesh.vertices).all()
    assert (stored.vertices == mesh.vertices).all()


@pytest.mark.parametrize("note", ["hello", "{}", json.dumps({"mesh": "../../etc/passwd"})])
def test_a_damaged_note_is_noticed_and_made_again(model, tmp_path, caplog, note):
    name, _ = ready_mesh(model, tmp_path)
    (path,) = tmp_path.glob("*.json")
    path.write_text(note)
    with caplog.at_level(logging.WARNING):
        assert ready_mesh(model, tmp_path)[0] == name
    assert "made again, as the cache is damaged" in caplog.text


def test_heavy_meshes_are_thinned_and_light_ones_are_not(model, tmp_path, monkeypatch):
    light = ready_mesh(model, tmp_path)[1]
    asked = []
    monkeypatch.setattr(cache, "HEAVY_TRIANGLES", len(light.triangles))
    monkeypatch.setattr(cache, "decimate", lambda mesh, error: asked.append(error) or mesh)
    ready_mesh(model, tmp_path)
    assert asked == [pytest.approx(0.005)]


def test_small_things_have_a_smaller_error():
    assert max_error_m((2.0, 1.0, 1.0)) == 0.005
    assert max_error_m((0.03, 0.04, 0.0)) == pytest.approx(0.0005)
    assert np.isclose(max_error_m((0.3, 0.4, 0.0)), 0.005)
