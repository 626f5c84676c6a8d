"""Which models are shown in training and which are kept for testing: the one place that decides.

Source: ours. The choice depends on nothing but the models' ids, so it is the same in every dataset, and a
catalogue that grows moves at most one of the models that were there before in each category.
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterable, Mapping

from langwm_data.scenes.catalogue.catalogue import CatalogueModel
from langwm_data.scenes.spec import Split

TEST_FRACTION = 0.25
"""Of the models of each category, about."""


def split_models(models: Iterable[CatalogueModel]) -> Mapping[str, Split]:
    """The split of every model of a known kind, by id.

    A category with at least two different models has some in each split; a single one is for training.
    Copies of one file count as one model and stay together.
    """
    copies: defaultdict[str, defaultdict[tuple[int, int], list[str]]] = defaultdict(lambda: defaultdict(list))
    for model in models:
        if model.kind is not None:
            copies[model.kind.category][model.checksum].append(model.id)
    splits: dict[str, Split] = {}
    for of_category in copies.values():
        groups = sorted(of_category.values(), key=lambda ids: _share(min(ids)))
        num_test = sum(_share(min(ids)) < TEST_FRACTION for ids in groups)
        num_test = min(max(num_test, 1), len(groups) - 1)
        for i, ids in enumerate(groups):
            splits |= dict.fromkeys(ids, "test" if i < num_test else "train")
    return splits


def _share(model: str) -> float:
    """A number from 0 to 1 that follows from an id alone, as if drawn at random."""
    return int.from_bytes(hashlib.sha256(model.encode()).digest()[:6], "big") / 2**48
