"""Boxes hide what they should and no more than they may; captions tell the truth about them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.labels.captions import direction, format_distance
from langwm_data.scenes.taxonomy import phrase
from pretrain.config import ObjectMaskConfig
from pretrain.frames import FrameObject
from pretrain.object_masking import box_with_margin, hide_objects

SIZE = (64, 80)


@st.composite
def objects_in_frame(draw):
    found = []
    for category in draw(st.lists(st.sampled_from(["chair", "sofa", "dining_table", "bed"]), max_size=6)):
        x1, y1 = draw(st.integers(0, 70)), draw(st.integers(0, 55))
        x2, y2 = draw(st.integers(x1 + 1, 80)), draw(st.integers(y1 + 1, 64))
        distance_m = draw(st.floats(0.3, 10))
        box = (float(x1), float(y1), float(x2), float(y2))
        found.append(
            FrameObject(category=category, bbox_xyxy=box, center_x=(x1 + x2) / 2, distance_m=distance_m)
        )
    return found


def rng(seed=0):
    return np.random.default_rng(seed)


@given(objects=objects_in_frame(), seed=st.integers(0, 2**32), max_objects=st.integers(1, 4))
@settings(max_examples=80, deadline=None)
def test_boxes_cover_their_objects_and_stay_near_them(objects, seed, max_objects):
    config = ObjectMaskConfig(max_objects=max_objects)
    hidden = hide_objects(rng(seed), objects, SIZE, config)
    assert len(hidden.objects) <= max_objects
    assert bool(objects) == bool(hidden.objects)
    allowed = np.zeros(SIZE, bool)
    for o in hidden.objects:
        x1, y1, x2, y2 = map(int, o.bbox_xyxy)
        assert hidden.is_hidden[y1:y2, x1:x2].all()
        allowed[max(y1 - 10, 0) : y2 + 10, max(x1 - 10, 0) : x2 + 10] = True
    assert not hidden.is_hidden[~allowed].any()


@given(objects=objects_in_frame(), seed=st.integers(0, 2**32))
@settings(max_examples=80, deadline=None)
def test_no_further_object_once_the_area_is_reached(objects, seed):
    config = ObjectMaskConfig(max_objects=6, max_area=0.4, margin_px=0)
    hidden = hide_objects(rng(seed), objects, SIZE, config)
    before_last = np.zeros(SIZE, bool)
    for o in hidden.objects[:-1]:
        x1, y1, x2, y2 = map(int, o.bbox_xyxy)
        before_last[y1:y2, x1:x2] = True
    assert before_last.mean() < 0.4
    if hidden.is_hidden.mean() < 0.4:
        assert len(hidden.objects) == len(objects)


@given(objects=objects_in_frame(), seed=st.integers(0, 2**32))
@settings(max_examples=80, deadline=None)
def test_caption_has_one_true_sentence_for_each_hidden_object(objects, seed):
    hidden = hide_objects(rng(seed), objects, SIZE, ObjectMaskConfig())
    sentences = [s for s in hidden.caption.split(".") if s]
    assert len(sentences) == len(hidden.objects)
    for o in hidden.objects:
        facts = {
            (phrase(o.category), direction(o.center_x, 80, rule), format_distance(o.distance_m, "integer"))
            for rule in (1, 2)
        }
        assert any(all(fact in s for fact in facts_) for s in sentences for facts_ in facts)


def test_margins_are_drawn_for_each_side_from_zero_to_ten():
    shown = FrameObject(category="bed", bbox_xyxy=(30.0, 20.0, 40.0, 30.0), center_x=35.0, distance_m=2.0)
    boxes = np.array([box_with_margin(rng(seed), shown, SIZE, 10) for seed in range(400)])
    grown = np.abs(boxes - [30, 20, 40, 30])
    assert grown.min() == 0
    assert grown.max() == 10
    assert np.abs(np.corrcoef(grown.T) - np.eye(4)).max() < 0.2
    np.testing.assert_allclose(grown.mean(axis=0), 5, atol=0.6)


def test_fractional_boxes_are_covered_whole():
    shown = FrameObject(category="bed", bbox_xyxy=(3.4, 2.2, 5.1, 6.7), center_x=4.0, distance_m=2.0)
    assert box_with_margin(rng(), shown, SIZE, 0) == (3, 2, 6, 7)


def test_dropout_of_captions_and_of_boxes():
    shown = [FrameObject(category="bed", bbox_xyxy=(3.0, 2.0, 9.0, 9.0), center_x=6.0, distance_m=2.0)]
    silent = hide_objects(rng(), shown, SIZE, ObjectMaskConfig(caption_dropout=1.0))
    assert silent.caption == ""
    assert silent.is_hidden.any()
    bare = hide_objects(rng(), shown, SIZE, ObjectMaskConfig(box_dropout=1.0))
    assert bare.caption == ""
    assert not bare.is_hidden.any()
    share = np.mean(
        [
            hide_objects(rng(s), shown, SIZE, ObjectMaskConfig(caption_dropout=0.3)).caption == ""
            for s in range(600)
        ]
    )
    assert share == pytest.approx(0.3, abs=0.06)


def test_every_object_is_chosen_equally_often():
    shown = [
        FrameObject(category="bed", bbox_xyxy=(x, 2.0, x + 6, 9.0), center_x=x + 3, distance_m=2.0)
        for x in (0.0, 20.0, 40.0, 60.0)
    ]
    counts = np.zeros(4)
    for seed in range(400):
        for o in hide_objects(rng(seed), shown, SIZE, ObjectMaskConfig(max_objects=2)).objects:
            counts[shown.index(o)] += 1
    np.testing.assert_allclose(counts / 400, 0.5, atol=0.1)
