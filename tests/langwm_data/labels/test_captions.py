import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from langwm_data.labels.captions import (
    DIRECTIONS,
    TEMPLATES,
    direction,
    format_distance,
    make_caption,
    sample_caption,
)
from langwm_data.scenes.taxonomy import CATEGORIES, phrase

WIDTHS = st.integers(16, 2048)


def say(template, rule=1, x=10.0, distance_m=3.2, noun="dining table"):
    return make_caption(
        noun, x, 160, distance_m, template=template, rule=rule, distance_format="integer"
    ).text


def test_left_is_left():
    assert direction(0.5, 160, 1) == "left"
    assert direction(159.5, 160, 1) == "right"
    assert direction(80, 160, 1) == direction(80, 160, 2) == "front"
    assert direction(0.5, 160, 2) == "outer left"
    assert direction(159.5, 160, 2) == "outer right"


@pytest.mark.parametrize(
    ("rule", "edges"),
    [
        (1, [(40, "left"), (120, "front")]),
        (2, [(32, "outer left"), (64, "left"), (96, "front"), (128, "right")]),
    ],
)
def test_a_centre_on_an_edge_belongs_to_its_left(rule, edges):
    names = DIRECTIONS[rule]
    for edge, name in edges:
        assert direction(edge, 160, rule) == name
        assert direction(np.nextafter(edge, 999), 160, rule) == names[names.index(name) + 1]


@given(width=WIDTHS, rule=st.sampled_from([1, 2]), data=st.data())
def test_directions_go_from_left_to_right(width, rule, data):
    xs = sorted(data.draw(st.lists(st.floats(0, width), min_size=2, max_size=8)))
    places = [DIRECTIONS[rule].index(direction(x, width, rule)) for x in xs]
    assert places == sorted(places)


@given(width=WIDTHS, fraction=st.floats(0.001, 0.999))
def test_mirrored_images_have_mirrored_directions(width, fraction):
    blocks = (fraction * 4, fraction * 5)
    if any(abs(b - round(b)) < 1e-6 for b in blocks):
        return
    for rule, names in DIRECTIONS.items():
        here = names.index(direction(fraction * width, width, rule))
        there = names.index(direction((1 - fraction) * width, width, rule))
        assert here + there == len(names) - 1


@given(width=WIDTHS, x=st.floats(0, 1))
def test_the_two_rules_never_contradict_each_other(width, x):
    sides = {direction(x * width, width, rule).split()[-1] for rule in DIRECTIONS}
    assert sides != {"left", "right"}


def test_the_seven_templates_of_the_appendix():
    assert [say(n) for n in range(1, 8)] == [
        "There is dining table in the left 3 meters.",
        "A dining table is situated in the 3 meters of the left.",
        "The dining table is approximately 3 meters, left from here.",
        "The dining table is approximately 3 meters, to the left.",
        "In the left, dining table is 3 meters to me.",
        "In the image, I can see dining table, and it is 3 meters left.",
        "If you look 3 meters in the left, you will see dining table.",
    ]
    assert all(re.findall(r"{(\w+)}", t).count("object") == 1 for t in TEMPLATES)


@pytest.mark.parametrize(
    ("distance_m", "text"),
    [
        (0.2, "half a meter"),
        (0.49, "half a meter"),
        (0.5, "1 meter"),
        (1.49, "1 meter"),
        (2.5, "3 meters"),
        (9.6, "10 meters"),
    ],
)
def test_distance_in_whole_meters(distance_m, text):
    assert format_distance(distance_m, "integer") == text


@pytest.mark.parametrize(
    ("distance_m", "text"), [(0.01, "0.1 meters"), (1.04, "1.0 meters"), (3.26, "3.3 meters")]
)
def test_distance_with_one_decimal(distance_m, text):
    assert format_distance(distance_m, "decimal") == text


@given(distance_m=st.floats(0.01, 10))
def test_said_distance_is_within_half_a_meter(distance_m):
    said = format_distance(distance_m, "integer")
    assert abs((0.5 if said == "half a meter" else float(said.split()[0])) - distance_m) <= 0.5


@given(
    seed=st.integers(0, 10**6),
    category=st.sampled_from(sorted(CATEGORIES)),
    x=st.floats(0, 160),
    d=st.floats(0.1, 10),
)
def test_a_caption_says_what_it_was_filled_from(seed, category, x, d):
    noun = phrase(category)
    caption = sample_caption(np.random.default_rng(seed), noun, x, 160, d, distance_format="integer")
    again = make_caption(
        noun, x, 160, d, template=caption.template, rule=caption.rule, distance_format="integer"
    )
    assert caption == again
    assert noun in caption.text
    assert caption.direction in caption.text
    assert caption.distance in caption.text
    assert "{" not in caption.text


def test_all_templates_and_rules_are_drawn_about_equally():
    rng = np.random.default_rng(0)
    drawn = [sample_caption(rng, "chair", 5, 160, 2, distance_format="integer") for _ in range(1400)]
    counts = np.bincount([c.template * 2 + c.rule - 3 for c in drawn], minlength=14)
    assert len(counts) == 14
    assert counts.min() > 60
    assert counts.max() < 140
