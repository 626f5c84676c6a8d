from itertools import combinations

import numpy as np
import pytest

from langwm_data.scenes.floorplan import sample_plan
from langwm_data.scenes.geometry import rects_overlap
from langwm_data.scenes.layouts import LIMITS, PUBLIC
from langwm_data.scenes.plan import cell_of
from langwm_data.scenes.walls import room_pieces

PLANS = [
    sample_plan(np.random.default_rng(seed), kind)
    for kind in ("flat", "ground", "upper", "attic")
    for seed in range(6)
]


def area(rect):
    return (rect[2] - rect[0]) * (rect[3] - rect[1])


@pytest.mark.parametrize("plan", PLANS)
def test_cells_tile_the_floor(plan):
    cells = [cell_of(r) for r in plan.rooms]
    assert sum(map(area, cells)) == pytest.approx(area(plan.extent), rel=1e-3)
    assert not any(rects_overlap(a, b, -0.002) for a, b in combinations(cells, 2))


@pytest.mark.parametrize("plan", PLANS)
def test_every_room_hangs_on_a_public_one(plan):
    kinds = {r.name: r.kind for r in plan.rooms}
    doorways = [o for o in plan.openings if len(o.rooms) == 2]
    assert {name for o in doorways for name in o.rooms} == set(kinds)
    assert all({kinds[n] for n in o.rooms} & set(PUBLIC) for o in doorways)


@pytest.mark.parametrize("plan", PLANS)
def test_rooms_are_large_enough_and_doorways_wide_enough(plan):
    for room in plan.rooms:
        sides = (room.rect[2] - room.rect[0], room.rect[3] - room.rect[1])
        assert min(sides) >= (LIMITS[room.kind].min_side_m if room.kind in LIMITS else 1.2) - 0.01
    assert all(o.clear_width >= 0.9 for o in plan.openings if len(o.rooms) == 2)
    assert 4 <= len(plan.rooms) <= 8
    assert 45 <= sum(area(r.rect) for r in plan.rooms) <= 120


@pytest.mark.parametrize("plan", PLANS)
def test_holes_of_one_wall_do_not_meet(plan):
    for a, b in combinations(plan.openings, 2):
        across = 1 if a.along == "x" else 0
        if a.along == b.along and abs(a.center[across] - b.center[across]) < 1e-6:
            assert a.interval[1] < b.interval[0] or b.interval[1] < a.interval[0]


def test_walls_close_everything_but_the_holes():
    plan = PLANS[0]
    pieces = [p for room in plan.rooms for p in room_pieces(plan, room, 2.5)]
    walls = [p for p in pieces if p.kind == "wall"]
    volume = sum(np.prod(np.subtract(p.high, p.low)) for p in walls)
    outer = (plan.extent[2] - plan.extent[0] + 0.1) * (plan.extent[3] - plan.extent[1] + 0.1)
    solid = 2.5 * (outer - sum(area(r.rect) for r in plan.rooms))
    holes = sum(0.1 * o.width * (o.z[1] - o.z[0]) for o in plan.openings)
    assert volume == pytest.approx(solid - holes, rel=1e-6)


def test_the_same_generator_gives_the_same_plan_and_others_differ():
    first, again, other = (sample_plan(np.random.default_rng(s), "flat") for s in (3, 3, 4))
    assert first == again != other
