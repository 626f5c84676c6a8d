import dataclasses
import hashlib
import io
import zipfile

import numpy as np
import pytest

from langwm_data.scenes.meshes import store, triangles
from langwm_data.scenes.meshes.store import decode_mesh, encode_mesh, mesh_path, read_mesh, write_mesh
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh


@pytest.fixture
def mesh():
    rng = np.random.default_rng(0)
    normals = np.tile(np.float32([0, 0, 1]), (6, 1))
    return TriangleMesh(
        vertices=rng.random((6, 3), np.float32),
        normals=normals,
        uvs=rng.random((6, 2), np.float32),
        triangles=np.arange(6, dtype=np.int32).reshape(2, 3),
        sizes=(1, 1),
        materials=(Material(color=(0.25, 0.5, 1.0), opacity=0.5), Material(color=(0, 0, 0), texture=b"png")),
    )


def altered(data, name, change):
    """The file of a mesh with one array replaced."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(buffer, "w") as new:
        for info in old.infolist():
            content = old.read(info)
            if info.filename == f"{name}.npy":
                content = change(content)
            if content is not None:
                new.writestr(info.filename, content)
    return buffer.getvalue()


def npy(array, **options):
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return buffer.getvalue()


def test_a_mesh_comes_back_as_it_was(tmp_path, mesh):
    name = write_mesh(tmp_path, mesh)
    back = read_mesh(tmp_path, name)
    for field in dataclasses.fields(TriangleMesh):
        assert np.array_equal(getattr(back, field.name), getattr(mesh, field.name)), field.name
    assert [p.name for p in tmp_path.iterdir()] == [f"{name}.npz"]


def test_the_name_is_the_checksum_and_the_same_mesh_has_the_same_name(tmp_path, mesh):
    name = write_mesh(tmp_path, mesh)
    assert name == hashlib.sha256((tmp_path / f"{name}.npz").read_bytes()).hexdigest()
    assert write_mesh(tmp_path / "again", mesh) == name


def test_numpy_reads_the_file_unaided(tmp_path, mesh):
    arrays = np.load(mesh_path(tmp_path, write_mesh(tmp_path, mesh)), allow_pickle=False)
    assert np.array_equal(arrays["vertices"], mesh.vertices)
    assert arrays["texture_of"].tolist() == [-1, 0]
    assert arrays["texture_0"].tobytes() == b"png"


def test_a_changed_file_is_refused(tmp_path, mesh):
    path = mesh_path(tmp_path, name := write_mesh(tmp_path, mesh))
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    with pytest.raises(ValueError, match=rf"{name}.npz: its content does not match its name; delete it"):
        read_mesh(tmp_path, name)


@pytest.mark.parametrize("name", ["../../etc/passwd", "", "0" * 63, "G" * 64])
def test_only_checksums_are_names(tmp_path, name):
    with pytest.raises(ValueError, match="is no name of a mesh; names are 64 hexadecimal digits"):
        read_mesh(tmp_path, name)


def test_a_huge_file_is_refused_unread(tmp_path, mesh, monkeypatch):
    name = write_mesh(tmp_path, mesh)
    monkeypatch.setattr(store, "MAX_FILE_BYTES", 9)
    with pytest.raises(ValueError, match=r"\d+ bytes; a mesh has at most 9"):
        read_mesh(tmp_path, name)


def claim_a_billion(data):
    return data.replace(b"'shape': (2, 3), }", b"'shape': (1000000000, 3), }").replace(
        b" " * 9 + b"\n", b"\n"
    )


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("triangles", claim_a_billion, r"has an array of \(1000000000, 3\) in 24 bytes"),
        ("triangles", lambda _: npy(np.full((2, 3), 6, np.int32)), "names a vertex that is not one of its 6"),
        (
            "triangles",
            lambda _: npy(np.full((2, 3), -1, np.int32)),
            "names a vertex that is not one of its 6",
        ),
        ("triangles", lambda _: npy(np.zeros((0, 3), np.int32)), "has 0 triangles; allowed: 1 to"),
        (
            "vertices",
            lambda _: npy(np.full((6, 3), np.nan, np.float32)),
            "has a coordinate that is no number",
        ),
        (
            "vertices",
            lambda _: npy(np.zeros((6, 3), np.float64)),
            r"has an array of float64 \(6, 3\); needed:",
        ),
        ("vertices", lambda _: npy(np.zeros((5, 3), np.float32)), "has vertices, normals and texture coord"),
        (
            "uvs",
            lambda _: npy(np.zeros(6, np.float32)),
            r"has an array of float32 \(6,\); needed: float32 of",
        ),
        ("uvs", lambda _: npy(np.array([{}], object)), r"has an array of object \(1,\)"),
        ("sizes", lambda _: npy(np.array([1, 2], np.int32)), "has groups of 3 triangles in all; there are 2"),
        ("sizes", lambda _: npy(np.array([2], np.int32)), "has 1 groups and 2 materials"),
        ("colors", lambda _: npy(np.full((2, 4), 2, np.float32)), "has a colour outside of 0 to 1"),
        ("texture_of", lambda _: npy(np.array([0, 1], np.int32)), "has materials without colour or texture"),
        ("normals", lambda _: None, "no mesh: "),
        ("normals", lambda _: b"hello", "EOF|magic"),
        ("normals", lambda d: d[:6] + b"\2" + d[7:], "has an array of another version of NumPy's format"),
    ],
)
def test_files_that_are_no_sound_mesh_are_refused(tmp_path, mesh, name, change, sentence):
    data = altered(encode_mesh(mesh), name, change)
    sha = hashlib.sha256(data).hexdigest()
    mesh_path(tmp_path, sha).write_bytes(data)
    with pytest.raises(ValueError, match=sentence):
        read_mesh(tmp_path, sha)


def test_whatever_is_changed_is_a_mesh_or_refused(mesh):
    good, refused = encode_mesh(mesh), []
    for place in range(0, len(good), 3):
        damaged = bytearray(good)
        damaged[place] ^= 1 << place % 8
        for data in (bytes(damaged), good[:place], good[: place // 2] + good[place:]):
            try:
                decode_mesh(data)
            except ValueError as error:
                refused.append(str(error))
    assert len(refused) > len(good) / 2
    assert any("negative seek" in text for text in refused)


def test_compressed_files_and_others_are_refused(mesh):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, vertices=mesh.vertices)
    with pytest.raises(ValueError, match="has arrays that are compressed or larger than the file"):
        decode_mesh(buffer.getvalue())
    with pytest.raises(ValueError, match="no mesh: File is not a zip file"):
        decode_mesh(b"hello")


def test_a_file_of_countless_arrays_is_refused(mesh, monkeypatch):
    monkeypatch.setattr(store, "MAX_MATERIALS", 0)
    with pytest.raises(ValueError, match="has 8 arrays; at most 7 are read"):
        decode_mesh(encode_mesh(mesh))


def test_more_triangles_than_the_limit_are_refused(mesh, monkeypatch):
    monkeypatch.setattr(triangles, "MAX_TRIANGLES", 1)
    with pytest.raises(ValueError, match="has 2 triangles; allowed: 1 to 1"):
        decode_mesh(encode_mesh(mesh))
