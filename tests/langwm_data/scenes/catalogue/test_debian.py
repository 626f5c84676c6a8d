"""The catalogues of Debian's package sweethome3d-furniture, where they are installed."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from langwm_data.scenes.catalogue.cache import make_ready
from langwm_data.scenes.catalogue.catalogue import Catalogue
from langwm_data.scenes.catalogue.loading import load_mesh
from langwm_data.scenes.catalogue.split import split_models
from langwm_data.scenes.meshes.store import read_mesh

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
