"""What things are called: categories of furniture and structure.

Owns names and the words a caption uses for them. How a category looks stands in ``furniture``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

STRUCTURE = ("wall", "floor", "ceiling")
"""Parts of the building itself; the same words as ``spec.SurfaceKind``."""


@dataclass(frozen=True, kw_only=True)
class Category:
    """One kind of household object."""

    name: str
    phrase: str
    """The noun a person would use, without article."""
    num_models: int
    """How many variants the furniture module builds: ``<name>_01`` up to this number."""
    is_loose: bool = False
    """Small things that physics lays down; everything else stands fixed."""


def _table(*rows: tuple[str, int], loose: tuple[tuple[str, int], ...]) -> Mapping[str, Category]:
    table = {}
    for is_loose, entries in ((False, rows), (True, loose)):
        for phrase, num_models in entries:
            name = phrase.replace(" ", "_")
            table[name] = Category(name=name, phrase=phrase, num_models=num_models, is_loose=is_loose)
    return MappingProxyType(table)


CATEGORIES: Mapping[str, Category] = _table(
    # seats and beds
    ("chair", 8),
    ("armchair", 5),
    ("sofa", 6),
    ("stool", 4),
    ("bench", 4),
    ("office chair", 5),
    ("pouf", 3),
    ("bed", 8),
    # tables
    ("dining table", 8),
    ("coffee table", 6),
    ("side table", 4),
    ("desk", 6),
    ("console table", 4),
    # storage
    ("nightstand", 5),
    ("bookshelf", 6),
    ("wardrobe", 5),
    ("dresser", 5),
    ("sideboard", 4),
    ("tv stand", 5),
    ("shoe rack", 4),
    ("coat rack", 3),
    ("storage shelf", 4),
    ("chest", 4),
    # kitchen
    ("kitchen cabinet", 4),
    ("wall cabinet", 4),
    ("kitchen sink", 4),
    ("stove", 4),
    ("fridge", 5),
    ("dishwasher", 3),
    ("range hood", 3),
    ("microwave", 3),
    ("trash can", 4),
    # bathroom
    ("toilet", 4),
    ("washbasin", 5),
    ("bathtub", 4),
    ("shower", 3),
    ("mirror", 5),
    ("washing machine", 3),
    ("laundry basket", 4),
    ("towel rail", 3),
    # devices and light
    ("tv", 4),
    ("monitor", 4),
    ("keyboard", 3),
    ("floor lamp", 5),
    ("table lamp", 5),
    ("ceiling lamp", 5),
    # on walls and floors
    ("picture", 8),
    ("curtain", 8),
    ("radiator", 4),
    ("rug", 8),
    ("potted plant", 6),
    ("piano", 3),
    # openings
    ("window", 12),
    ("door", 6),
    ("door frame", 6),
    loose=(
        ("cup", 4),
        ("bowl", 4),
        ("bottle", 4),
        ("book", 5),
        ("vase", 5),
        ("cooking pot", 3),
        ("ball", 5),
        ("cardboard box", 5),
        ("toy car", 4),
        ("shoe", 4),
    ),
)


UNKNOWN = "other_object"
"""What a dataset of others calls by a name that stands in no table here; its phrase is that name."""

FOREIGN_CATEGORIES: Mapping[str, Category] = _table(
    ("basket", 0),
    ("cabinet", 0),
    ("clock", 0),
    ("coffee machine", 0),
    ("counter", 0),
    ("crib", 0),
    ("cushion", 0),
    ("dryer", 0),
    ("fence", 0),
    ("guitar", 0),
    ("laptop", 0),
    ("loudspeaker", 0),
    ("oven", 0),
    ("pool table", 0),
    ("sink", 0),
    ("table", 0),
    ("treadmill", 0),
    ("other object", 0),
    loose=(),
)
"""Kinds of which procedural homes have no models: scenes of others bring them."""


def phrase(category: str) -> str:
    """The words for a category: ``dining_table`` is a "dining table".

    Raises:
        ValueError: If the category is neither furniture nor structure.
    """
    if category in STRUCTURE:
        return category
    known = CATEGORIES.get(category) or FOREIGN_CATEGORIES.get(category)
    if known is None:
        allowed = ", ".join([*STRUCTURE, *CATEGORIES, *FOREIGN_CATEGORIES])
        raise ValueError(f"category {category!r} is unknown; allowed: {allowed}")
    return known.phrase


def is_structure(category: str) -> bool:
    """Whether this is the building itself (wall, floor, ceiling) and not an object in it."""
    return category in STRUCTURE


def is_nameable(category: str) -> bool:
    """Whether a caption may be about it: objects, but not the building or the frames set into its walls."""
    return not is_structure(category) and category != "door_frame"
