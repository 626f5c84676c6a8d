"""Captions read back give what they were filled from, and nothing else is read."""

import itertools

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from langwm_data.labels.captions import DIRECTIONS, TEMPLATES, make_caption
from langwm_data.labels.parse import parse_caption, said_metres
from langwm_data.scenes.taxonomy import CATEGORIES, STRUCTURE

NAMES = (*STRUCTURE, *CATEGORIES)
CAPTIONS = st.builds(
    make_caption,
    st.sampled_from([name.replace("_", " ") for name in NAMES]),
    st.floats(0, 160),
    st.just(160),
    st.floats(0.001, 9000),
    template=st.integers(1, len(TEMPLATES)),
    rule=st.sampled_from(list(DIRECTIONS)),
    distance_format=st.sampled_from(["integer", "decimal"]),
)


@given(
    category=st.sampled_from(NAMES),
    x=st.floats(0, 160),
    distance_m=st.floats(0.001, 9000),
    template=st.integers(1, len(TEMPLATES)),
    rule=st.sampled_from(list(DIRECTIONS)),
    fmt=st.sampled_from(["integer", "decimal"]),
)
def test_parsing_inverts_every_template_direction_and_distance(category, x, distance_m, template, rule, fmt):
    made = make_caption(
        category.replace("_", " "), x, 160, distance_m, template=template, rule=rule, distance_format=fmt
    )
    parsed = parse_caption(made.text)
    assert (parsed.phrase, parsed.template) == (category.replace("_", " "), template)
    assert (parsed.direction, parsed.distance) == (made.direction, made.distance)
    assert rule in parsed.rules
    assert abs(said_metres(parsed.distance) - distance_m) <= (0.5 if fmt == "integer" else 0.1) + 1e-9


@pytest.mark.parametrize("template", range(1, len(TEMPLATES) + 1))
def test_every_category_in_every_direction_is_read(template):
    words = TEMPLATES[template - 1]
    for category, name in itertools.product(NAMES, DIRECTIONS[2]):
        noun = category.replace("_", " ")
        parsed = parse_caption(words.format(object=noun, direction=name, distance="3 meters"))
        assert (parsed.phrase, parsed.template, parsed.direction) == (noun, template, name)


@given(caption=CAPTIONS, data=st.data())
def test_a_caption_with_one_character_changed_never_says_the_same(caption, data):
    place = data.draw(st.integers(0, len(caption.text) - 1))
    other = data.draw(st.characters(codec="utf-8"))
    assume(other != caption.text[place])
    changed = caption.text[:place] + other + caption.text[place + 1 :]
    try:
        parsed = parse_caption(changed)
    except ValueError:
        return
    assert parsed != parse_caption(caption.text)


@pytest.mark.parametrize(
    ("text", "slots"),
    [
        ("There is dining table in the left 3 meters.", ("dining table", "left", "3 meters")),
        ("A tv stand is situated in the 1 meter of the outer left.", ("tv stand", "outer left", "1 meter")),
        ("The bed is approximately half a meter, front from here.", ("bed", "front", "half a meter")),
        ("The bed is approximately 2.0 meters, to the right.", ("bed", "right", "2.0 meters")),
        ("In the front, door is 10 meters to me.", ("door", "front", "10 meters")),
        ("In the image, I can see tv, and it is 0.1 meters left.", ("tv", "left", "0.1 meters")),
        ("If you look 4 meters in the right, you will see rug.", ("rug", "right", "4 meters")),
    ],
)
def test_sentences_in_the_order_of_the_appendix(text, slots):
    parsed = parse_caption(text)
    assert (parsed.phrase, parsed.direction, parsed.distance) == slots
    assert parsed.rules == ((2,) if "outer" in slots[1] else (1, 2))


def test_each_template_is_told_from_the_others():
    texts = [words.format(object="bed", direction="front", distance="3 meters") for words in TEMPLATES]
    assert [parse_caption(text).template for text in texts] == list(range(1, 8))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "There is dining table in the left 3 meters",
        "There is dining table in the left 3 meters.\n",
        " There is dining table in the left 3 meters.",
        "there is dining table in the left 3 meters.",
        "There is dining_table in the left 3 meters.",
        "There is Unicorn in the left 3 meters.",
        "There is chair in the behind 3 meters.",
        "There is chair in the left 0 meters.",
        "There is chair in the left 1 meters.",
        "There is chair in the left 0.0 meters.",
        "There is chair in the left 03 meters.",
        "There is chair in the left ٣ meters.",
        "There is chair in the left -3 meters.",
        "There is chair in the left 3 meters. " * 10000,
    ],
)
def test_what_no_template_says_is_refused(text):
    with pytest.raises(ValueError, match=r"^caption '.{0,210}' follows none of the 7 templates$"):
        parse_caption(text)


@pytest.mark.parametrize("text", ["3", "3 m", "0 meters", "half a metre", "3 meters "])
def test_a_distance_in_other_words_is_refused(text):
    with pytest.raises(ValueError, match=r"is not of the form '3 meters' or '3\.2 meters'"):
        said_metres(text)
