"""What the floors of one building have in common: height, fullness, and which models it uses."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np

from langwm_data.scenes.catalogue.offer import Offer
from langwm_data.scenes.furniture import Model, build_model, model_names
from langwm_data.scenes.taxonomy import CATEGORIES
from langwm_data.seeding import make_rng


@dataclass(frozen=True, kw_only=True)
class HomeStyle:
    """The style of one building."""

    height_m: float
    """Floor to ceiling."""
    density: float
    """Factor on the probability of every optional piece."""
    min_free_fraction: float
    """Least part of a room where the robot's centre can be."""
    variants: Mapping[str, tuple[str, ...]]
    """Procedural models that this building has of each category."""
    offer: Offer | None = None
    """Its models of catalogues, if it has any."""

    def models(self, rng: np.random.Generator, category: str) -> Iterator[Model]:
        """The building's models of a category, in random order, those of catalogues first."""
        names = self.variants[category]
        order = rng.permutation(len(names))
        return chain(self._others(rng, category), (build_model(names[i]) for i in order))

    def model(self, rng: np.random.Generator, category: str) -> Model:
        """Any one model of a category."""
        return next(self.models(rng, category))

    def first_choices(self, rng: np.random.Generator, category: str) -> Iterator[Model]:
        """Models to try for a piece that the room can do without: of catalogues, then one procedural."""
        for model in self.models(rng, category):
            yield model
            if model.mesh is None:
                return

    def is_loose(self, category: str) -> bool:
        """Whether physics lays the pieces of a category down."""
        return CATEGORIES[category].is_loose

    def _others(self, rng: np.random.Generator, category: str) -> Iterator[Model]:
        return iter(()) if self.offer is None else self.offer.models(rng, category)


def sample_style(seed: int, building: str, offer: Offer | None = None) -> HomeStyle:
    """The style of a building under a seed, with the models of catalogues that it is offered."""
    rng = make_rng(seed, "style", building)
    variants = {}
    for category in CATEGORIES:
        names = model_names(category)
        keep = max(3, (len(names) + 1) // 2)
        variants[category] = tuple(sorted(names[i] for i in rng.permutation(len(names))[:keep]))
    return HomeStyle(
        height_m=round(float(rng.uniform(2.4, 2.7)), 2),
        density=round(float(rng.uniform(0.6, 0.95)), 2),
        min_free_fraction=round(float(rng.uniform(0.12, 0.2)), 2),
        variants=variants,
        offer=offer,
    )
