"""Does training show what is held out for testing? Proved from the documents in the shards alone.

Owns the comparison of two splits. What is held out stands in ``scenes.splits`` (Tables 4 and 5).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from langwm_data.scenes.spec import MaterialRef, Split
from langwm_data.scenes.splits import (
    ALL_BUILDINGS,
    CATALOGUE_SIZES,
    EVERYTHING,
    IGIBSON_BUILDINGS,
    HeldOut,
    is_picture_for,
    side_of,
    texture_ids,
)
from langwm_data.scenes.taxonomy import is_structure
from langwm_data.shards.document import SampleDocument
from langwm_data.shards.findings import foreign


@dataclass(kw_only=True)
class Shown:
    """Everything that the frames of one split show: names, and one frame that shows each."""

    frames: int = 0
    buildings: dict[str, str] = field(default_factory=dict)
    """Name to key of a frame, as in the other tables."""
    textures: dict[str, str] = field(default_factory=dict)
    models: dict[str, str] = field(default_factory=dict)

    def add(self, document: SampleDocument, key: str) -> None:
        """Count one frame."""
        self.frames += 1
        self.buildings.setdefault(document["building"], key)
        for text in document["palette"]:
            self.textures.setdefault(text, key)
        for obj in document["objects"]:
            if not is_structure(obj["category"]):
                self.models.setdefault(obj["model"], key)

    def update(self, other: "Shown") -> None:
        """Count the frames of another part of the same split."""
        self.frames += other.frames
        self.buildings = other.buildings | self.buildings
        self.textures = other.textures | self.textures
        self.models = other.models | self.models

    def as_text(self) -> str:
        """How much it is."""
        names = ", ".join(sorted(self.buildings)[:12])
        return (
            f"{self.frames} frames of {len(self.buildings)} buildings ({names}),"
            f" {len(self.textures)} textures, {len(self.models)} models"
        )


def sample_leaks(
    document: SampleDocument,
    split: Split,
    held_out_models: frozenset[str] = frozenset(),
    holds_out: Sequence[HeldOut] = EVERYTHING,
) -> list[str]:
    """What one frame shows that its split must not show.

    A test frame in a held-out building wears held-out textures only, but may show any model. Where less is
    held out, it shows what training frames may show in all else.

    Args:
        document: Of the frame.
        split: Of the frame.
        held_out_models: Those that training frames must not show.
        holds_out: What test frames do not share with training frames.
    """
    leaks = []
    side = side_of(split, "buildings", holds_out)
    for name in dict.fromkeys((document["building"], document["scene"].rpartition("_")[0])):
        building = ALL_BUILDINGS.get(name)
        if building is None:
            leaks.append(f"building {foreign(name)} is in no table of splits")
        elif building.split != side:
            leaks.append(f"building {name} is for {building.split}, the frame is for {side}")
    side = side_of(split, "textures", holds_out)
    for text in dict.fromkeys(document["palette"]):
        if leak := _texture_leak(text, side, is_picture=document["building"] in IGIBSON_BUILDINGS):
            leaks.append(leak)
    if side_of(split, "models", holds_out) == "train":
        seen = {obj["model"] for obj in document["objects"]}
        leaks += [f"model {name} is held out for test" for name in sorted(seen & held_out_models)]
    return leaks


@lru_cache(maxsize=1 << 12)
def _texture_leak(text: str, split: Split, *, is_picture: bool) -> str:
    try:
        material = MaterialRef.parse(text)
    except ValueError:
        return f"texture {foreign(text)} is not of the form wood/05"
    category = material.category
    is_known = is_picture or material.id in range(1, CATALOGUE_SIZES.get(category, 0) + 1)
    if not is_known or str(material) != text:
        return f"texture {foreign(text)} is in no table of splits"
    if (
        is_picture_for(category, material.id, split)
        if is_picture
        else material.id in texture_ids(category, split)
    ):
        return ""
    meant = "training" if split == "test" else "test"
    return f"texture {text} is for {meant} only, the frame is for {split}"
