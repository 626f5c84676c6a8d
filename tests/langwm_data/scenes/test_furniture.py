import numpy as np
import pytest

from langwm_data.scenes.furniture import build_model, model_names
from langwm_data.scenes.furniture.openings import DOOR_WIDTHS, WINDOW_SIZES
from langwm_data.scenes.geometry import Boxes
from langwm_data.scenes.spec import IDENTITY
from langwm_data.scenes.splits import MATERIAL_CATEGORIES
from langwm_data.scenes.taxonomy import CATEGORIES

ALL = [name for category in CATEGORIES for name in model_names(category)]
ORIGIN = (0.0, 0.0, 0.0)


def bounds(model):
    boxes = Boxes.of_parts((ORIGIN, IDENTITY, p) for p in model.parts).bounds
    return boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)


def test_a_name_always_means_the_same_parts():
    before = [build_model(n) for n in ALL]
    build_model.cache_clear()
    assert before == [build_model(n) for n in reversed(ALL)][::-1]


def test_variants_of_a_category_differ():
    for category in set(CATEGORIES) - {"door_frame"}:
        models = [build_model(n) for n in model_names(category)]
        assert len({m.parts for m in models}) > 1, category


@pytest.mark.parametrize("category", CATEGORIES)
def test_origin_is_the_middle_of_the_footprint_at_the_lowest_point(category):
    for name in model_names(category):
        model = build_model(name)
        low, high = bounds(model)
        w, d, h = model.size
        assert np.allclose(low, [-w / 2, -d / 2, 0], atol=2e-5)
        assert np.allclose(high, [w / 2, d / 2, h], atol=2e-5)


def test_sizes_are_those_of_real_furniture():
    limits = {  # height of the whole piece, metres
        "chair": (0.75, 1.05),
        "sofa": (0.7, 1.0),
        "bed": (0.6, 1.2),
        "dining_table": (0.7, 0.78),
        "coffee_table": (0.3, 0.5),
        "desk": (0.7, 0.78),
        "wardrobe": (1.8, 2.3),
        "fridge": (1.5, 2.0),
        "toilet": (0.6, 0.9),
        "bathtub": (0.5, 0.75),
        "cup": (0.07, 0.13),
        "door": (1.95, 2.05),
    }
    for category, (low, high) in limits.items():
        for name in model_names(category):
            assert low <= build_model(name).size[2] <= high, name


def test_every_piece_is_built_of_several_parts():
    single = [n for n in ALL if len(build_model(n).parts) == 1]
    assert {n.rsplit("_", 1)[0] for n in single} <= {"ball", "book", "rug"}


def test_slots_allow_known_materials_and_every_part_has_a_slot():
    for name in ALL:
        model = build_model(name)
        assert {p.slot for p in model.parts} == set(range(len(model.slots))), name
        assert all(set(s.categories) <= set(MATERIAL_CATEGORIES) and s.categories for s in model.slots)


def test_fixed_sizes_of_windows_and_doors_follow_their_number():
    for i, name in enumerate(model_names("window")):
        w, _, h = build_model(name).size
        assert (w, h) == pytest.approx(WINDOW_SIZES[i % len(WINDOW_SIZES)])
    for i, name in enumerate(model_names("door")):
        assert build_model(name).size[0] < DOOR_WIDTHS[i % len(DOOR_WIDTHS)]


def test_an_unknown_model_is_refused():
    for name in ("chair_99", "chair", "spaceship_01", "chair_1"):
        with pytest.raises(
            ValueError, match=rf"furniture model '{name}' is unknown; names look like 'chair_03'"
        ):
            build_model(name)
