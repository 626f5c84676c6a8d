import dataclasses
import json
import logging
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import cv2
import numpy as np
import pytest

from langwm_data.scenes.catalogue import cache
from langwm_data.scenes.catalogue.cache import make_ready, max_error_m
from langwm_data.scenes.catalogue.catalogue import Catalogue
from langwm_data.scenes.meshes.store import read_mesh


@pytest.fixture
def model(write_catalogue):
    return Catalogue.open(write_catalogue({})).models[0]


def test_a_model_is_made_ready_once(model, tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    ready = make_ready(model, folder)
    monkeypatch.setattr(cache, "load_mesh", None)
    assert make_ready(model, folder) == ready
    mesh = read_mesh(folder, ready.mesh)
    assert (len(mesh.triangles), len(mesh.sizes)) == (ready.num_triangles, ready.num_groups)


def test_processes_may_make_the_same_model_at_once(model, tmp_path):
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=2, mp_context=context) as pool:
        first, second = pool.map(make_ready, [model] * 2, [tmp_path / "cache"] * 2)
    assert first == second == make_ready(model, tmp_path / "cache")
    assert len(list((tmp_path / "cache").iterdir())) == 2


def test_another_size_and_another_file_are_made_anew(model, tmp_path, write_catalogue):
    name = make_ready(model, tmp_path).mesh
    larger = dataclasses.replace(model, size=(2.0, 2.0, 2.0))
    assert make_ready(larger, tmp_path).mesh != name
    other = Catalogue.open(write_catalogue({}, files={"step/step.mtl": "newmtl top\nKd 0 1 0\n"})).models[0]
    mesh = read_mesh(tmp_path, make_ready(other, tmp_path).mesh)
    assert mesh.materials[0].color == (0.0, 1.0, 0.0)


def test_a_damaged_cache_is_noticed_and_made_again(model, tmp_path, caplog):
    ready = make_ready(model, tmp_path)
    mesh = read_mesh(tmp_path, ready.mesh)
    (tmp_path / f"{ready.mesh}.npz").write_bytes(b"hello")
    with caplog.at_level(logging.WARNING):
        assert make_ready(model, tmp_path) == ready
    assert "its content does not match its name" in caplog.text
    assert (read_mesh(tmp_path, ready.mesh).vertices == mesh.vertices).all()


@pytest.mark.parametrize("note", ["hello", "{}", json.dumps({"mesh": "../../etc/passwd"})])
def test_a_damaged_note_is_noticed_and_made_again(model, tmp_path, caplog, note):
    ready = make_ready(model, tmp_path)
    (path,) = tmp_path.glob("*.json")
    path.write_text(note)
    with caplog.at_level(logging.WARNING):
        assert make_ready(model, tmp_path) == ready
    assert "made again, as the cache is damaged" in caplog.text


def test_heavy_meshes_are_thinned_and_light_ones_are_not(model, tmp_path, monkeypatch):
    num = make_ready(model, tmp_path).num_triangles
    asked = []
    monkeypatch.setattr(cache, "HEAVY_TRIANGLES", num)
    monkeypatch.setattr(cache, "decimate", lambda mesh, error: asked.append(error) or mesh)
    make_ready(model, tmp_path)
    assert asked == [pytest.approx(0.005)]


def test_meshes_that_stay_heavy_are_thinned_with_a_larger_error(model, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(cache, "HEAVY_TRIANGLES", 1)
    monkeypatch.setattr(cache, "ENOUGH_TRIANGLES", 1)
    monkeypatch.setattr(cache, "decimate", lambda mesh, error: asked.append(error) or mesh)
    make_ready(model, tmp_path)
    assert asked == [pytest.approx(0.005), pytest.approx(0.01), pytest.approx(0.02)]


def test_what_homes_need_to_know_is_kept_beside_the_mesh(model, tmp_path):
    ready = make_ready(model, tmp_path)
    # Its back is level and 0.5 m high; from there its front slopes down to half of that.
    assert ready.top == pytest.approx((0.5, -0.5, -0.75, 0.5, -0.25), abs=0.05)
    volume = sum(np.prod(np.subtract(high, low)) for low, high in ready.solids)
    assert 0.625 <= volume < 1.15 * 0.625
    assert max(high[2] for low, high in ready.solids if low[1] > 0.5) < 0.4
    assert ready.cut_out_share == 0.0


def test_the_share_of_a_surface_that_is_cut_out_is_measured(tmp_path, write_catalogue):
    half_clear = np.zeros((2, 2, 4), np.uint8)
    half_clear[0, :, 3] = 255
    files = {
        "step/step.mtl": "newmtl top\nmap_Kd stripes.png\nnewmtl rest\nmap_Kd stripes.png\n",
        "step/stripes.png": cv2.imencode(".png", half_clear)[1].tobytes(),
    }
    # Only the top has texture coordinates; all the rest lies at (0, 0), which is clear.
    model = Catalogue.open(write_catalogue({}, files=files)).models[0]
    assert 0.85 < make_ready(model, tmp_path).cut_out_share < 1.0


def test_small_things_have_a_smaller_error():
    assert max_error_m((2.0, 1.0, 1.0)) == 0.005
    assert max_error_m((0.03, 0.04, 0.0)) == pytest.approx(0.0005)
    assert np.isclose(max_error_m((0.3, 0.4, 0.0)), 0.005)
