"""Scenes small enough to reason about by hand, and a cache that no other run has filled."""

import os
import shutil
import tempfile

import pytest
from hypothesis import HealthCheck, settings

from langwm_data.scenes.spec import (
    DoorwaySpec,
    MaterialRef,
    MaterialSlot,
    ObjectSpec,
    PartSpec,
    RoomSpec,
    SceneSpec,
    SurfaceSpec,
)

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")

WALL, FLOOR, CEILING, WOOD, CLOTH, STEEL = range(6)
LEVEL = (0.0, 0.0, 0.0, 1.0)
HEIGHT, THICK = 2.6, 0.1
SLOTS = (
    MaterialSlot(name="wall", categories=("paint", "plaster", "bricks")),
    MaterialSlot(name="floor", categories=("wood_floor", "tiles")),
    MaterialSlot(name="ceiling", categories=("paint", "plaster")),
    MaterialSlot(name="furniture", categories=("wood", "planks")),
    MaterialSlot(name="upholstery", categories=("fabric", "leather")),
    MaterialSlot(name="metal parts", categories=("metal",)),
)
PALETTE = ("plaster/01", "wood_floor/01", "paint/01", "wood/01", "fabric/04", "metal/01")


def part(shape, size, position, slot, **others):
    return PartSpec(shape=shape, size=size, position=position, slot=slot, **others)


def box_between(low, high, slot):
    size = tuple(b - a for a, b in zip(low, high, strict=True))
    return part("box", size, tuple((a + b) / 2 for a, b in zip(low, high, strict=True)), slot)


def make_surfaces():
    """Two rooms, study 4 m x 3 m and hall 2 m x 3 m, with a door 0.9 m wide between them."""
    h = HEIGHT
    walls = {
        10: [
            ((-THICK, -THICK, 0), (4.05, 0, h)),
            ((-THICK, 3, 0), (4.05, 3 + THICK, h)),
            ((-THICK, 0, 0), (0, 3, h)),
            ((4.0, 0, 0), (4.05, 1.0, h)),
            ((4.0, 1.9, 0), (4.05, 3, h)),
            ((4.0, 1.0, 2.05), (4.05, 1.9, h)),
        ],
        20: [
            ((4.05, -THICK, 0), (6.2, 0, h)),
            ((4.05, 3, 0), (6.2, 3 + THICK, h)),
            ((6.1, 0, 0), (6.2, 3, h)),
            ((4.05, 0, 0), (4.1, 1.0, h)),
            ((4.05, 1.9, 0), (4.1, 3, h)),
            ((4.05, 1.0, 2.05), (4.1, 1.9, h)),
        ],
    }
    flat = {10: ((-THICK, -THICK), (4.05, 3 + THICK)), 20: ((4.05, -THICK), (6.2, 3 + THICK))}
    surfaces = []
    for first, room in ((10, "study"), (20, "hall")):
        for low, high in walls[first]:
            surfaces.append(
                SurfaceSpec(instance=first, kind="wall", room=room, part=box_between(low, high, WALL))
            )
        (x0, y0), (x1, y1) = flat[first]
        floor = box_between((x0, y0, -THICK), (x1, y1, 0), FLOOR)
        ceiling = box_between((x0, y0, h), (x1, y1, h + THICK), CEILING)
        surfaces.append(SurfaceSpec(instance=first + 1, kind="floor", room=room, part=floor))
        surfaces.append(SurfaceSpec(instance=first + 2, kind="ceiling", room=room, part=ceiling))
    return tuple(surfaces)


def make_object(instance, category, position, size, parts, **others):
    values = {"model": f"{category}_01", "room": "study", "orientation": LEVEL} | others
    return ObjectSpec(
        instance=instance, category=category, position=position, size=size, parts=tuple(parts), **values
    )


def make_objects():
    """A table with a box and a bowl just above it, a stool, a floor lamp; in the hall a turned cabinet."""
    legs = [
        part("cylinder", (0.06, 0.06, 0.7), (x, y, 0.35), STEEL) for x in (-0.45, 0.45) for y in (-0.25, 0.25)
    ]
    table = [part("box", (1.0, 0.6, 0.04), (0, 0, 0.72), WOOD), *legs]
    stool = [
        part("cylinder", (0.36, 0.36, 0.06), (0, 0, 0.42), CLOTH),
        part("frustum", (0.3, 0.3, 0.39), (0, 0, 0.195), WOOD, taper=0.5),
    ]
    lamp = [
        part("cylinder", (0.3, 0.3, 0.03), (0, 0, 0.015), STEEL),
        part("cylinder", (0.03, 0.03, 1.3), (0, 0, 0.68), STEEL),
        part("frustum", (0.4, 0.4, 0.3), (0, 0, 1.45), CLOTH, taper=0.6),
    ]
    quarter = (0.0, 0.0, 0.5**0.5, 0.5**0.5)
    return (
        make_object(30, "dining_table", (1.0, 2.4, 0.0), (1.0, 0.6, 0.74), table),
        make_object(31, "stool", (2.2, 0.9, 0.0), (0.36, 0.36, 0.45), stool),
        make_object(32, "floor_lamp", (0.4, 0.4, 0.0), (0.4, 0.4, 1.6), lamp),
        make_object(
            33,
            "kitchen_cabinet",
            (5.85, 1.5, 0.0),
            (0.9, 0.4, 1.2),
            [part("box", (0.9, 0.4, 1.2), (0, 0, 0.6), WOOD)],
            room="hall",
            orientation=quarter,
        ),
        make_object(
            34,
            "cardboard_box",
            (0.8, 2.4, 0.78),
            (0.3, 0.2, 0.15),
            [part("box", (0.3, 0.2, 0.15), (0, 0, 0.075), CLOTH)],
            is_fixed=False,
        ),
        make_object(
            35,
            "bowl",
            (1.2, 2.4, 0.76),
            (0.24, 0.24, 0.1),
            [part("frustum", (0.24, 0.24, 0.1), (0, 0, 0.05), STEEL, taper=0.6)],
            is_fixed=False,
        ),
    )


def make_small_scene():
    """A furnished study and a hall of one training floor, not yet settled."""
    return SceneSpec(
        name="Alder_0",
        building="Alder",
        floor=0,
        split="train",
        height_m=HEIGHT,
        rooms=(
            RoomSpec(name="study", kind="study", rect=(0.0, 0.0, 4.0, 3.0)),
            RoomSpec(name="hall", kind="hall", rect=(4.1, 0.0, 6.1, 3.0)),
        ),
        doorways=(DoorwaySpec(rooms=("study", "hall"), center=(4.05, 1.45), width=0.9),),
        surfaces=make_surfaces(),
        objects=make_objects(),
        slots=SLOTS,
        palette=tuple(MaterialRef.parse(p) for p in PALETTE),
    )


def pytest_configure(config):
    """Textures and meshes that are kept between runs are kept for this run alone."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        config.cache_before = os.environ.get("XDG_CACHE_HOME")
        os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="langwm-cache-")


def pytest_unconfigure(config):
    """Forget them."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        shutil.rmtree(os.environ.pop("XDG_CACHE_HOME"), ignore_errors=True)
        if config.cache_before is not None:
            os.environ["XDG_CACHE_HOME"] = config.cache_before


@pytest.fixture(scope="session")
def small_scene() -> SceneSpec:
    """Two rooms joined by a door, four fixed objects, two loose ones. Frozen, so shared by all tests."""
    return make_small_scene()
