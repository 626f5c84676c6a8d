"""Captions of the probe: the truth is true, and each contradiction is about one slot and large enough."""

import re

import numpy as np
import pytest

from langwm_data.labels.captions import DIRECTIONS, format_distance
from pretrain.frames import FrameObject
from pretrain.probing.claims import (
    CAPTIONS,
    CATEGORY,
    DIRECTION,
    DISTANCE,
    EMPTY,
    OTHER,
    RIGHT,
    contradict_distance,
    make_claims,
)

WIDTH = 160
NOUNS = {"chair": "chair", "dining_table": "dining table", "bed": "bed"}


def an_object(category="chair", center_x=20.0, distance_m=2.2):
    box = (center_x - 5, 10.0, center_x + 5, 30.0)
    return FrameObject(category=category, bbox_xyxy=box, center_x=center_x, distance_m=distance_m)


DONORS = [an_object("dining_table", 120.0, 6.0), an_object("bed", 80.0, 2.5), an_object("chair", 10.0, 9.0)]


def claims_of(shown, seed=0, donors=DONORS):
    return make_claims(np.random.default_rng(seed), shown, donors, WIDTH, "integer")


def said_m(text):
    found = re.search(r"(\d+|half a) meters?", text).group(1)
    return 0.5 if found == "half a" else float(found)


def said_direction(text):
    return max((d for rule in DIRECTIONS.values() for d in rule if d in text), key=len)


def said_noun(text):
    (noun,) = [n for n in NOUNS.values() if n in text]
    return noun


def slots(text):
    return {DISTANCE: said_m(text), DIRECTION: said_direction(text), CATEGORY: said_noun(text)}


@pytest.mark.parametrize("seed", range(20))
def test_a_contradiction_changes_its_slot_and_no_other(seed):
    shown = an_object(center_x=20.0, distance_m=1.0 + seed / 3)
    claims = claims_of(shown, seed)
    assert set(claims) == set(CAPTIONS)
    right = slots(claims[RIGHT].text)
    assert right[CATEGORY] == "chair"
    assert format_distance(shown.distance_m, "integer") in claims[RIGHT].text
    for name in (DISTANCE, DIRECTION, CATEGORY):
        told = slots(claims[name].text)
        assert [slot for slot in told if told[slot] != right[slot]] == [name]
    assert claims[EMPTY].text == ""


@pytest.mark.parametrize("distance_m", np.linspace(0.2, 10, 99))
def test_distances_are_contradicted_by_two_metres_or_more(distance_m):
    claims = claims_of(an_object(distance_m=distance_m))
    assert abs(said_m(claims[DISTANCE].text) - said_m(claims[RIGHT].text)) >= 2
    assert (contradict_distance(distance_m) > distance_m) == (distance_m < 3)


def test_left_is_told_for_right():
    texts = [claims_of(an_object(center_x=20.0), seed)[DIRECTION].text for seed in range(10)]
    assert all("right" in text and "left" not in text for text in texts)


def test_what_lies_in_front_has_no_contradicted_direction():
    assert all(DIRECTION not in claims_of(an_object(center_x=81.0), seed) for seed in range(10))


def test_another_object_is_of_another_category_and_distance():
    for seed in range(20):
        claim = claims_of(an_object(distance_m=2.2), seed)[OTHER]
        assert "dining table" in claim.text  # the bed is as near as the chair, the other chair a chair
        assert claim.distance_m == 6.0


def test_without_other_objects_there_is_nothing_to_be_mistaken_for():
    claims = claims_of(an_object(), donors=[an_object(distance_m=9.0)])
    assert set(claims) == {RIGHT, EMPTY, DISTANCE, DIRECTION}


def test_names_that_differ_for_one_noun_are_no_contradiction():
    twin = FrameObject(
        category="seat", phrase="chair", bbox_xyxy=(0.0, 0.0, 5.0, 5.0), center_x=2.0, distance_m=9.0
    )
    assert CATEGORY not in claims_of(an_object(), donors=[twin])
