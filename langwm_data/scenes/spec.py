"""What a scene is: frozen data in SI units that round-trips through JSON.

A ``SceneSpec`` holds everything that any renderer, simulator or labeller needs. Who makes one
(procedural homes, catalogues, iGibson) and what is done with it stand elsewhere.

World frame: metres, z up, the floor at z = 0. Angles in radians, counter-clockwise seen from above.
"""

import dataclasses
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

SCHEMA_VERSION = 1

Split = Literal["train", "test"]
Shape = Literal["box", "cylinder", "ellipsoid", "frustum"]
SurfaceKind = Literal["wall", "floor", "ceiling"]
Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Rect = tuple[float, float, float, float]

IDENTITY: Quat = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True, order=True)
class MaterialRef:
    """One texture: a material category and the number of an instance in it (Table 5)."""

    category: str
    id: int

    def __str__(self) -> str:
        """``wood/05``."""
        return f"{self.category}/{self.id:02d}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """The inverse of ``str``."""
        category, _, number = text.rpartition("/")
        return cls(category=category, id=int(number))


@dataclass(frozen=True, kw_only=True)
class MaterialSlot:
    """A place in the scene that takes one material; the categories it may be made of."""

    name: str
    categories: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class PartSpec:
    """One solid primitive of an object or surface, in the frame of its owner.

    ``size`` is the full extent along the part's own x, y, z before rotation. A ``cylinder`` and a
    ``frustum`` stand along z; ``taper`` is the ratio of a frustum's top radius to its bottom radius.
    """

    shape: Shape
    size: Vec3
    position: Vec3
    """Centre of the part."""
    slot: int
    """Index into ``SceneSpec.slots`` and ``SceneSpec.palette``."""
    orientation: Quat = IDENTITY
    """Quaternion x, y, z, w."""
    taper: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ObjectSpec:
    """One piece of furniture or equipment: rigid, made of several parts."""

    instance: int
    """Id in instance masks; unique in the scene, at least 1."""
    category: str
    model: str
    """Name of the variant, e.g. ``chair_03``: same parts for the same name."""
    room: str
    position: Vec3
    """World position of the object's origin: centre of its footprint, at its lowest point."""
    orientation: Quat
    size: Vec3
    """Extent of the bounding box in the object's own frame, the origin at the centre of its bottom."""
    parts: tuple[PartSpec, ...]
    is_fixed: bool = True
    """Whether physics leaves it in place; loose objects are settled once, then stay."""


@dataclass(frozen=True, kw_only=True)
class SurfaceSpec:
    """Part of the building itself: all wall, floor or ceiling pieces of one room share an instance."""

    instance: int
    kind: SurfaceKind
    room: str
    part: PartSpec
    """In world coordinates."""


@dataclass(frozen=True, kw_only=True)
class RoomSpec:
    """A rectangular room: kind and inner extent."""

    name: str
    kind: str
    rect: Rect
    """x0, y0, x1, y1 between the inner faces of its walls."""


@dataclass(frozen=True, kw_only=True)
class DoorwaySpec:
    """An opening between two rooms, wide enough for the robot."""

    rooms: tuple[str, str]
    center: tuple[float, float]
    width: float


@dataclass(frozen=True, kw_only=True)
class SceneSpec:
    """One floor of one building."""

    schema_version: int = SCHEMA_VERSION
    name: str
    """``<building>_<floor>``, characters ``[A-Za-z0-9_]``."""
    building: str
    floor: int
    split: Split
    height_m: float
    """Floor to ceiling."""
    rooms: tuple[RoomSpec, ...]
    doorways: tuple[DoorwaySpec, ...]
    surfaces: tuple[SurfaceSpec, ...]
    objects: tuple[ObjectSpec, ...]
    slots: tuple[MaterialSlot, ...]
    palette: tuple[MaterialRef, ...]
    """The material now in each slot."""

    def with_palette(self, palette: Sequence[MaterialRef]) -> Self:
        """The same scene in other materials."""
        if len(palette) != len(self.slots):
            raise ValueError(
                f"palette has {len(palette)} materials; scene {self.name} has {len(self.slots)} slots"
            )
        return dataclasses.replace(self, palette=tuple(palette))

    def instances(self) -> dict[int, tuple[str, str]]:
        """Instance id to (category, model) for everything that can appear in a mask."""
        table = {s.instance: (s.kind, f"{s.room}_{s.kind}") for s in self.surfaces}
        return table | {o.instance: (o.category, o.model) for o in self.objects}

    def iter_parts(self) -> Iterator[tuple[int, Vec3, Quat, PartSpec]]:
        """Every part with its instance id and the world pose of its owner."""
        for surface in self.surfaces:
            yield surface.instance, (0.0, 0.0, 0.0), IDENTITY, surface.part
        for obj in self.objects:
            for part in obj.parts:
                yield obj.instance, obj.position, obj.orientation, part

    def to_json(self) -> str:
        """Canonical JSON: the same scene always gives the same text."""
        return json.dumps(dataclasses.asdict(self), separators=(",", ":"), sort_keys=True, allow_nan=False)

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Read back ``to_json``.

        Raises:
            ValueError: If the text is not a scene of this schema version.
        """
        try:
            scene: Any = _ADAPTER.validate_json(text)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(p) for p in first["loc"]) or "the document"
            raise ValueError(f"not a scene: {where}: {first['msg']}") from error
        if scene.schema_version != SCHEMA_VERSION:
            raise ValueError(
                f"scene schema version {scene.schema_version}; this program reads {SCHEMA_VERSION}"
            )
        return scene


for _cls in (MaterialRef, MaterialSlot, PartSpec, ObjectSpec, SurfaceSpec, RoomSpec, DoorwaySpec, SceneSpec):
    _cls.__pydantic_config__ = ConfigDict(extra="forbid")  # pyright: ignore[reportAttributeAccessIssue]
_ADAPTER = TypeAdapter(SceneSpec)
