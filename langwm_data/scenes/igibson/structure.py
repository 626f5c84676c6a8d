"""Walls, floors and ceilings of a scene: drawn as its meshes, cut by room; solid as its collision meshes."""

from dataclasses import dataclass, replace

import numpy as np

from langwm_data.scenes.assets import Assets
from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.maps import RoomMap
from langwm_data.scenes.igibson.materials import read_groups
from langwm_data.scenes.igibson.meshes import Floats, Piece, joined, read_piece, read_solids, solid_part
from langwm_data.scenes.igibson.models import BASE, Frame, link_frames, shape_pose
from langwm_data.scenes.igibson.parting import part_by_room
from langwm_data.scenes.igibson.urdf import Placed, Shape, parse_robot
from langwm_data.scenes.spec import OWN, MeshSpec, SurfaceKind, SurfaceSpec

KINDS: dict[str, SurfaceKind] = {"walls": "wall", "floors": "floor", "ceilings": "ceiling"}

_ORDER: tuple[SurfaceKind, ...] = ("wall", "floor", "ceiling")


@dataclass(frozen=True, kw_only=True, eq=False)
class Structure:
    """All walls, all floors or all ceilings of a scene, in world coordinates."""

    kind: SurfaceKind
    piece: Piece
    """What is seen; slots are indices into ``slots``, or ``OWN``."""
    slots: dict[str, tuple[str, ...]]
    """Material group to classes."""
    solids: tuple[Floats, ...]
    """Corners (N, 3) of the convex pieces that are collided with."""


def read_structure(data: DataFolder, folder: str, placed: Placed) -> Structure:
    """Read the meshes of one kind.

    Raises:
        ValueError: If something is missing or damaged.
    """
    path = f"{folder}/urdf/{placed.model}_{placed.category}.urdf"
    robot = parse_robot(data.read(path), path)
    scale = placed.scale or (1.0, 1.0, 1.0)
    frames = link_frames(robot, scale, {}, path)
    groups = read_groups(data, f"{folder}/misc/{placed.category}_material_groups.json")
    slots = {group: classes for group, classes in sorted(groups.values()) if classes}
    numbers = {group: number for number, group in enumerate(slots)}
    rotation, xyz = placed.origin.rotation(), np.asarray(placed.origin.xyz)
    pieces, solids = [], []
    for link in robot.links:
        inner = frames[link.name]
        frame = Frame(rotation=rotation @ inner.rotation, offset=rotation @ inner.offset + xyz)
        for shape in link.visuals:
            group, _ = groups.get(_name(shape), ("", ()))
            file = data.beside(f"{folder}/{BASE}", shape.file)
            pieces.append(read_piece(data, file, shape_pose(shape, frame, scale), numbers.get(group, OWN)))
        for shape in link.collisions:
            file = data.beside(f"{folder}/{BASE}", shape.file)
            solids += read_solids(data, file, shape_pose(shape, frame, scale))
    if not pieces:
        raise ValueError(f"{path}: no visual mesh")
    try:
        piece = joined(pieces)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return Structure(kind=KINDS[placed.category], piece=piece, slots=slots, solids=tuple(solids))


def surfaces_of(structure: Structure, rooms: RoomMap, first_slot: int, assets: Assets) -> list[SurfaceSpec]:
    """The pieces of each room, and the solids, which are not drawn.

    Args:
        structure: What was read.
        rooms: Which room is where.
        first_slot: Index of the first of its slots in the scene.
        assets: Where meshes are kept.
    """
    surfaces = []
    for room, piece in part_by_room(structure.piece, rooms.rooms_at).items():
        slots = tuple(slot if slot == OWN else first_slot + slot for slot in piece.slots)
        spec = MeshSpec(name=assets.add_mesh(piece.mesh), slots=slots)
        surfaces.append(_surface(structure.kind, rooms, room, mesh=spec))
    for solid in structure.solids:
        center = (solid.min(axis=0) + solid.max(axis=0))[None, :2] / 2
        surface = _surface(structure.kind, rooms, int(rooms.rooms_at(center)[0]))
        surfaces.append(replace(surface, part=solid_part(solid, slot=0), is_seen=False))
    return surfaces


def _surface(kind: SurfaceKind, rooms: RoomMap, room: int, mesh: MeshSpec | None = None) -> SurfaceSpec:
    return SurfaceSpec(
        instance=1 + len(_ORDER) * room + _ORDER.index(kind),
        kind=kind,
        room=rooms.rooms[room].name,
        part=None,
        mesh=mesh,
    )


def _name(shape: Shape) -> str:
    return shape.file.replace("\\", "/").rpartition("/")[2]
