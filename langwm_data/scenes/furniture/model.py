"""What a furniture model is, and the builder that its recipe draws with.

A model's own frame: x to its right-hand side, +y to its front, z up, the origin at the centre of its
footprint at its lowest point.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from langwm_data.scenes.geometry import Boxes, axis_quat
from langwm_data.scenes.spec import (
    IDENTITY,
    MaterialSlot,
    MeshSpec,
    ModelRecord,
    PartSpec,
    Quat,
    Rect,
    Shape,
    Vec3,
)

WOODEN = ("wood", "planks")
BOARD = ("wood", "planks", "paint", "plastic")
CLOTH = ("fabric", "fabric_carpet")
SOFT = ("fabric", "leather")
METAL = ("metal",)
TOUGH = ("metal", "plastic")
WHITEWARE = ("porcelain",)
STONE_TOP = ("marble", "terrazzo", "wood", "concrete")


@dataclass(frozen=True, kw_only=True)
class Top:
    """Where small things can be put on a model."""

    height: float
    rect: Rect
    """x0, y0, x1, y1 in the model's own frame."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """One variant of a category, before it stands anywhere."""

    name: str
    category: str
    size: Vec3
    parts: tuple[PartSpec, ...]
    """``slot`` counts within ``slots``."""
    slots: tuple[MaterialSlot, ...]
    top: Top | None = None
    """None where nothing can be put."""
    elevation_m: float = 0.0
    """How far above the place that it is given it hangs."""
    is_round: bool = False
    """Whether people sit all around it."""
    mesh: MeshSpec | None = None
    """What is drawn instead of the parts."""
    phrase: str = ""
    """The noun for it, empty for that of its category."""
    record: ModelRecord | None = None
    """Who made it, if it is not of our own making."""


class Builder:
    """Collects the parts of one model. ``at`` is always the centre of a part's bottom face."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self._parts: list[PartSpec] = []
        self._slots: list[MaterialSlot] = []

    def uniform(self, low: float, high: float) -> float:
        """A length between the limits, to the millimetre."""
        return round(float(self.rng.uniform(low, high)), 3)

    def choice(self, options: Sequence[float]) -> float:
        """One of the lengths."""
        return float(options[int(self.rng.integers(len(options)))])

    def coin(self, probability: float = 0.5) -> bool:
        """True with ``probability``."""
        return bool(self.rng.random() < probability)

    def slot(self, name: str, categories: tuple[str, ...]) -> int:
        """A new place for a material."""
        self._slots.append(MaterialSlot(name=name, categories=categories))
        return len(self._slots) - 1

    def box(self, slot: int, size: Vec3, at: Vec3, orientation: Quat = IDENTITY) -> None:
        """A cuboid."""
        self._add("box", slot, size, at, orientation)

    def cylinder(
        self, slot: int, diameter: float, height: float, at: Vec3, orientation: Quat = IDENTITY
    ) -> None:
        """A round post or disc, along z before it is turned about its centre."""
        self._add("cylinder", slot, (diameter, diameter, height), at, orientation)

    def ellipsoid(self, slot: int, size: Vec3, at: Vec3) -> None:
        """A ball, or one pressed flat."""
        self._add("ellipsoid", slot, size, at, IDENTITY)

    def frustum(self, slot: int, bottom: float, top: float, height: float, at: Vec3) -> None:
        """A cone with its tip cut off, given by two diameters."""
        wide, narrow = max(bottom, top), min(bottom, top)
        # One that widens upwards is a narrowing one upside down: the size then is the full extent.
        upside_down = axis_quat((1.0, 0.0, 0.0), math.pi) if top > bottom else IDENTITY
        self._add("frustum", slot, (wide, wide, height), at, upside_down, narrow / wide)

    def legs(self, slot: int, span: tuple[float, float], thickness: float, height: float) -> None:
        """Four square legs whose outer corners span a rectangle around the origin."""
        for x in (-1, 1):
            for y in (-1, 1):
                at = (x * (span[0] - thickness) / 2, y * (span[1] - thickness) / 2, 0.0)
                self.box(slot, (thickness, thickness, height), at)

    def build(self, name: str, category: str) -> Model:
        """The model, its origin moved to the centre of its footprint at its lowest point."""
        assert self._parts, f"{name} has no parts"
        boxes = Boxes.of_parts(((0.0, 0.0, 0.0), IDENTITY, part) for part in self._parts)
        low, high = boxes.bounds[:, 0].min(axis=0), boxes.bounds[:, 1].max(axis=0)
        shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
        used = sorted({p.slot for p in self._parts})
        parts = tuple(
            replace(p, slot=used.index(p.slot), position=_vec3(np.asarray(p.position) - shift))
            for p in self._parts
        )
        slots = tuple(self._slots[i] for i in used)
        size = _vec3(high - low)
        top = Top(height=size[2], rect=(-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2))
        is_round = abs(size[0] - size[1]) < 1e-6 and len(parts) == 3
        return Model(
            name=name, category=category, size=size, parts=parts, slots=slots, top=top, is_round=is_round
        )

    def _add(
        self,
        shape: Shape,
        slot: int,
        size: Vec3,
        at: Vec3,
        orientation: Quat,
        taper: float = 1.0,
    ) -> None:
        position = (at[0], at[1], at[2] + size[2] / 2)
        assert min(size) > 0, f"{shape} of size {size}"
        self._parts.append(
            PartSpec(
                shape=shape, size=size, position=position, slot=slot, orientation=orientation, taper=taper
            )
        )


Recipe = Callable[[Builder], None]
"""Draws one model; all it knows is the builder with the model's own generator."""


def _vec3(values: np.ndarray) -> Vec3:
    x, y, z = (round(float(v), 5) + 0.0 for v in values)
    return (x, y, z)
