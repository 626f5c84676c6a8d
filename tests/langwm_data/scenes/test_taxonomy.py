import pytest

from langwm_data.scenes.taxonomy import (
    CATEGORIES,
    FOREIGN_CATEGORIES,
    STRUCTURE,
    UNKNOWN,
    is_nameable,
    is_structure,
    phrase,
)


def test_there_are_at_least_twenty_five_categories_named_in_snake_case():
    assert len(CATEGORIES) >= 25
    assert all(name.replace("_", "").isalpha() and name == name.lower() for name in CATEGORIES)


def test_phrases_are_words_not_identifiers():
    assert phrase("dining_table") == "dining table"
    assert phrase("wall") == "wall"
    assert not any("_" in c.phrase for c in CATEGORIES.values())


def test_structure_is_not_furniture():
    assert all(is_structure(s) for s in STRUCTURE)
    assert not any(is_structure(c) for c in CATEGORIES)


def test_what_scenes_of_others_bring_has_names_of_its_own():
    assert not FOREIGN_CATEGORIES.keys() & {*STRUCTURE, *CATEGORIES}
    assert phrase("pool_table") == "pool table"
    assert UNKNOWN in FOREIGN_CATEGORIES
    assert all(is_nameable(c) and not is_structure(c) for c in FOREIGN_CATEGORIES)


def test_an_unknown_category_is_refused_by_name():
    message = r"category 'spaceship' is unknown; allowed: wall, .*chair.*pool_table"
    with pytest.raises(ValueError, match=message):
        phrase("spaceship")


def test_captions_are_about_objects_only():
    unnamed = [name for name in (*STRUCTURE, *CATEGORIES) if not is_nameable(name)]
    assert unnamed == [*STRUCTURE, "door_frame"]
