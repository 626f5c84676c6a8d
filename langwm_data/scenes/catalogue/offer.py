"""Models of catalogues as furniture of homes: each for one split, made ready when a home asks for it."""

import hashlib
import json
import logging
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from langwm_data.scenes.catalogue.archive import ArchiveError
from langwm_data.scenes.catalogue.cache import RECIPE, ReadyModel, archive_digest, is_ready, make_ready
from langwm_data.scenes.catalogue.catalogue import Catalogue, CatalogueModel
from langwm_data.scenes.catalogue.limits import HUNG, MAX_CUT_OUT_SHARE, MAX_TRIANGLES, has_use, misfit
from langwm_data.scenes.catalogue.split import split_models
from langwm_data.scenes.furniture import Model, Top
from langwm_data.scenes.spec import OWN, MeshSpec, ModelRecord, PartSpec, Split, Vec3
from langwm_data.scenes.taxonomy import CATEGORIES, phrase
from langwm_data.seeding import make_rng

NUM_MODELS = 4
"""How many models of one category a building has at most."""

_logger = logging.getLogger(__name__)


class Furniture:
    """All models of a folder of catalogues that homes take."""

    def __init__(self, folder: Path, cache: Path) -> None:
        """List the catalogues; no mesh is read yet.

        Args:
            folder: Holds ``.sh3f`` files, in itself or in folders of it.
            cache: Where models are kept once they are ready.

        Raises:
            ValueError: If there is no catalogue, or one is damaged, hostile or none.
        """
        catalogue = Catalogue.open(folder)
        fitting = [model for model in catalogue.models if misfit(model) is None]
        self.identity = _identity(catalogue)
        self.cache = cache
        self._catalogue = catalogue
        self.left_out: dict[str, str] = {}
        """Models that turned out to be of no use when they were made ready, and why."""
        self._splits = split_models(fitting)
        self._by_category: defaultdict[str, list[CatalogueModel]] = defaultdict(list)
        for model in fitting:
            assert model.kind is not None
            self._by_category[model.kind.category].append(model)
        self._built: dict[str, Model | None] = {}
        self._has_told = False

    def report(self) -> str:
        """What homes use as what, and by name what they do not use, and why."""
        reasons = {model.id: misfit(model) for model in self._catalogue.known()} | self.left_out
        unused = {name: reason for name, reason in reasons.items() if reason}
        lines = [self._catalogue.report(), f"{len(unused)} models of a known kind are not used:"]
        return "\n".join([*lines, *(f"  {name}: {reason}" for name, reason in sorted(unused.items()))])

    def of_category(self, category: str, split: Split) -> list[CatalogueModel]:
        """Models that homes of one split may show, sorted by id."""
        return [m for m in self._by_category[category] if self._splits[m.id] == split]

    def build(self, model: CatalogueModel) -> Model | None:
        """A model ready to be placed, or None for one that is of no use after all.

        Raises:
            ArchiveError: If its catalogue is damaged.
        """
        if model.id not in self._built:
            self._built[model.id] = self._build(model)
        return self._built[model.id]

    def _build(self, model: CatalogueModel) -> Model | None:
        if not self._has_told and not is_ready(model, self.cache):
            self._has_told = True
            _logger.info(
                "models are made ready for their first use, a second each, and kept in %s", self.cache
            )
        try:
            ready = make_ready(model, self.cache)
        except ArchiveError:
            raise
        except ValueError as error:
            self.left_out[model.id] = str(error)
            _logger.warning("furniture model left out: %s", error)
            return None
        reason = _no_use(model, ready)
        if reason is not None:
            self.left_out[model.id] = reason
            _logger.debug("furniture model %s left out: %s", model.id, reason)
            return None
        return _as_furniture(model, ready, self._splits[model.id])


class Offer:
    """The models that one building chooses from."""

    def __init__(self, furniture: Furniture, split: Split, seed: int, building: str) -> None:
        self._furniture = furniture
        self._split: Split = split
        self._seed, self._building = seed, building

    def models(self, rng: np.random.Generator, category: str) -> Iterator[Model]:
        """The building's models of a category in random order, each made ready when it is asked for."""
        candidates = self._furniture.of_category(category, self._split)
        own = make_rng(self._seed, "catalogue", self._building, category)
        chosen = own.permutation(len(candidates))[:NUM_MODELS]
        order = rng.permutation(len(chosen)) if len(chosen) else ()
        models = (self._furniture.build(candidates[chosen[i]]) for i in order)
        return (model for model in models if model is not None)


def _identity(catalogue: Catalogue) -> str:
    """One SHA-256 over the files of all catalogues and the way in which models are made ready."""
    digests = sorted({archive_digest(model.archive) for model in catalogue.models})
    return hashlib.sha256(json.dumps([RECIPE, *digests]).encode()).hexdigest()


def _no_use(model: CatalogueModel, ready: ReadyModel) -> str | None:
    assert model.kind is not None
    if ready.cut_out_share > MAX_CUT_OUT_SHARE:
        return f"{ready.cut_out_share:.0%} of its surface is cut out of its textures"
    if ready.num_triangles > MAX_TRIANGLES:
        return f"{ready.num_triangles} triangles are left of it; homes take at most {MAX_TRIANGLES}"
    if not has_use(model.kind.category, model.size, ready.top):
        return f"it has no level top, which a {model.kind.category} needs"
    return None


def _as_furniture(model: CatalogueModel, ready: ReadyModel, split: Split) -> Model:
    assert model.kind is not None
    category, noun = model.kind.category, model.kind.phrase
    # A loose thing is one box, which comes to rest whatever its true form.
    solids = [_box(*corners) for corners in ready.solids]
    if CATEGORIES[category].is_loose:
        width, depth, height = model.size
        solids = [_box((-width / 2, -depth / 2, 0.0), (width / 2, depth / 2, height))]
    top = None
    if ready.top is not None:
        height, x0, y0, x1, y1 = ready.top
        top = Top(height=height, rect=(x0, y0, x1, y1))
    return Model(
        name=model.id,
        category=category,
        size=model.size,
        parts=tuple(solids),
        slots=(),
        top=top,
        elevation_m=model.elevation_m if category in HUNG else 0.0,
        is_round=noun.startswith("round "),
        mesh=MeshSpec(name=ready.mesh, slots=(OWN,) * ready.num_groups),
        phrase="" if noun == phrase(category) else noun,
        record=ModelRecord(
            model=model.id,
            split=split,
            name=model.name,
            author=model.author,
            licence=model.licence,
            source=model.catalogue,
        ),
    )


def _box(low: Vec3, high: Vec3) -> PartSpec:
    size, position = (
        tuple(round(f(a, b), 6) for a, b in zip(low, high, strict=True))
        for f in (lambda a, b: b - a, lambda a, b: (a + b) / 2)
    )
    return PartSpec(shape="box", size=size, position=position, slot=OWN)  # pyright: ignore[reportArgumentType]
