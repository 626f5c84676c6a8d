"""Procedural homes: from the name of a floor and a seed to a scene.

Owns the order of the work and the materials that things may be made of. Loose objects hang a few
millimetres above what they will rest on until a simulator settles them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from langwm_data.scenes.assets import Assets, cache_folder
from langwm_data.scenes.catalogue.offer import Furniture, Offer
from langwm_data.scenes.floorplan import sample_plan
from langwm_data.scenes.furnishing.fittings import dress_windows, fill_openings
from langwm_data.scenes.furnishing.kitchen import furnish_kitchen
from langwm_data.scenes.furnishing.living import furnish_dining_room, furnish_living_room
from langwm_data.scenes.furnishing.piece import Placement
from langwm_data.scenes.furnishing.placement import RoomState
from langwm_data.scenes.furnishing.private import furnish_bathroom, furnish_bedroom, furnish_study
from langwm_data.scenes.furnishing.service import furnish_hallway, furnish_playroom, furnish_storage_room
from langwm_data.scenes.furnishing.style import HomeStyle, sample_style
from langwm_data.scenes.layouts import PlanKind
from langwm_data.scenes.plan import FloorPlan
from langwm_data.scenes.spec import (
    OWN,
    DoorwaySpec,
    MaterialSlot,
    ModelRecord,
    ObjectSpec,
    PartSpec,
    SceneSpec,
    Split,
    SurfaceKind,
    SurfaceSpec,
)
from langwm_data.scenes.splits import BUILDINGS, EVERYTHING, HeldOut, sample_palette, side_of, split_of_scene
from langwm_data.scenes.walls import room_pieces
from langwm_data.seeding import make_rng

_DRY_WALLS = ("paint", "paint", "plaster", "plaster", "bricks", "concrete", "planks")
_WET_WALLS = ("tiles", "tiles", "paint", "marble", "terrazzo")
_DRY_FLOORS = ("wood_floor", "wood_floor", "planks", "fabric_carpet", "marble", "terrazzo")
_WET_FLOORS = ("tiles", "tiles", "terrazzo", "marble")
_HARD_FLOORS = ("tiles", "concrete", "paving_stones", "wood_floor", "asphalt")
_CEILINGS = ("plaster", "paint")

_WALLS: Mapping[str, tuple[str, ...]] = {"bathroom": _WET_WALLS, "kitchen": ("paint", "plaster", "tiles")}
_FLOORS: Mapping[str, tuple[str, ...]] = {
    "bathroom": _WET_FLOORS,
    "kitchen": (*_WET_FLOORS, "wood_floor"),
    "hallway": ("wood_floor", "tiles", "paving_stones", "marble"),
    "storage_room": _HARD_FLOORS,
}


def scene_names(split: Split | None = None) -> tuple[str, ...]:
    """Names of all floors, or of those of one split: ``<building>_<floor>``."""
    return tuple(
        f"{name}_{floor}"
        for name, building in BUILDINGS.items()
        if split in (None, building.split)
        for floor in range(building.floors)
    )


class Homes:
    """The procedural homes of one seed as a source of scenes, some with furniture from catalogues."""

    is_at_rest = False

    def __init__(
        self, seed: int, furniture: Path | None = None, holds_out: Sequence[HeldOut] = EVERYTHING
    ) -> None:
        """Homes of a seed; no floor is made yet.

        Args:
            seed: Of plans, furnishing and palettes.
            furniture: Folder of Sweet Home 3D catalogues.
            holds_out: What floors for test do not share with those for training. Without buildings, all
                floors that there are for training are for test as well, and are made for test.

        Raises:
            ValueError: If there is no catalogue in that folder, or one is damaged.
        """
        self.assets = Assets(*(() if furniture is None else (cache_folder(),)))
        self._furniture = None if furniture is None else Furniture(furniture, cache_folder())
        self.identity: Mapping[str, str] = (
            {} if self._furniture is None else {"furniture": self._furniture.identity}
        )
        self._seed, self._holds_out = seed, tuple(holds_out)

    def names(self, split: Split | None = None) -> tuple[str, ...]:
        """Names of all floors, or of those of one split."""
        return scene_names(split and side_of(split, "buildings", self._holds_out))

    def make(self, name: str) -> SceneSpec:
        """One floor.

        Raises:
            ValueError: If there is no floor of that name, or a catalogue is damaged.
        """
        return make_home(name, seed=self._seed, furniture=self._furniture, holds_out=self._holds_out)


def make_home(
    name: str, *, seed: int, furniture: Furniture | None = None, holds_out: Sequence[HeldOut] = EVERYTHING
) -> SceneSpec:
    """The floor called ``name``: rooms, furniture, and a palette drawn for its own split.

    The same name, seed, catalogues and ``holds_out`` give the same scene. Loose objects are not settled yet.

    Raises:
        ValueError: If there is no floor of that name.
    """
    split = split_of_scene(name) if "buildings" in holds_out else "test"
    building, _, number = name.rpartition("_")
    floor = int(number)
    offer = (
        None if furniture is None else Offer(furniture, side_of(split, "models", holds_out), seed, building)
    )
    style = sample_style(seed, building, offer)
    plan = sample_plan(make_rng(seed, "plan", name), plan_kind(seed, building, floor))
    placements = _furnish(plan, style, seed, name)
    slots = _Slots()
    surfaces = _surfaces(plan, style.height_m, slots)
    objects = _objects(placements, slots, first=1 + len({s.instance for s in surfaces}))
    return SceneSpec(
        name=name,
        building=building,
        floor=floor,
        split=split,
        height_m=style.height_m,
        rooms=plan.rooms,
        doorways=tuple(
            DoorwaySpec(rooms=(o.rooms[0], o.rooms[1]), center=o.center, width=o.clear_width)
            for o in plan.openings
            if len(o.rooms) == 2
        ),
        surfaces=tuple(surfaces),
        objects=tuple(objects),
        slots=tuple(slots.slots),
        palette=sample_palette(
            make_rng(seed, "palette", name), slots.slots, side_of(split, "textures", holds_out)
        ),
        models=_records(placements),
    )


def plan_kind(seed: int, building: str, floor: int) -> PlanKind:
    """What a floor is: a whole flat, or the ground, an upper or the top floor of a house."""
    floors = BUILDINGS[building].floors
    is_house = floors > 1 and bool(make_rng(seed, "kind", building).random() < 0.75)
    if not is_house:
        return "flat"
    if floor == 0:
        return "ground"
    return "attic" if floor == floors - 1 and floors > 2 else "upper"


def _furnish(plan: FloorPlan, style: HomeStyle, seed: int, name: str) -> list[Placement]:
    states = {
        room.name: RoomState(room, style.height_m, style, make_rng(seed, "room", name, room.name))
        for room in plan.rooms
    }
    fill_openings(plan, states)
    # The dining table goes to the first of these rooms that has a place for it.
    table_order = {"dining_room": 0, "kitchen": 1}
    has_table = False
    for state in sorted(states.values(), key=lambda s: table_order.get(s.room.kind, 2)):
        dress_windows(plan, state)
        _furnish_room(state, has_dining=not has_table)
        has_table = has_table or bool(state.of_category("dining_table"))
    return [placement for state in states.values() for placement in state.placements]


def _furnish_room(state: RoomState, *, has_dining: bool) -> None:
    match state.room.kind:
        case "living_room":
            furnish_living_room(state, has_dining=has_dining)
        case "kitchen":
            furnish_kitchen(state, has_dining=has_dining)
        case "dining_room":
            furnish_dining_room(state)
        case "bedroom":
            furnish_bedroom(state)
        case "bathroom":
            furnish_bathroom(state)
        case "study":
            furnish_study(state)
        case "hallway":
            furnish_hallway(state)
        case "playroom":
            furnish_playroom(state)
        case "storage_room":
            furnish_storage_room(state)
        case kind:
            raise AssertionError(f"no furnishing for {kind}")


class _Slots:
    """Material slots of a scene; pieces of one model share theirs."""

    def __init__(self) -> None:
        self.slots: list[MaterialSlot] = []
        self._index: dict[str, int] = {}

    def get(self, name: str, categories: Sequence[str]) -> int:
        if name not in self._index:
            self._index[name] = len(self.slots)
            self.slots.append(MaterialSlot(name=name, categories=tuple(categories)))
        return self._index[name]


def _surfaces(plan: FloorPlan, height_m: float, slots: _Slots) -> list[SurfaceSpec]:
    surfaces = []
    kinds: tuple[SurfaceKind, ...] = ("wall", "floor", "ceiling")
    for number, room in enumerate(plan.rooms):
        materials = {
            "wall": _WALLS.get(room.kind, _DRY_WALLS),
            "floor": _FLOORS.get(room.kind, _DRY_FLOORS),
            "ceiling": _CEILINGS,
        }
        for piece in room_pieces(plan, room, height_m):
            slot = slots.get(f"{room.name}/{piece.kind}", materials[piece.kind])
            instance = 1 + 3 * number + kinds.index(piece.kind)
            surfaces.append(
                SurfaceSpec(instance=instance, kind=piece.kind, room=room.name, part=piece.part(slot))
            )
    return surfaces


def _objects(placements: Sequence[Placement], slots: _Slots, *, first: int) -> list[ObjectSpec]:
    return [
        ObjectSpec(
            instance=first + i,
            category=p.model.category,
            model=p.model.name,
            room=p.room,
            position=p.position,
            orientation=p.orientation,
            size=p.model.size,
            parts=tuple(_with_slot(p, part, slots) for part in p.model.parts),
            is_fixed=p.is_fixed,
            mesh=p.model.mesh,
            phrase=p.model.phrase,
        )
        for i, p in enumerate(placements)
    ]


def _records(placements: Sequence[Placement]) -> tuple[ModelRecord, ...]:
    records = {p.model.record for p in placements if p.model.record is not None}
    return tuple(sorted(records, key=lambda record: record.model))


_SHARED = ("kitchen_cabinet", "kitchen_sink", "dishwasher", "wall_cabinet")
"""Categories whose fronts and worktops match throughout a kitchen."""
_MATCHED_SLOTS = ("cabinet", "worktop", "handle")
_WHOLE_FLOOR = ("door", "door_frame", "window", "radiator")
"""Categories that look the same in all rooms."""


def _with_slot(p: Placement, part: PartSpec, slots: _Slots) -> PartSpec:
    if part.slot == OWN:
        return part
    slot = p.model.slots[part.slot]
    if p.model.category in _SHARED and slot.name in _MATCHED_SLOTS:
        name = f"{p.room}/counters/{slot.name}"
    elif p.model.category in _WHOLE_FLOOR:
        name = f"{p.model.category}/{slot.name}"
    else:
        name = f"{p.model.name}/{slot.name}"
    index = slots.get(name, slot.categories)
    return replace(part, slot=index)
