from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from langwm_data.scenes.catalogue.catalogue import CatalogueModel
from langwm_data.scenes.catalogue.kinds import Kind
from langwm_data.scenes.catalogue.split import TEST_FRACTION, split_models


def model(number, category: str | None = "chair"):
    return CatalogueModel(
        id=f"Tiny#{number}",
        name="Chair",
        group="Living room",
        kind=category and Kind(category=category, phrase=category),
        size=(1, 1, 1),
        elevation_m=0,
        rotation=(1, 0, 0, 0, 1, 0, 0, 0, 1),
        is_opening=False,
        author="Ann",
        licence="CC0",
        catalogue="Tiny",
        archive=Path("tiny.sh3f"),
        path="a.obj",
        checksum=(number, 1),
    )


@pytest.mark.parametrize("num", range(2, 12))
def test_both_splits_have_models_wherever_there_are_two(num):
    for first in range(0, 200, 20):
        splits = split_models([model(first + i) for i in range(num)])
        assert set(splits.values()) == {"train", "test"}


def test_a_single_model_is_for_training():
    assert split_models([model(1)]) == {"Tiny#1": "train"}
    assert split_models([]) == {}


def test_about_the_stated_share_is_for_testing():
    counts = Counter(split_models([model(i) for i in range(2000)]).values())
    assert counts["test"] / 2000 == pytest.approx(TEST_FRACTION, abs=0.04)  # four standard deviations


def test_order_and_other_categories_do_not_matter():
    chairs = [model(i) for i in range(20)]
    others = [model(100 + i, "sofa") for i in range(20)]
    alone = split_models(chairs)
    assert split_models([*others, *reversed(chairs)]).items() >= alone.items()


def test_more_models_leave_those_that_were_there_where_they_are():
    few = split_models([model(i) for i in range(50)])
    many = split_models([model(i) for i in range(500)])
    assert many.items() >= few.items()


def test_copies_of_one_file_stay_together():
    models = [replace(model(i), checksum=(i // 2, 7)) for i in range(100)]
    splits = split_models(models)
    assert all(splits[f"Tiny#{i}"] == splits[f"Tiny#{i + 1}"] for i in range(0, 100, 2))


def test_what_is_of_no_known_kind_has_no_split():
    assert split_models([model(1, None)]) == {}
