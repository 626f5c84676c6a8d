"""What a scene is: frozen data in SI units that round-trips through JSON.

A ``SceneSpec`` holds everything that any renderer, simulator or labeller needs. Who makes one
(procedural homes, catalogues, iGibson) and what is done with it stand elsewhere.

World frame: metres, z up, the floor at z = 0. Angles in radians, counter-clockwise seen from above.
"""

import dataclasses
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from langwm_data.scenes.taxonomy import phrase

SCHEMA_VERSION = 2

Split = Literal["train", "test"]
Shape = Literal["box", "cylinder", "ellipsoid", "frustum", "hull"]
SurfaceKind = Literal["wall", "floor", "ceiling"]
Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Rect = tuple[float, float, float, float]

IDENTITY: Quat = (0.0, 0.0, 0.0, 1.0)

OWN = -1
"""In place of a slot: the material that a mesh brings along."""


@dataclass(frozen=True, kw_only=True, order=True)
class MaterialRef:
    """One texture: a material category and the number of an instance in it (Table 5)."""

    category: str
    id: int
    picture: str = ""
    """SHA-256 of the PNG that shows it, an asset of its scene; empty for the procedural textures."""

    def __str__(self) -> str:
        """``wood/05``."""
        return f"{self.category}/{self.id:02d}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """The inverse of ``str``, for procedural textures."""
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
    ``frustum`` stand along z; ``taper`` is the ratio of a frustum's top radius to its bottom radius. A
    ``hull`` is the convex hull of ``points``, the middle of whose bounding box is the part's centre.
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
    points: tuple[Vec3, ...] = ()
    """Of a hull, relative to its centre; empty for all other shapes."""


@dataclass(frozen=True, kw_only=True)
class MeshSpec:
    """Triangles that are drawn in the place of parts, in the frame of their owner."""

    name: str
    """SHA-256 of its file, an asset of the scene."""
    slots: tuple[int, ...]
    """For each of its groups of triangles the index into ``SceneSpec.slots``, or ``OWN``."""


@dataclass(frozen=True, kw_only=True)
class ModelRecord:
    """Who made a model that is not the generator's own, and which split may show it."""

    model: str
    split: Split
    name: str
    """As its source calls it."""
    author: str
    licence: str
    source: str
    """The catalogue or dataset it comes from."""


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
    """What it collides with; also what it looks like, unless there is a mesh."""
    is_fixed: bool = True
    """Whether physics leaves it in place; loose objects are settled once, then stay."""
    mesh: MeshSpec | None = None
    phrase: str = ""
    """The noun that captions use for it; empty for that of its category."""


@dataclass(frozen=True, kw_only=True)
class SurfaceSpec:
    """Part of the building itself: all wall, floor or ceiling pieces of one room share an instance.

    In world coordinates.
    """

    instance: int
    kind: SurfaceKind
    room: str
    part: PartSpec | None
    """What is collided with, and seen where there is no mesh; None for a mesh that is only seen."""
    mesh: MeshSpec | None = None
    is_seen: bool = True
    """False for a solid that is only collided with: a piece of what the mesh of another surface shows."""


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


class InstanceName(NamedTuple):
    """What one thing in a scene is called."""

    category: str
    model: str
    phrase: str
    """The noun that captions use."""


@dataclass(frozen=True, kw_only=True)
class FloorMap:
    """Where the maker of a scene lets a robot drive: cells of a grid, less what solids cover."""

    origin: tuple[float, float]
    """Outer corner of cell (0, 0), metres."""
    resolution_m: float
    """Edge of a cell."""
    size: tuple[int, int]
    """Cells along x and along y."""
    runs: tuple[tuple[int, ...], ...]
    """For each cell along x, ascending, where along y free cells begin and end (exclusive), in turns."""

    @classmethod
    def of_mask(cls, mask: NDArray[np.bool_], *, origin: tuple[float, float], resolution_m: float) -> Self:
        """The free cells of a mask (X, Y)."""
        edges = np.diff(np.pad(mask.astype(np.int8), ((0, 0), (1, 1))), axis=1)
        return cls(
            origin=origin,
            resolution_m=resolution_m,
            size=(mask.shape[0], mask.shape[1]),
            runs=tuple(tuple(np.flatnonzero(row).tolist()) for row in edges),
        )

    def free_at(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points (..., 2) lie in free cells."""
        mask = np.zeros(self.size, bool)
        for i, runs in enumerate(self.runs):
            for start, stop in zip(runs[::2], runs[1::2], strict=True):
                mask[i, start:stop] = True
        cells = np.floor((points - self.origin) / self.resolution_m + _EDGE).astype(int)
        is_inside = np.all((cells >= 0) & (cells < self.size), axis=-1)
        i, j = np.moveaxis(np.where(is_inside[..., None], cells, 0), -1, 0)
        return is_inside & mask[i, j]


_EDGE = 1e-9
"""Cells: a point on an edge lies in the cell after it, whatever the last digit says."""


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
    pictures: tuple[MaterialRef, ...] = ()
    """All materials that its slots may take, where they are pictures; else they are procedural."""
    models: tuple[ModelRecord, ...] = ()
    """Of the models of others that stand in it, each once."""
    floor_map: FloorMap | None = None
    """Limits free space, where its maker drew one."""

    def with_palette(self, palette: Sequence[MaterialRef]) -> Self:
        """The same scene in other materials."""
        if len(palette) != len(self.slots):
            raise ValueError(
                f"palette has {len(palette)} materials; scene {self.name} has {len(self.slots)} slots"
            )
        return dataclasses.replace(self, palette=tuple(palette))

    def instances(self) -> dict[int, InstanceName]:
        """What everything that can appear in a mask is called, by instance id."""
        table = {
            s.instance: InstanceName(category=s.kind, model=f"{s.room}_{s.kind}", phrase=s.kind)
            for s in self.surfaces
        }
        for o in self.objects:
            noun = o.phrase or phrase(o.category)
            table[o.instance] = InstanceName(category=o.category, model=o.model, phrase=noun)
        return table

    def assets(self) -> tuple[str, ...]:
        """Names of the meshes and pictures that it needs, sorted; see ``scenes.assets``."""
        meshes = {owner.mesh.name for owner in (*self.surfaces, *self.objects) if owner.mesh}
        pictures = {m.picture for m in (*self.palette, *self.pictures) if m.picture}
        return tuple(sorted({f"{name}.npz" for name in meshes} | {f"{name}.png" for name in pictures}))

    def read_palette(self, texts: Sequence[str]) -> tuple[MaterialRef, ...]:
        """Materials from the way in which they are written in the documents of frames."""
        pictures = {str(material): material for material in self.pictures}
        return tuple(pictures.get(text) or MaterialRef.parse(text) for text in texts)

    def iter_parts(self) -> Iterator[tuple[int, Vec3, Quat, PartSpec]]:
        """Every part with its instance id and the world pose of its owner."""
        for surface in self.surfaces:
            if surface.part is not None:
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


for _cls in (
    MaterialRef,
    MaterialSlot,
    PartSpec,
    MeshSpec,
    ModelRecord,
    ObjectSpec,
    SurfaceSpec,
    RoomSpec,
    DoorwaySpec,
    FloorMap,
    SceneSpec,
):
    _cls.__pydantic_config__ = ConfigDict(extra="forbid")  # pyright: ignore[reportAttributeAccessIssue]
_ADAPTER = TypeAdapter(SceneSpec)
