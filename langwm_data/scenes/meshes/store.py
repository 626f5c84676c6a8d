"""Meshes on disk: ``<sha256>.npz``, named by their content, so that a reader can tell whether it is whole.

A file is a plain zip of uncompressed arrays, which ``numpy.load`` reads as well: ``vertices``, ``normals``,
``uvs``, ``triangles``, ``sizes``, ``colors`` (red, green, blue, opacity of each group), ``texture_of`` (which
texture each group has, -1 for none) and ``texture_<n>``, the bytes of a PNG. Nothing in it is compressed,
so no file grows when it is read.
"""

import hashlib
import io
import re
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data import atomic
from langwm_data.scenes.meshes.triangles import MAX_MATERIALS, Material, TriangleMesh, fault

MAX_FILE_BYTES = 2**28

_ARRAYS = {
    "vertices": (np.float32, 3),
    "normals": (np.float32, 3),
    "uvs": (np.float32, 2),
    "triangles": (np.int32, 3),
    "sizes": (np.int32, None),
    "colors": (np.float32, 4),
    "texture_of": (np.int32, None),
}
"""Type and width of every array; None for flat ones."""

_DAMAGE = (zipfile.BadZipFile, struct.error, EOFError, OSError, ValueError, RuntimeError)
"""What ``zipfile`` raises for damage."""


def encode_mesh(mesh: TriangleMesh) -> bytes:
    """The file of a mesh: the same mesh gives the same bytes."""
    textures = list(dict.fromkeys(m.texture for m in mesh.materials if m.texture is not None))
    arrays: dict[str, NDArray[Any]] = {
        "vertices": mesh.vertices,
        "normals": mesh.normals,
        "uvs": mesh.uvs,
        "triangles": mesh.triangles,
        "sizes": np.array(mesh.sizes, np.int32),
        "colors": np.array([(*m.color, m.opacity) for m in mesh.materials], np.float32),
        "texture_of": np.array(
            [-1 if m.texture is None else textures.index(m.texture) for m in mesh.materials], np.int32
        ),
    }
    arrays |= {f"texture_{i}": np.frombuffer(png, np.uint8) for i, png in enumerate(textures)}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as file:
        for name, array in arrays.items():
            # Entries named so, not by NumPy, have one fixed date and therefore fixed bytes.
            with file.open(zipfile.ZipInfo(f"{name}.npy"), "w") as entry:
                np.lib.format.write_array(
                    entry, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False
                )
    return buffer.getvalue()


def write_mesh(folder: Path, mesh: TriangleMesh) -> str:
    """Put a mesh into ``folder`` and return its name, the SHA-256 of its file."""
    problem = fault(mesh)
    assert problem is None, problem
    data = encode_mesh(mesh)
    name = hashlib.sha256(data).hexdigest()
    path = mesh_path(folder, name)
    if not path.exists() or path.read_bytes() != data:
        atomic.write_bytes(path, data)
    return name


def mesh_path(folder: Path, name: str) -> Path:
    """Where the mesh called ``name`` lies.

    Raises:
        ValueError: If that is no name of a mesh.
    """
    if not re.fullmatch("[0-9a-f]{64}", name):
        raise ValueError(f"{name!r} is no name of a mesh; names are 64 hexadecimal digits")
    return folder / f"{name}.npz"


def read_mesh(folder: Path, name: str) -> TriangleMesh:
    """The mesh called ``name``.

    Raises:
        FileNotFoundError: If there is none.
        ValueError: If the file is not what its name says, or no sound mesh.
    """
    path = mesh_path(folder, name)
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise ValueError(f"{path}: {size} bytes; a mesh has at most {MAX_FILE_BYTES}")
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != name:
        raise ValueError(f"{path}: its content does not match its name; delete it")
    try:
        return decode_mesh(data)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def decode_mesh(data: bytes) -> TriangleMesh:
    """The inverse of ``encode_mesh``.

    Raises:
        ValueError: If the bytes are no sound mesh; the message is the end of a sentence.
    """
    entries = _entries(data)
    try:
        arrays = {name: _array(entries[name], *kind) for name, kind in _ARRAYS.items()}
        textures = [
            _array(entries[f"texture_{i}"], np.uint8, None).tobytes()
            for i in range(len(entries) - len(_ARRAYS))
        ]
    except (KeyError, EOFError, SyntaxError) as error:
        raise ValueError(f"no mesh: {error}") from error
    mesh = TriangleMesh(
        vertices=arrays["vertices"],
        normals=arrays["normals"],
        uvs=arrays["uvs"],
        triangles=arrays["triangles"],
        sizes=tuple(arrays["sizes"].tolist()),
        materials=_materials(arrays["colors"], arrays["texture_of"], textures),
    )
    if not len(mesh.vertices) == len(mesh.normals) == len(mesh.uvs):
        raise ValueError("has vertices, normals and texture coordinates in different numbers")
    problem = fault(mesh)
    if problem is not None:
        raise ValueError(problem)
    return mesh


def _entries(data: bytes) -> dict[str, bytes]:
    try:
        file = zipfile.ZipFile(io.BytesIO(data))
    except _DAMAGE as error:
        raise ValueError(f"no mesh: {error}") from error
    with file:
        infos = file.infolist()
        most = len(_ARRAYS) + MAX_MATERIALS
        if len(infos) > most:
            raise ValueError(f"has {len(infos)} arrays; at most {most} are read")
        # Stored entries cannot grow; entries that overlap could.
        if any(i.compress_type != zipfile.ZIP_STORED for i in infos) or sum(i.file_size for i in infos) > len(
            data
        ):
            raise ValueError("has arrays that are compressed or larger than the file")
        try:
            return {i.filename.removesuffix(".npy"): file.read(i) for i in infos}
        except _DAMAGE as error:
            raise ValueError(f"no mesh: {error}") from error


def _array(data: bytes, dtype: type[np.generic], width: int | None) -> NDArray[Any]:
    """An array in NumPy's file format, whose head must promise exactly what follows it."""
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("has an array of another version of NumPy's format")
    shape, is_fortran, kind = np.lib.format.read_array_header_1_0(stream)
    expected = 1 if width is None else 2
    if (
        kind != np.dtype(dtype)
        or is_fortran
        or len(shape) != expected
        or shape[1:] != (width,)[: expected - 1]
    ):
        raise ValueError(f"has an array of {kind} {shape}; needed: {np.dtype(dtype)} of width {width or 1}")
    body = data[stream.tell() :]
    if len(body) != shape[0] * (width or 1) * kind.itemsize:
        raise ValueError(f"has an array of {shape} in {len(body)} bytes")
    return np.frombuffer(body, kind).reshape(shape)


def _materials(colors: NDArray[Any], texture_of: NDArray[Any], textures: list[bytes]) -> tuple[Material, ...]:
    if len(colors) != len(texture_of) or any(not -1 <= t < len(textures) for t in texture_of.tolist()):
        raise ValueError("has materials without colour or texture")
    if not ((colors >= 0) & (colors <= 1)).all():
        raise ValueError("has a colour outside of 0 to 1")
    return tuple(
        Material(color=(r, g, b), opacity=opacity, texture=None if t < 0 else textures[t])
        for (r, g, b, opacity), t in zip(colors.tolist(), texture_of.tolist(), strict=True)
    )
