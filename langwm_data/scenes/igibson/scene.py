"""A scene of iGibson as a ``SceneSpec``: structure, objects, doors opened, maps, materials."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from langwm_data.scenes.assets import Assets
from langwm_data.scenes.igibson.categories import OURS, our_category, phrase_of
from langwm_data.scenes.igibson.doors import Outline, open_positions, outline
from langwm_data.scenes.igibson.files import DataFolder, plain_name
from langwm_data.scenes.igibson.maps import RoomMap, read_floor_map, read_rooms
from langwm_data.scenes.igibson.materials import Materials
from langwm_data.scenes.igibson.meshes import Floats
from langwm_data.scenes.igibson.models import BASE, read_model
from langwm_data.scenes.igibson.objects import Body, Instance, body_parts, make_bodies, make_instance
from langwm_data.scenes.igibson.structure import KINDS, Structure, read_structure, surfaces_of
from langwm_data.scenes.igibson.urdf import Placed, parse_scene
from langwm_data.scenes.spec import (
    OWN,
    MaterialRef,
    MaterialSlot,
    MeshSpec,
    ModelRecord,
    ObjectSpec,
    SceneSpec,
    SurfaceSpec,
)
from langwm_data.scenes.splits import IGIBSON_BUILDINGS, sample_palette, split_of_scene
from langwm_data.scenes.taxonomy import UNKNOWN, phrase
from langwm_data.seeding import make_rng

LICENCE = "iGibson dataset licence"
AUTHOR = "iGibson, Stanford Vision and Learning Lab, after ShapeNet, PartNet-Mobility and others"
SOURCE = "iGibson 1.0 dataset"

MAX_INSTANCES = 60_000
"""Instance masks have sixteen bits."""

_DOOR = "door"

_logger = logging.getLogger(__name__)


@dataclass(kw_only=True)
class _Slots:
    """Material slots of a scene, in the order in which they are asked for."""

    slots: list[MaterialSlot] = field(default_factory=list)

    def add(self, owner: str, groups: Mapping[str, tuple[str, ...]]) -> int:
        """A slot for each material group of an owner; the index of the first."""
        first = len(self.slots)
        self.slots += [MaterialSlot(name=f"{owner}/{g}", categories=classes) for g, classes in groups.items()]
        return first


@dataclass(frozen=True, kw_only=True)
class Copy:
    """Somebody's copy of the dataset, and where what is made of it is kept."""

    data: DataFolder
    materials: Materials
    room_kinds: tuple[str, ...]
    assets: Assets
    seed: int
    """Draws models where a scene leaves them open, and the materials of its first palette."""


def make_scene(copy: Copy, name: str, folder: str) -> SceneSpec:
    """The floor called ``name``, whose files lie in ``folder`` of the dataset.

    Raises:
        ValueError: If something that it needs is missing or damaged.
    """
    data = copy.data
    scene_id = folder.rpartition("/")[2]
    path = f"{folder}/urdf/{scene_id}_best.urdf"
    everything = parse_scene(data.read(path), path)
    rooms = read_rooms(data, f"{folder}/layout", copy.room_kinds)
    slots = _Slots()
    structures = [_structure(data, folder, path, everything, category) for category in KINDS]
    surfaces: list[SurfaceSpec] = []
    for structure in structures:
        first = slots.add(structure.kind, structure.slots)
        surfaces += surfaces_of(structure, rooms, first, copy.assets)
    instances = [_instance(copy, name, path, placed) for placed in everything if placed.category not in KINDS]
    _warn_of_unknown(name, instances)
    objects = _objects(copy, instances, structures, rooms, slots)
    pictures = _pictures(copy, path, slots.slots)
    building, _, number = name.rpartition("_")
    split = split_of_scene(name, IGIBSON_BUILDINGS)
    rng = make_rng(copy.seed, "palette", name)
    return SceneSpec(
        name=name,
        building=building,
        floor=int(number),
        split=split,
        height_m=_height_m(structures),
        rooms=rooms.rooms,
        doorways=(),
        surfaces=tuple(surfaces),
        objects=tuple(objects),
        slots=tuple(slots.slots),
        palette=sample_palette(rng, slots.slots, split, pictures),
        pictures=pictures,
        models=_records(objects),
        floor_map=read_floor_map(data, f"{folder}/layout"),
    )


def _structure(
    data: DataFolder, folder: str, path: str, everything: Iterable[Placed], category: str
) -> Structure:
    placed = [p for p in everything if p.category == category]
    if len(placed) != 1:
        raise ValueError(f"{path}: {len(placed)} links of category {category!r}; allowed: one")
    plain_name(placed[0].model, path)
    return read_structure(data, folder, placed[0])


def _pictures(copy: Copy, path: str, slots: Sequence[MaterialSlot]) -> tuple[MaterialRef, ...]:
    """All that the slots may wear."""
    for slot in slots:
        for category in slot.categories:
            copy.materials.check(category, f"{path}: {slot.name}")
    return copy.materials.pictures({c for slot in slots for c in slot.categories}, copy.assets)


def _instance(copy: Copy, scene: str, path: str, placed: Placed) -> Instance:
    category = plain_name(placed.category, path)
    model = placed.model
    if model == "random":
        names = copy.data.folders(f"objects/{category}")
        if not names:
            raise ValueError(f"objects/{category}: no model in it, and {path} leaves {placed.name!r} open")
        group = placed.random_group or placed.name
        rng = make_rng(
            copy.seed, "model", scene, category, "group" if placed.random_group else "alone", group
        )
        model = names[rng.integers(len(names))]
    plain_name(model, path)
    return make_instance(copy.data, placed, read_model(copy.data, category, model))


def _objects(
    copy: Copy,
    instances: Sequence[Instance],
    structures: Sequence[Structure],
    rooms: RoomMap,
    slots: _Slots,
) -> list[ObjectSpec]:
    """All objects, doors last but in their places: they open as far as everything else lets them."""
    bodies: dict[str, list[Body]] = {}
    around = [outline(solid) for s in structures if s.kind == "wall" for solid in s.solids]
    for instance in sorted(instances, key=lambda i: i.placed.category == _DOOR):
        is_door = instance.placed.category == _DOOR
        positions = open_positions(copy.data, instance, around) if is_door else {}
        made = make_bodies(copy.data, copy.assets, instance, positions)
        bodies[instance.placed.name] = made
        around += [_outline(instance, body, solid) for body in made for solid in body.solids]
    objects: list[ObjectSpec] = []
    next_instance = 1 + len(KINDS) * len(rooms.rooms)
    for instance in instances:
        first = slots.add(instance.placed.name, instance.slots)
        for body in bodies[instance.placed.name]:
            objects.append(_object(instance, body, rooms, first, next_instance + len(objects)))
    if next_instance + len(objects) > MAX_INSTANCES:
        raise ValueError(
            f"{len(objects)} objects in {len(rooms.rooms)} rooms; at most {MAX_INSTANCES} can be told apart"
        )
    return objects


def _outline(instance: Instance, body: Body, solid: Floats) -> Outline:
    return outline(instance.to_world(solid + body.foot))


def _object(instance: Instance, body: Body, rooms: RoomMap, first_slot: int, number: int) -> ObjectSpec:
    placed, model = instance.placed, instance.model
    category, noun = our_category(placed.category), phrase_of(placed.category)
    foot = instance.to_world(np.array([body.foot]))
    x, y, z = foot[0].tolist()
    known = {room.name for room in rooms.rooms}
    there = rooms.rooms[int(rooms.rooms_at(foot[:, :2])[0])].name
    name = f"{placed.category}/{model.folder.rpartition('/')[2]}"
    return ObjectSpec(
        instance=number,
        category=category,
        model=name if body.root == BASE else f"{name}/{body.root}",
        room=next((room for room in placed.rooms if room in known), there),
        position=(x, y, z),
        orientation=instance.orientation,
        size=body.size,
        parts=body_parts(body),
        mesh=MeshSpec(
            name=body.mesh, slots=tuple(OWN if slot == OWN else first_slot + slot for slot in body.groups)
        ),
        phrase="" if noun == phrase(category) else noun,
    )


def _height_m(structures: Sequence[Structure]) -> float:
    """Where the ceilings are lowest."""
    (ceilings,) = (s for s in structures if s.kind == "ceiling")
    return round(float(ceilings.piece.mesh.vertices[:, 2].min()), 4)


def _records(objects: Sequence[ObjectSpec]) -> tuple[ModelRecord, ...]:
    return tuple(
        ModelRecord(model=model, split="train", name=model, author=AUTHOR, licence=LICENCE, source=SOURCE)
        for model in sorted({obj.model for obj in objects})
    )


def _warn_of_unknown(name: str, instances: Sequence[Instance]) -> None:
    unknown = sorted({i.placed.category for i in instances} - set(OURS))
    if unknown:
        _logger.warning(
            "scene %s: categories %s are in no table; they count as %r, captions call them by their names",
            name,
            ", ".join(unknown),
            UNKNOWN,
        )
