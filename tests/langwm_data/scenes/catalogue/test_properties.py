import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from langwm_data.scenes.catalogue import properties
from langwm_data.scenes.catalogue.properties import parse_properties


def parse(text):
    return parse_properties(text.encode("latin-1"), "x.properties")


def test_the_examples_of_the_java_documentation():
    # java.util.Properties.load, Java SE 8: three spellings of one pair, a continued list, an empty value.
    assert parse("Truth = Beauty\n") == parse(" Truth:Beauty") == parse("Truth                    :Beauty")
    fruits = "fruits                           apple, banana, pear, \\\n"
    fruits += "                                 cantaloupe, watermelon, \\\n"
    fruits += "                                 kiwi, mango"
    assert parse(fruits) == {"fruits": "apple, banana, pear, cantaloupe, watermelon, kiwi, mango"}
    assert parse("cheeses\n") == {"cheeses": ""}
    assert parse("\\:\\=\n") == {":=": ""}


@pytest.mark.parametrize(
    ("text", "pairs"),
    [
        ("# comment\n! another\n\n   \nname#1=Chair\n", {"name#1": "Chair"}),
        ("a=1\r\nb=2\rc=3", {"a": "1", "b": "2", "c": "3"}),
        ("name=Bill 10\\u20ac", {"name": "Bill 10€"}),
        ("name=\xa9 2003", {"name": "© 2003"}),
        ("a=b\\\\\nc=d", {"a": "b\\", "c": "d"}),
        ("path=C\\:\\\\x\\ty", {"path": "C:\\x\ty"}),
        ("a\\ b = c", {"a b": "c"}),
        ("a=1\na=2", {"a": "2"}),
        ("a==b", {"a": "=b"}),
        ("a=1\\\n# no comment", {"a": "1# no comment"}),
        ("a=end\\", {"a": "end"}),
        ("a=\\uD83D\\uDE00", {"a": "\N{GRINNING FACE}"}),
    ],
)
def test_lines_comments_continuations_and_escapes(text, pairs):
    assert parse(text) == pairs


@given(st.dictionaries(st.text(min_size=1), st.text()))
def test_what_is_escaped_as_java_stores_it_comes_back(pairs):
    plain = set(string.ascii_letters + string.digits)

    def escape(text):
        units = text.encode("utf-16-be", "surrogatepass")
        codes = [int.from_bytes(units[i : i + 2], "big") for i in range(0, len(units), 2)]
        return "".join(chr(c) if chr(c) in plain else f"\\u{c:04x}" for c in codes)

    text = "".join(f"{escape(key)}={escape(value)}\n" for key, value in pairs.items())
    assert parse(text) == pairs


def test_a_broken_escape_and_a_huge_file_are_refused(monkeypatch):
    with pytest.raises(ValueError, match=r"x.properties: escape '\\\\u12' is not \\u and four hexadecimal"):
        parse("a=\\u12")
    monkeypatch.setattr(properties, "MAX_BYTES", 3)
    with pytest.raises(ValueError, match=r"x.properties: 4 bytes of properties; at most 3 are read"):
        parse("a=12")
