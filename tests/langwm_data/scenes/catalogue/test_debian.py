"""The catalogues of Debian's package sweethome3d-furniture, where they are installed."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from langwm_data.scenes.catalogue import limits, offer
from langwm_data.scenes.catalogue.cache import make_ready
from langwm_data.scenes.catalogue.catalogue import Catalogue
from langwm_data.scenes.catalogue.loading import load_mesh
from langwm_data.scenes.catalogue.split import split_models
from langwm_data.scenes.homes import make_home
from langwm_data.scenes.meshes.store import read_mesh
from langwm_data.sim.settle import settle

FOLDER = Path("/usr/share/sweethome3d")

pytestmark = pytest.mark.skipif(
    not list(FOLDER.rglob("*.sh3f")), reason="Debian's sweethome3d-furniture is not installed"
)


@pytest.fixture(scope="module")
def catalogue():
    return Catalogue.open(FOLDER)


def test_most_kinds_of_furniture_are_known(catalogue):
    known = catalogue.known()
    assert len(catalogue.models) >= 800
    assert len(known) >= 300
    counts = Counter(model.kind.category for model in known)
    assert {"chair", "sofa", "bed", "desk", "dining_table", "wardrobe", "fridge", "toilet"} <= set(counts)
    assert all(model.author and model.licence not in ("", "not stated") for model in known)


def test_every_category_with_two_models_has_both_splits(catalogue):
    splits = split_models(catalogue.models)
    by_category = {}
    for model in catalogue.known():
        by_category.setdefault(model.kind.category, []).append(splits[model.id])
    assert all(set(s) == {"train", "test"} for s in by_category.values() if len(s) > 1)


@pytest.mark.parametrize(
    "name", ["Scopia#bed1", "Blend Swap CC-BY#simpleDesk", "Kator Legaz#dining-chair", "Scopia#saloon_table"]
)
def test_models_have_their_stated_size(catalogue, tmp_path, name):
    model = next(m for m in catalogue.models if m.id == name)
    mesh = read_mesh(tmp_path, make_ready(model, tmp_path).mesh)
    extent = np.ptp(mesh.vertices, axis=0)
    assert extent == pytest.approx(model.size, abs=0.01)


def test_beds_and_sofas_are_highest_at_their_back(catalogue):
    for name in (
        "Scopia#bed1",
        "Scopia#leather_sofa",
        "Blend Swap CC-0#bed1",
        "Kator Legaz#mid-century-sofa",
    ):
        model = next(m for m in catalogue.models if m.id == name)
        vertices = load_mesh(model).vertices
        depth = model.size[1]
        back, front = vertices[:, 1] < -depth / 4, vertices[:, 1] > depth / 4
        assert vertices[back, 2].max() > vertices[front, 2].max() + 0.05, name


def boxes_of(catalogue, cache, name):
    model = next(m for m in catalogue.models if m.id == name)
    return make_ready(model, cache)


def are_filled(ready, points):
    low, high = np.moveaxis(np.array(ready.solids), 1, 0)
    points = np.array(points)[:, None]
    return ((points >= low) & (points <= high)).all(axis=2).any(axis=1)


def test_a_robot_passes_between_the_legs_of_a_table(catalogue, tmp_path):
    ready = boxes_of(catalogue, tmp_path, "Scopia#table4")
    xs, ys = np.meshgrid(np.linspace(-0.3, 0.3, 13), np.linspace(-0.17, 0.17, 8))
    for z in (0.05, 0.45):
        assert not are_filled(ready, np.column_stack([xs.ravel(), ys.ravel(), np.full(xs.size, z)])).any()
    assert are_filled(ready, [[0.0, 0.0, 0.74], [0.66, 0.41, 0.3], [-0.66, -0.41, 0.3]]).all()


@pytest.mark.parametrize(
    "name", ["Scopia#kids_desk_table", "Blend Swap CC-BY#tvStand", "Blend Swap CC-0#bedsideTable2"]
)
def test_what_is_put_on_a_model_rests_on_its_visible_top(catalogue, tmp_path, name):
    ready = boxes_of(catalogue, tmp_path, name)
    height, x0, y0, x1, y1 = ready.top
    xs, ys = np.meshgrid(np.linspace(x0 + 0.02, x1 - 0.02, 20), np.linspace(y0 + 0.02, y1 - 0.02, 20))
    level = np.column_stack([xs.ravel(), ys.ravel(), np.full(xs.size, height)])
    assert are_filled(ready, level - np.array([0, 0, 0.006])).all()
    assert not are_filled(ready, level + np.array([0, 0, 0.006])).any()


@pytest.mark.parametrize("name", ["Cedar_0", "Maple_0"])
def test_homes_with_real_tables_chairs_and_sofas_are_sound(tmp_path, monkeypatch, name):
    kinds = ("chair", "dining_table", "sofa")
    monkeypatch.setattr(limits, "SIZES_M", {kind: limits.SIZES_M[kind] for kind in kinds})
    monkeypatch.setattr(offer, "NUM_MODELS", 1)
    furniture = offer.Furniture(FOLDER, tmp_path)
    scene = settle(make_home(name, seed=0, furniture=furniture))
    shown = [o for o in scene.objects if o.mesh is not None]
    assert {o.category for o in shown} == set(kinds)
    assert {record.split for record in scene.models} == {scene.split}
    tables = [o for o in shown if o.category == "dining_table"]
    reach = [np.linalg.norm(np.subtract(c.position, t.position)[:2]) for c in shown for t in tables if c != t]
    assert sum(distance < 1.5 for distance in reach) >= 3
