"""Triangles of the primitives: closed, outward, of the right volume, with metric texture coordinates."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.scenes.spec import PartSpec
from langwm_data.sim.mesh import Mesh, part_mesh

TURNED = (0.1, -0.3, 0.5, math.sqrt(1 - 0.35))
SHAPES = ["box", "cylinder", "ellipsoid", "frustum"]


def make_part(shape, size=(0.8, 0.5, 0.3), taper=0.6, orientation=TURNED):
    taper = taper if shape == "frustum" else 1.0
    return PartSpec(
        shape=shape, size=size, position=(0.3, -1.0, 2.0), slot=0, orientation=orientation, taper=taper
    )


def corners(mesh: Mesh):
    return mesh.vertices[mesh.triangles]


def volume(mesh: Mesh):
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def true_volume(shape, size, taper):
    x, y, z = size
    area = math.pi * x * y / 4
    return {
        "box": x * y * z,
        "cylinder": area * z,
        "ellipsoid": math.pi * x * y * z / 6,
        "frustum": area * z * (1 + taper + taper**2) / 3,
    }[shape]


@pytest.mark.parametrize("shape", SHAPES)
def test_surface_is_closed(shape):
    mesh = part_mesh(make_part(shape))
    _, points = np.unique(mesh.vertices.round(9), axis=0, return_inverse=True)
    triangles = points.reshape(-1)[mesh.triangles]
    triangles = triangles[[len(set(t)) == 3 for t in triangles.tolist()]]
    edges = [(t[i], t[(i + 1) % 3]) for t in triangles.tolist() for i in range(3)]
    assert len(edges) == len(set(edges))
    assert {(b, a) for a, b in edges} == set(edges)


@settings(max_examples=30, deadline=None)
@given(
    shape=st.sampled_from(SHAPES),
    size=st.tuples(*[st.floats(0.2, 2)] * 3),
    taper=st.sampled_from([0.0, 0.5, 1.0, 1.5]),
)
def test_volume_is_that_of_the_solid(shape, size, taper):
    inside = volume(part_mesh(make_part(shape, size, taper)))
    true = true_volume(shape, size, taper)
    assert 0.88 * true < inside < true * (1 + 1e-9)
    if shape == "box":
        assert inside == pytest.approx(true)


@pytest.mark.parametrize("shape", SHAPES)
def test_normals_are_unit_and_agree_with_the_winding(shape):
    mesh = part_mesh(make_part(shape))
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1)
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    flat = np.cross(b - a, c - a)
    solid = np.linalg.norm(flat, axis=1) > 1e-12
    cosine = np.einsum("tj,tkj->tk", flat, mesh.normals[mesh.triangles])[solid]
    assert (cosine > 0.8 * np.linalg.norm(flat[solid], axis=1)[:, None]).all()


@pytest.mark.parametrize("along_grain", [False, True])
@pytest.mark.parametrize("shape", ["box", "cylinder"])
def test_texture_coordinates_are_metres_and_not_mirrored(shape, along_grain):
    # One metre on the surface is one unit of uv, and u x v points outwards.
    mesh = part_mesh(make_part(shape, (0.5, 0.5, 0.9)), along_grain=along_grain)
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    ua, ub, uc = np.moveaxis(mesh.uvs[mesh.triangles], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    e, f = ub - ua, uc - ua
    np.testing.assert_allclose(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0], area, rtol=0.02)


def test_grain_runs_along_the_longer_side_and_bricks_lie_flat():
    plank = make_part("box", (0.1, 0.2, 2.0), orientation=(0.0, 0.0, 0.0, 1.0))
    for along_grain, axis in [(True, 0), (False, 1)]:
        mesh = part_mesh(plank, along_grain=along_grain)
        upright = np.abs(mesh.normals[:, 2]) < 0.5
        assert np.ptp(mesh.uvs[upright, axis]) == pytest.approx(2.0)


def test_texture_runs_on_across_coplanar_pieces():
    pieces = [
        PartSpec(shape="box", size=(1, 0.1, 1), position=(x, 0.0, z), slot=0)
        for x, z in [(0.5, 0.5), (1.5, 1.5)]
    ]
    for mesh in map(part_mesh, pieces):
        front = mesh.normals[:, 1] < -0.5
        np.testing.assert_allclose(mesh.uvs[front], mesh.vertices[front][:, [0, 2]])


@pytest.mark.parametrize("shape", SHAPES)
def test_faces_are_convex_and_numbered_from_zero(shape):
    mesh = part_mesh(make_part(shape))
    assert np.unique(mesh.faces).tolist() == list(range(mesh.num_faces))
    assert mesh.num_faces == {"box": 6, "cylinder": 3, "frustum": 3, "ellipsoid": 1}[shape]
    for face in range(mesh.num_faces):
        own = mesh.triangles[(mesh.faces[mesh.triangles] == face).all(axis=1)]
        a, b, c = np.moveaxis(mesh.vertices[own], 1, 0)
        # No vertex of the face lies outside of the plane of any of its triangles.
        height = np.einsum(
            "tj,tvj->tv", np.cross(b - a, c - a), mesh.vertices[mesh.faces == face] - a[:, None]
        )
        assert height.max() < 1e-9


def test_groups_hold_every_instance_and_slot_once(small_scene, scene_groups):
    groups = scene_groups(small_scene)
    keys = [(g.instance, g.slot) for g in groups]
    assert keys == sorted(set(keys))
    assert set(keys) == {(i, p.slot) for i, _, _, p in small_scene.iter_parts()}


def test_groups_stand_in_world_coordinates(small_scene, scene_groups):
    (cabinet,) = [g.mesh for g in scene_groups(small_scene) if g.instance == 33]
    np.testing.assert_allclose(cabinet.vertices.min(axis=0), (5.65, 1.05, 0.0), atol=1e-9)
    np.testing.assert_allclose(cabinet.vertices.max(axis=0), (6.05, 1.95, 1.2), atol=1e-9)
