"""Triangles are parted between rooms without a change of what they show."""

import numpy as np

from langwm_data.scenes.igibson.meshes import Piece
from langwm_data.scenes.igibson.parting import MIN_EDGE_M, part_by_room
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh


def wall():
    """Two triangles, x 0 to 8 at y 0, 2.4 m high, facing -y; each a group; textures follow x and z."""
    vertices = np.array([(0, 0, 0), (8, 0, 0), (8, 0, 2.4), (0, 0, 0), (8, 0, 2.4), (0, 0, 2.4)], np.float32)
    mesh = TriangleMesh(
        vertices=vertices,
        normals=np.tile(np.float32((0, -1, 0)), (6, 1)),
        uvs=vertices[:, [0, 2]] / 2,
        triangles=np.array([(0, 1, 2), (3, 4, 5)], np.int32),
        sizes=(1, 1),
        materials=(Material(color=(1, 0, 0)), Material(color=(0, 1, 0))),
    )
    return Piece(mesh=mesh, slots=(3, 5))


def rooms_at(points):
    """Room 0 up to x 3, then room 1; only before the wall is there any."""
    assert (points[:, 1] < 0).all()
    return (points[:, 0] >= 3.0).astype(np.int32)


def test_each_room_has_what_lies_before_it():
    parts = part_by_room(wall(), rooms_at)
    assert set(parts) == {0, 1}
    left, right = (parts[n].mesh for n in (0, 1))
    assert left.vertices[:, 0].min() == 0
    assert abs(left.vertices[:, 0].max() - 3.0) <= MIN_EDGE_M
    assert right.vertices[:, 0].max() == 8
    assert abs(right.vertices[:, 0].min() - 3.0) <= MIN_EDGE_M


def test_area_materials_and_texture_stay_what_they_were():
    parts = part_by_room(wall(), rooms_at)
    area = dict.fromkeys((3, 5), 0.0)
    for part in parts.values():
        mesh = part.mesh
        np.testing.assert_allclose(mesh.uvs, mesh.vertices[:, [0, 2]] / 2, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1)
        a, b, c = np.moveaxis(mesh.vertices[mesh.triangles].astype(float), 1, 0)
        cross = np.cross(b - a, c - a)
        assert (cross[:, 1] < 0).all()
        group = mesh.group_of_triangles()
        for number, slot in enumerate(part.slots):
            area[slot] += np.linalg.norm(cross[group == number], axis=1).sum() / 2
            assert mesh.materials[number].color == ((1, 0, 0) if slot == 3 else (0, 1, 0))
    np.testing.assert_allclose([area[3], area[5]], 9.6, rtol=1e-5)


def test_there_is_an_end_to_halving(monkeypatch):
    monkeypatch.setattr("langwm_data.scenes.igibson.parting.MOST_TRIANGLES", 2)
    parts = part_by_room(wall(), lambda points: (points[:, 0] * 1e6).astype(int) % 2)
    assert sum(len(p.mesh.triangles) for p in parts.values()) == 2


def test_what_lies_in_one_room_is_split_no_more_than_its_length_asks():
    parts = part_by_room(wall(), lambda points: np.full(len(points), 4))
    assert list(parts) == [4]
    assert len(parts[4].mesh.triangles) <= 32
