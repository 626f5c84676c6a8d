"""An object of a scene: one ``ObjectSpec`` for each of its bodies, at rest where the scene says.

Source: iGibson 1.0 igibson_indoor_scene.py, articulated_object.py.
"""

import hashlib
import json
import posixpath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from langwm_data import atomic
from langwm_data.scenes.assets import Assets
from langwm_data.scenes.catalogue.cache import (
    HEAVY_TRIANGLES,
    MAX_ERROR_M,
    MAX_ERROR_SHARE,
    max_error_m,
)
from langwm_data.scenes.geometry import axis_quat, quat_product
from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.materials import read_groups
from langwm_data.scenes.igibson.meshes import (
    Floats,
    Pose,
    joined,
    moved,
    read_piece,
    read_solids,
    solid_part,
)
from langwm_data.scenes.igibson.models import BASE, Frame, Model, bodies, link_frames, shape_pose
from langwm_data.scenes.igibson.urdf import Link, Placed, turn
from langwm_data.scenes.meshes.decimate import decimate
from langwm_data.scenes.spec import OWN, PartSpec, Quat, Vec3

RECIPE = 1
"""Number of the way in which meshes are made; a new one makes all of them again."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """One rigid body of an object, in its own frame: the origin in the middle of its foot."""

    root: str
    """The link that it hangs on."""
    mesh: str
    """Name among the assets."""
    groups: tuple[int, ...]
    """For each group of the mesh an index into ``Instance.slots``, or ``OWN``."""
    foot: Vec3
    """Origin of this frame in that of the base link, metres."""
    size: Vec3
    solids: tuple[Floats, ...]
    """Corners (N, 3) of the convex solids that it collides with."""


@dataclass(frozen=True, kw_only=True)
class Instance:
    """One object of a scene: its model in its size and place."""

    placed: Placed
    model: Model
    scale: Vec3
    slots: Mapping[str, tuple[str, ...]]
    """Material group to classes, in the order of slots, of the groups that have any."""
    slot_of_mesh: Mapping[str, int]
    """File of a visual mesh to the index of its slot; what is not in it has its own material."""

    @property
    def orientation(self) -> Quat:
        """Of the base link in the world."""
        roll, pitch, yaw = self.placed.origin.rpy
        tilted = quat_product(axis_quat((0, 1, 0), pitch), axis_quat((1, 0, 0), roll))
        return quat_product(axis_quat((0, 0, 1), yaw), tilted)

    @property
    def to_world(self) -> Pose:
        """From the frame of the base link to the world."""
        origin = self.placed.origin
        # The scene says where the middle of the box is, turned by the yaw alone.
        from_middle = turn((0, 0, 1), origin.rpy[2]) @ np.multiply(self.scale, self.model.box_center)
        return Pose(matrix=origin.rotation(), offset=np.subtract(origin.xyz, from_middle))


def make_instance(data: DataFolder, placed: Placed, model: Model) -> Instance:
    """An object of a scene in the size that its scene gives it.

    Raises:
        ValueError: If its material groups are missing or damaged.
    """
    if placed.bounding_box is not None:
        x, y, z = np.divide(placed.bounding_box, model.box_size).tolist()
        scale = (x, y, z)
    else:
        scale = placed.scale or (1.0, 1.0, 1.0)
    groups = read_groups(data, f"{model.folder}/misc/material_groups.json")
    slots = {group: classes for group, classes in sorted(groups.values()) if classes}
    numbers = {group: number for number, group in enumerate(slots)}
    slot_of_mesh = {file: numbers[group] for file, (group, _) in groups.items() if group in numbers}
    return Instance(placed=placed, model=model, scale=scale, slots=slots, slot_of_mesh=slot_of_mesh)


def make_bodies(
    data: DataFolder, assets: Assets, instance: Instance, positions: Mapping[str, float]
) -> list[Body]:
    """The bodies of an object, its joints at ``positions``; meshes that were made before are found again.

    Raises:
        ValueError: If a mesh is missing or damaged, or a body has none.
    """
    model = instance.model
    frames = link_frames(model.robot, instance.scale, positions, model.path)
    made = []
    for links in bodies(model.robot):
        shapes = sum(len(link.visuals) for link in links), sum(len(link.collisions) for link in links)
        if 0 in shapes:
            what = "visual" if shapes[0] == 0 else "collision"
            raise ValueError(f"{model.path}: the body of link {links[0].name!r} has no {what} mesh")
        made.append(_body(data, assets, instance, frames, links, positions))
    return made


def body_parts(body: Body) -> tuple[PartSpec, ...]:
    """What a body collides with; its slot plays no part, as its mesh is drawn."""
    return tuple(solid_part(solid, slot=0) for solid in body.solids)


def link_solids(data: DataFolder, instance: Instance, link: Link, frame: Frame) -> list[Floats]:
    """Corners of the convex solids of one link in the frame of the base link."""
    beside = f"{instance.model.folder}/{BASE}"
    return [
        solid
        for shape in link.collisions
        for solid in read_solids(
            data, data.beside(beside, shape.file), shape_pose(shape, frame, instance.scale)
        )
    ]


def _body(
    data: DataFolder,
    assets: Assets,
    instance: Instance,
    frames: Mapping[str, Frame],
    links: Sequence[Link],
    positions: Mapping[str, float],
) -> Body:
    key = [
        data.identity,
        instance.model.path,
        instance.scale,
        sorted(positions.items()),
        links[0].name,
        [RECIPE, HEAVY_TRIANGLES, MAX_ERROR_M, MAX_ERROR_SHARE],
    ]
    digest = hashlib.sha256(json.dumps(key).encode()).hexdigest()
    note = assets.folders[0] / "bodies" / f"{digest}.json"
    found = _read_note(note, assets)
    if found is None:
        found = _make_mesh(data, assets, instance, frames, links)
        atomic.write_json(note, found)
    foot, size = (tuple(found[key]) for key in ("foot", "size"))
    solids = [solid for link in links for solid in link_solids(data, instance, link, frames[link.name])]
    return Body(
        root=links[0].name,
        mesh=found["mesh"],
        groups=tuple(found["groups"]),
        foot=foot,
        size=size,
        solids=tuple(solid - foot for solid in solids),
    )


def _make_mesh(
    data: DataFolder,
    assets: Assets,
    instance: Instance,
    frames: Mapping[str, Frame],
    links: Sequence[Link],
) -> dict[str, Any]:
    """What is seen of a body, made one mesh and thinned: its name, groups, foot and size."""
    model = instance.model
    pieces = []
    for link in links:
        for shape in link.visuals:
            slot = instance.slot_of_mesh.get(posixpath.basename(shape.file), OWN)
            path = data.beside(f"{model.folder}/{BASE}", shape.file)
            pieces.append(read_piece(data, path, shape_pose(shape, frames[link.name], instance.scale), slot))
    try:
        piece = joined(pieces)
    except ValueError as error:
        raise ValueError(f"{model.path}: the body of link {links[0].name!r} {error}") from error
    low, high = piece.mesh.vertices.min(axis=0), piece.mesh.vertices.max(axis=0)
    foot = np.array([*(low + high)[:2] / 2, low[2]], np.float64)
    mesh = moved(piece.mesh, Pose(matrix=np.eye(3), offset=-foot))
    size = np.round((high - low).astype(np.float64), 6).tolist()
    if len(mesh.triangles) >= HEAVY_TRIANGLES:
        mesh = decimate(mesh, max_error_m(size))
    return {"mesh": assets.add_mesh(mesh), "groups": list(piece.slots), "foot": foot.tolist(), "size": size}


def _read_note(note: Path, assets: Assets) -> dict[str, Any] | None:
    """What was made before, if all of it is still there."""
    try:
        found = json.loads(note.read_bytes())
        assets.read(f"{found['mesh']}.npz")
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return None
    return found
