"""Distances between solids against plane geometry."""

import dataclasses
import math

import numpy as np
import pytest

from langwm_data.scenes.spec import IDENTITY, ObjectSpec, PartSpec
from langwm_data.sim.bullet import import_pybullet
from langwm_data.sim.collision import Solids
from langwm_data.sim.mesh import part_mesh

SHAPES = ("box", "cylinder", "ellipsoid", "frustum")


def make_object(instance, position, part, orientation=IDENTITY):
    return ObjectSpec(
        instance=instance,
        category="box",
        model="box_01",
        room="study",
        position=position,
        orientation=orientation,
        size=part.size,
        parts=(part,),
    )


def make_part(shape="box", size=(0.4, 0.4, 0.4), **others):
    return PartSpec(shape=shape, size=size, position=(0.0, 0.0, 0.0), slot=0, **others)


@pytest.fixture
def solids(small_scene):
    """Builds solids from objects alone and closes them at the end."""
    made = []

    def build(*objects):
        made.append(Solids(dataclasses.replace(small_scene, surfaces=(), objects=objects)))
        return made[-1]

    yield build
    for each in made:
        each.close()
        each.close()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("apart", [0.3, 0.01, -0.02])
def test_gap_is_the_distance_along_the_line_of_centres(solids, shape, apart):
    two = solids(
        make_object(1, (0.0, 0.0, 0.0), make_part(shape)),
        make_object(2, (0.4 + apart, 0.0, 0.0), make_part("box")),
    )
    gap = two.gap(0, 1, 1.0)
    # Round hulls lie inside the true shape by up to the chord error of their mesh.
    assert gap.distance == pytest.approx(apart, abs=0.004)
    assert gap.normal == pytest.approx((-1.0, 0.0, 0.0), abs=0.02)


@pytest.mark.parametrize("first", SHAPES)
@pytest.mark.parametrize("second", SHAPES)
def test_normal_points_from_the_second_to_the_first_whatever_the_shapes(solids, first, second):
    two = solids(
        make_object(1, (0.1, 0.0, 0.0), make_part(first)),
        make_object(2, (0.1, 0.5, 0.0), make_part(second)),
    )
    assert two.gap(0, 1, 1.0).normal == pytest.approx((0.0, -1.0, 0.0), abs=0.08)
    assert two.gap(1, 0, 1.0).normal == pytest.approx((0.0, 1.0, 0.0), abs=0.08)


def test_a_cylinder_from_outside_the_scene_is_asked_about_where_it_stands(solids):
    one = solids(make_object(1, (1.0, 0.0, 0.0), make_part()))
    moved = dataclasses.replace(one.cylinder(0.1, 0.4), position=(0.5, 0.0, 0.0))
    gap = one.gap_from(moved, 0, 1.0)
    assert gap.distance == pytest.approx(0.2, abs=1e-6)
    assert gap.normal == pytest.approx((-1.0, 0.0, 0.0), abs=1e-6)


def test_bounds_hold_the_mesh_of_every_shape(solids):
    tilt = (math.sin(0.3), 0.0, 0.0, math.cos(0.3))
    for shape in SHAPES:
        part = make_part(shape, (0.3, 0.2, 0.5), orientation=tilt)
        low, high = solids(make_object(1, (1.0, 2.0, 0.5), part, tilt)).bounds[0]
        vertices = part_mesh(part).transformed((1.0, 2.0, 0.5), tilt).vertices
        assert (vertices >= low - 1e-9).all()
        assert (vertices <= high + 1e-9).all()


def test_all_solids_share_one_client_that_ends_with_the_last(small_scene):
    bullet = import_pybullet()

    def connected():
        return {c for c in range(20) if bullet.isConnected(c)}

    before = connected()
    first, second = Solids(small_scene), Solids(small_scene)
    during = connected()
    first.close()
    first.close()
    assert second.gap(0, 1, 10.0) is not None
    second.close()
    assert len(during) <= len(before) + 1
    assert connected() == before


def test_turned_box_reaches_further(solids):
    eighth = (0.0, 0.0, math.sin(math.pi / 8), math.cos(math.pi / 8))
    two = solids(
        make_object(1, (0.0, 0.0, 0.0), make_part(), eighth), make_object(2, (1.0, 0.0, 0.0), make_part())
    )
    assert two.gap(0, 1, 1.0).distance == pytest.approx(0.8 - 0.2 * math.sqrt(2), abs=1e-3)


def test_parts_stand_where_owner_and_part_poses_put_them(solids):
    quarter = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    part = dataclasses.replace(make_part(size=(0.6, 0.2, 0.2)), position=(1.0, 0.0, 0.5), orientation=quarter)
    one = solids(make_object(1, (3.0, 2.0, 0.0), part, quarter))
    np.testing.assert_allclose(one.bounds[0], [[2.7, 2.9, 0.4], [3.3, 3.1, 0.6]], atol=1e-9)


def test_distant_bodies_have_no_gap_and_are_no_neighbours(solids):
    two = solids(make_object(1, (0.0, 0.0, 0.0), make_part()), make_object(2, (1.0, 0.0, 0.0), make_part()))
    assert two.gap(0, 1, 0.5) is None
    assert list(two.iter_neighbours(0.5)) == []
    assert [(i, j) for i, j, _ in two.iter_neighbours(0.7)] == [(0, 1)]


def test_parts_of_one_instance_are_not_neighbours(solids):
    table = make_object(1, (0.0, 0.0, 0.0), make_part())
    assert list(solids(dataclasses.replace(table, parts=table.parts * 2)).iter_neighbours(0.1)) == []
