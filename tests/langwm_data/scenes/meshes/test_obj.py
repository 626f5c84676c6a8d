import time

import numpy as np
import pytest

from langwm_data.scenes.meshes import obj as obj_module
from langwm_data.scenes.meshes import triangles
from langwm_data.scenes.meshes.normals import face_vectors
from langwm_data.scenes.meshes.obj import build_mesh, parse_obj
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh

CUBE = """
mtllib my colours.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl red paint
f 1/1 4/4 3/3 2/2
f 5/1 6/2 7/3 8/4
usemtl blue
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""
RED, BLUE = Material(color=(1, 0, 0), texture=b"png"), Material(color=(0, 0, 1))


def load(text, materials=None) -> TriangleMesh:
    return build_mesh(parse_obj(text.encode(), "x.obj"), materials or {}, "x.obj")


def corners(mesh):
    return mesh.vertices[mesh.triangles]


def test_a_cube_in_two_materials():
    obj = parse_obj(CUBE.encode(), "x.obj")
    assert obj.libraries == ("my colours.mtl",)
    assert obj.material_names == ("red paint", "blue")
    mesh = build_mesh(obj, {"red paint": RED, "blue": BLUE}, "x.obj")
    assert mesh.sizes == (4, 8)
    assert mesh.materials == (RED, BLUE)
    outward = face_vectors(mesh.vertices.astype(float), mesh.triangles)
    middle = corners(mesh).mean(axis=1)
    assert np.linalg.norm(outward, axis=1).sum() / 2 == pytest.approx(6)  # the area of a cube
    assert (np.einsum("tk,tk->t", outward, middle - 0.5) > 0).all()
    assert np.allclose(mesh.normals, np.round(mesh.normals))  # no edge of a cube is smooth
    assert np.allclose(mesh.uvs[mesh.triangles[0]], [[0, 0], [0, 1], [1, 1]])
    assert not mesh.uvs[mesh.triangles[4:]].any()


def test_the_same_triangles_as_trimesh():
    trimesh = pytest.importorskip("trimesh")
    ours = load(CUBE)
    theirs = trimesh.load(trimesh.util.wrap_as_stream(CUBE), file_type="obj", force="mesh")
    assert theirs.area == pytest.approx(np.linalg.norm(face_vectors(*_arrays(ours)), axis=1).sum() / 2)
    assert trimesh.Trimesh(*_arrays(ours)).volume == pytest.approx(1)


def _arrays(mesh):
    return mesh.vertices.astype(float), mesh.triangles


def test_negative_indices_count_back_from_where_they_stand():
    absolute = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf 4 5 6\n"
    relative = absolute.replace("f 1 2 3", "f -3 -2 -1").replace("f 4 5 6", "f -3 5 -1")
    assert (corners(load(absolute)) == corners(load(relative))).all()
    with_all = "vt 0 0\nvn 0 0 1\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3/-1/-1 -2//-1 -1/-1\n"
    assert parse_obj(with_all.encode(), "x.obj").corners.tolist() == [[0, 0, 0], [1, -1, 0], [2, 0, -1]]


def test_stated_normals_are_used_and_turned_to_the_front():
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 0 0 -1\nvn 0 0 0\nf 1//1 2//2 3//3\n"
    assert np.allclose(load(text).normals, [0, 0, 1])


def test_a_fine_cylinder_is_smooth_around_and_sharp_at_its_ends():
    num = 16
    angle = np.arange(num) * 2 * np.pi / num
    lines = [f"v {np.cos(a)} {np.sin(a)} {z}" for z in (0, 1) for a in angle]
    lines += [f"f {i + 1} {(i + 1) % num + 1} {(i + 1) % num + num + 1} {i + num + 1}" for i in range(num)]
    lines.append("f " + " ".join(str(i + num + 1) for i in range(num)))
    mesh = load("\n".join(lines))
    is_side = np.abs(mesh.normals[:, 2]) < 0.5
    radial = mesh.vertices[is_side] * [1, 1, 0]
    assert np.allclose(mesh.normals[is_side], radial, atol=1e-6)
    assert np.allclose(mesh.normals[~is_side], [0, 0, 1])


def test_a_long_line_may_be_continued():
    assert load("v 0 0 0\nv 1 \\\n0 0\nv 0 1 0\nf 1 2 \\\r\n3\n").triangles.shape == (1, 3)


def test_lines_points_and_flat_faces_leave_nothing():
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\np 1\nf 1 2\nf 1 2 2\nf 1 2 3\ncurv 1 2\n"
    assert load(text).triangles.shape == (1, 3)
    with pytest.raises(ValueError, match=r"^x.obj: no triangle in it has an area$"):
        load("v 0 0 0\nv 1 0 0\nf 1 2 2\n")


THREE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (THREE + "f 1 2 4\n", "has a face that names vertex 4; there are 3"),
        (THREE + "f 0 1 2\n", "has a face that names vertex 0; there are 3"),
        (THREE + "f 1 2 1000000000\n", "has a face that names vertex 1000000000; there are 3"),
        (THREE + "f 1 2 99999999999999999999999\n", r"has a face that names vertex \d+; there are 3"),
        (THREE + "f 1/1 2/1 3/1\n", "has a face that names texture 1; there are 0"),
        (THREE + "f 1//1 2//1 3//1\n", "has a face that names normal 1; there are 0"),
        (THREE + "f 1 2 -4\n", r"line 4 b'f 1 2 -4' cannot be read: a relative index before the first"),
        (THREE + "f 1 2 /3\n", "has a face corner without a vertex"),
        (THREE + "f 1/1/1/1 2 3\n", "has a face corner of more than three numbers"),
        (THREE + "f 1 2 x\n", "has a face corner with b'x' in it"),
        (THREE + "f 1 2 3.5\n", "has a face corner with b'.' in it"),
        ("v nan 0 0\n", r"has a 'v' that is no number within ±1e\+06"),
        ("v 0 inf 0\n", r"has a 'v' that is no number within ±1e\+06"),
        ("v 0 1e400 0\n", r"has a 'v' that is no number within ±1e\+06"),
        ("v 0 zero 0\n", "has a 'v' that is no number: could not convert"),
        ("vn 0 0\n", "line 1 b'vn 0 0' cannot be read: 2 numbers; 3 are needed"),
        ("usemtl\n", "line 1 b'usemtl' cannot be read"),
    ],
)
def test_what_cannot_be_meant_is_refused(text, sentence):
    with pytest.raises(ValueError, match=f"^x.obj: {sentence}"):
        load(text)


@pytest.mark.parametrize(
    ("module", "limit", "value", "sentence"),
    [
        (obj_module, "MAX_BYTES", 10, r"\d+ bytes of OBJ; at most 10 are read"),
        (triangles, "MAX_TRIANGLES", 11, "has 12 triangles; at most 11 are read"),
        (triangles, "MAX_VERTICES", 7, "has 8 'v'; at most 7 are read"),
        (triangles, "MAX_MATERIALS", 1, "line .* cannot be read: more than 1 materials"),
    ],
)
def test_limits(monkeypatch, module, limit, value, sentence):
    monkeypatch.setattr(module, limit, value)
    with pytest.raises(ValueError, match=f"^x.obj: {sentence}"):
        load(CUBE)


def test_a_hundred_thousand_triangles_take_less_than_two_seconds():
    side = 224
    u, v = (a.ravel() for a in np.meshgrid(np.arange(side), np.arange(side)))
    lines = [f"v {x}.5 {y}.25 {x * y % 7}" for x, y in zip(u, v, strict=True)]
    lines += [f"vt {x / side} {y / side}" for x, y in zip(u, v, strict=True)]
    for i in range(side - 1):
        for j in range(side - 1):
            a = i * side + j + 1
            b, c, d = a + 1, a + side, a + side + 1
            lines += [f"f {a}/{a} {b}/{b} {d}/{d}", f"f {a}/{a} {d}/{d} {c}/{c}"]
    text = "\n".join(lines)
    start = time.process_time()
    mesh = load(text)
    assert time.process_time() - start < 2
    assert len(mesh.triangles) == 2 * (side - 1) ** 2 > 99_000
