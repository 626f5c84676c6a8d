import hashlib
import json

import numpy as np
import pytest

from langwm_data.labels.semantic import CATEGORY_IDS, semantic_mask
from langwm_data.scenes.taxonomy import CATEGORIES, FOREIGN_CATEGORIES, STRUCTURE

ISSUED = 86
"""Categories that stand in files of others. Raise it, and the digest, when one is added at the end."""
DIGEST = "ec4c7e8ea06d0793"


def test_every_category_has_one_number():
    assert set(CATEGORY_IDS) == {*STRUCTURE, *CATEGORIES, *FOREIGN_CATEGORIES}
    assert sorted(CATEGORY_IDS.values()) == list(range(1, len(CATEGORY_IDS) + 1))


def test_numbers_once_given_stay():
    issued = {name: number for name, number in CATEGORY_IDS.items() if number <= ISSUED}
    assert (issued["wall"], issued["chair"], issued["bed"], issued["shoe"]) == (1, 4, 11, 68)
    assert (issued["basket"], issued["other_object"]) == (69, ISSUED)
    assert hashlib.sha256(json.dumps(issued, sort_keys=True).encode()).hexdigest()[:16] == DIGEST


def test_pixels_take_the_number_of_their_instances_category():
    instance = np.array([[0, 300, 300], [7, 7, 9]], np.uint16)
    table = {300: "chair", 7: "wall", 9: "chair", 4000: "shoe"}
    mask = semantic_mask(instance, table, CATEGORY_IDS)
    assert mask.dtype == np.uint8
    assert mask.tolist() == [[0, 4, 4], [1, 1, 4]]


def test_numbers_of_another_dataset_are_used_as_given():
    mask = semantic_mask(np.array([[5]], np.uint16), {5: "sofa"}, {"sofa": 200})
    assert mask.tolist() == [[200]]
    with pytest.raises(KeyError, match="sofa"):
        semantic_mask(np.array([[5]], np.uint16), {5: "sofa"}, {"chair": 1})
