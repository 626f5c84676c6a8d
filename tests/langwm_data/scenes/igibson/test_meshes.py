"""Meshes of the dataset keep their shape, their texture coordinates and the way up of their textures."""

import cv2
import numpy as np
import pytest

from langwm_data.scenes.igibson.files import DataFolder
from langwm_data.scenes.igibson.meshes import Pose, cut, joined, moved, read_piece, read_solids, solid_part
from langwm_data.scenes.spec import OWN

HERE = Pose(matrix=np.eye(3), offset=np.zeros(3))
CHAIR = "objects/chair/chair_a"


@pytest.fixture
def data(dataset):
    return DataFolder(dataset.root)


def visual(model="objects/chair/chair_a", file="link_0_m0_vm.obj"):
    return f"{model}/shape/visual/{file}"


def test_an_own_texture_is_read_the_right_way_up(data):
    piece = read_piece(data, visual(), HERE, OWN)
    assert piece.slots == (OWN,)
    (material,) = piece.mesh.materials
    assert material.texture is not None
    picture = cv2.imdecode(np.frombuffer(material.texture, np.uint8), cv2.IMREAD_COLOR_RGB)
    assert picture[0, 8].tolist() == [230, 210, 20]
    assert picture[15, 8].tolist() == [20, 20, 120]
    # v runs upwards with z on the sides of the box.
    is_side = np.abs(piece.mesh.normals[:, 2]) < 0.5
    low = piece.mesh.vertices[:, 2] < 0.1
    assert np.all(piece.mesh.uvs[is_side & low, 1] == 0)


def test_what_wears_a_slot_keeps_its_texture_coordinates_and_needs_no_material_file(dataset, data):
    (dataset.root / CHAIR / "shape/visual/default.mtl").unlink()
    piece = read_piece(data, visual(), HERE, 4)
    assert piece.slots == (4,)
    assert piece.mesh.uvs.max() == 1
    with pytest.raises(ValueError, match=r"chair_a/shape/visual/default\.mtl: no such file"):
        read_piece(data, visual(), HERE, OWN)


def test_what_wears_a_slot_without_texture_coordinates_gets_metres(dataset, data):
    place = dataset.root / visual()
    text = "\n".join(
        " ".join(w.split("/")[0] for w in line.split()) for line in place.read_text().splitlines()
    )
    place.write_text("\n".join(line for line in text.splitlines() if not line.startswith("vt")))
    mesh = read_piece(data, visual(), HERE, 0).mesh
    is_front = mesh.normals[:, 1] < -0.5
    np.testing.assert_allclose(mesh.uvs[is_front], mesh.vertices[is_front][:, [0, 2]])
    is_top = mesh.normals[:, 2] > 0.5
    np.testing.assert_allclose(mesh.uvs[is_top], mesh.vertices[is_top][:, :2])


def test_textures_outside_of_the_dataset_are_refused(dataset, data):
    dataset.text(f"{CHAIR}/shape/visual/default.mtl", "newmtl default\nmap_Kd ../../../../../../x.png\n")
    with pytest.raises(ValueError, match=r"default\.mtl: names '\.\./.*', which leads out of the dataset"):
        read_piece(data, visual(), HERE, OWN)


def test_a_pose_keeps_normals_at_right_angles_and_the_outside_outside(data):
    mesh = read_piece(data, visual(), HERE, OWN).mesh
    for matrix in (np.diag([1.0, 3.0, 0.5]), np.diag([-1.0, 1.0, 1.0])):
        other = moved(mesh, Pose(matrix=matrix, offset=np.array([1.0, 2.0, 3.0])))
        np.testing.assert_allclose(other.vertices, mesh.vertices @ matrix.T + (1, 2, 3), rtol=1e-5)
        a, b, c = np.moveaxis(other.vertices[other.triangles], 1, 0)
        faces = np.cross(b - a, c - a)
        faces /= np.linalg.norm(faces, axis=1, keepdims=True)
        np.testing.assert_allclose(other.normals[other.triangles[:, 0]], faces, atol=1e-5)


def test_groups_of_one_slot_become_one(data):
    top, legs = (visual("objects/table/table_a", f"link_0_m{i}_vm.obj") for i in (0, 1))
    pieces = [read_piece(data, top, HERE, 0), read_piece(data, legs, HERE, 1), read_piece(data, top, HERE, 0)]
    whole = joined(pieces)
    assert whole.slots == (0, 1)
    assert whole.mesh.sizes == (24, 48)
    areas = [_area(p.mesh) for p in pieces]
    assert _area(whole.mesh) == pytest.approx(sum(areas), rel=1e-5)


def test_own_materials_that_are_the_same_become_one(data):
    pieces = [read_piece(data, visual(f"objects/chair/chair_{x}"), HERE, OWN) for x in "ab"]
    assert joined(pieces).slots == (OWN,)


def test_too_much_for_one_mesh_is_refused(data, monkeypatch):
    monkeypatch.setattr("langwm_data.scenes.meshes.triangles.MAX_TRIANGLES", 30)
    piece = read_piece(data, visual(), HERE, OWN)
    with pytest.raises(ValueError, match="has 48 triangles; allowed: 1 to 30"):
        joined([piece, piece])


def test_cutting_gives_every_triangle_to_its_owner(data):
    piece = joined([read_piece(data, visual(), HERE, OWN), read_piece(data, visual(), HERE, 2)])
    owner = np.arange(48) % 2
    parts = cut(piece, owner)
    assert list(parts) == [0, 1]
    assert [p.slots for p in parts.values()] == [(OWN, 2), (OWN, 2)]
    corners = piece.mesh.vertices[piece.mesh.triangles]
    for number, part in parts.items():
        np.testing.assert_array_equal(part.mesh.vertices[part.mesh.triangles], corners[owner == number])


def test_each_group_of_a_collision_mesh_is_one_solid(dataset, data):
    solids = read_solids(data, "scenes/Rs_int/shape/collision/wall_cm.obj", HERE)
    assert len(solids) == 7
    np.testing.assert_allclose(solids[4].min(axis=0), (0.9, -2.9, 0))
    points = "usemtl x\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    text = f"{points}o a\nusemtl y\nf 1 2 3\nusemtl z\nf 1 2 4\ng b\nf 2 3 4\n"
    dataset.text("c.obj", text)
    assert [len(s) for s in read_solids(data, "c.obj", HERE)] == [4, 3]


def test_a_box_becomes_a_box_a_flat_thing_a_thin_box_and_all_else_a_hull():
    corners = np.array(list(np.ndindex(2, 2, 2)), float)
    box = solid_part(corners * (1, 2, 3) + 1, slot=0)
    assert (box.shape, box.size, box.position) == ("box", (1, 2, 3), (1.5, 2, 2.5))
    flat = solid_part(corners * (1, 2, 0), slot=0)
    assert (flat.shape, flat.size) == ("box", (1, 2, 0.001))
    turned = corners @ np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    inner = np.concatenate([turned, [turned.mean(axis=0)]])
    hull = solid_part(inner + 5, slot=0)
    assert hull.shape == "hull"
    points = np.array(hull.points)
    assert len(points) == 8
    np.testing.assert_allclose(np.ptp(points, axis=0), hull.size, atol=2e-4)
    np.testing.assert_allclose(points.min(axis=0), -points.max(axis=0), atol=2e-4)
    np.testing.assert_allclose(hull.position, turned.mean(axis=0) + 5)


def _area(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles].astype(float), 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
