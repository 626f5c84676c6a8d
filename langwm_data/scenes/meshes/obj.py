"""OBJ text: polygons with materials, made into triangles in groups of one material.

Source: the Wavefront object format: ``v``, ``vt``, ``vn``, ``f``, ``usemtl``, ``mtllib``. Lines, points,
curves, groups and smoothing are passed over. Units and axes are the file's own.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.meshes import triangles as limits
from langwm_data.scenes.meshes.normals import face_vectors, smooth_normals
from langwm_data.scenes.meshes.polygons import triangulate
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh, fault

MAX_BYTES = 2**26
"""The largest file of the Debian catalogues has 8.8 million bytes."""

_NO_AREA = 1e-14
"""Triangles below this share of the squared extent are dropped."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjFile:
    """What an OBJ file says, its references resolved and checked."""

    vertices: Floats
    """(V, 3)."""
    uvs: Floats
    """(U, 2), v upwards."""
    normals: Floats
    """(N, 3), any length."""
    corners: Ints
    """(C, 3): vertex, texture coordinate and normal of every corner of every polygon; -1 where none."""
    lengths: Ints
    """(P,): how many corners each polygon has."""
    material: Ints
    """(P,): index of ``material_names``."""
    material_names: tuple[str, ...]
    libraries: tuple[str, ...]
    """Names of MTL files."""


def parse_obj(data: bytes, label: str) -> ObjFile:
    """Read the text of an OBJ file.

    Args:
        data: The file.
        label: What messages call it.

    Raises:
        ValueError: If it is too large, a line cannot be read, a number is not finite or a face names what
            is not there.
    """
    if len(data) > MAX_BYTES:
        raise ValueError(f"{label}: {len(data)} bytes of OBJ; at most {MAX_BYTES} are read")
    reader = _Reader()
    for number, line in enumerate(_lines(data), start=1):
        try:
            reader.take(line)
        except (ValueError, IndexError) as error:
            raise ValueError(f"{label}: line {number} {line[:60]!r} cannot be read: {error}") from error
    try:
        return reader.result()
    except ValueError as error:
        raise ValueError(f"{label}: {error}") from error


def build_mesh(obj: ObjFile, materials: Mapping[str, Material], label: str) -> TriangleMesh:
    """Triangles in groups of one material, in the order in which materials are first used.

    A normal that the file lacks follows from the faces; one that points behind its triangle is turned
    round. Triangles without area vanish. A material that is not described is light grey.

    Raises:
        ValueError: If nothing is left, or it is too much.
    """
    try:
        corners, owner = triangulate(obj.vertices[obj.corners[:, 0]], obj.lengths)
    except ValueError as error:
        raise ValueError(f"{label}: {error}") from error
    references, material = obj.corners[corners], obj.material[owner]
    vectors = face_vectors(obj.vertices, references[..., 0])
    extent = np.ptp(obj.vertices, axis=0).max(initial=0)
    is_solid = np.linalg.norm(vectors, axis=1) > _NO_AREA * extent**2
    if not is_solid.any():
        raise ValueError(f"{label}: no triangle in it has an area")
    order = np.argsort(material[is_solid], kind="stable")
    references, material = references[is_solid][order], material[is_solid][order]
    used, sizes = np.unique(material, return_counts=True)
    looks = tuple(materials.get(obj.material_names[i], Material(color=(0.8, 0.8, 0.8))) for i in used)
    is_textured = np.isin(material, [i for i, look in zip(used, looks, strict=True) if look.texture])
    references[~is_textured, :, 1] = -1
    mesh = _assembled(obj, references, tuple(sizes.tolist()), looks)
    problem = fault(mesh)
    if problem is not None:
        raise ValueError(f"{label}: {problem}")
    return mesh


def _assembled(
    obj: ObjFile, references: Ints, sizes: tuple[int, ...], looks: tuple[Material, ...]
) -> TriangleMesh:
    """One vertex for every different corner within a group."""
    normals, normal_of = _corner_normals(obj, references)
    group = np.repeat(np.arange(len(sizes)), sizes)
    keys = np.stack(
        [np.broadcast_to(group[:, None], normal_of.shape), references[..., 0], references[..., 1], normal_of]
    )
    first, index = unique_columns(keys.reshape(4, -1))
    vertex, uv = references[..., 0].ravel()[first], references[..., 1].ravel()[first]
    uvs = np.concatenate([obj.uvs, np.zeros((1, 2))])  # the last one is where -1 points
    return TriangleMesh(
        vertices=obj.vertices[vertex].astype(np.float32),
        normals=normals[normal_of.ravel()[first]].astype(np.float32),
        uvs=uvs[uv].astype(np.float32),
        triangles=index.reshape(-1, 3).astype(np.int32),
        sizes=sizes,
        materials=looks,
    )


def _corner_normals(obj: ObjFile, references: Ints) -> tuple[Floats, Ints]:
    """Unit normals, and which of them each corner (T, 3) has."""
    smooth, own = smooth_normals(obj.vertices, references[..., 0])
    lengths = np.linalg.norm(obj.normals, axis=1, keepdims=True)
    stated = obj.normals / np.where(lengths > 0, lengths, 1)
    number = references[..., 2]
    is_stated = (number >= 0) & (np.append(lengths.ravel(), 0)[number] > 0)
    vectors = face_vectors(obj.vertices, references[..., 0])
    direction = np.einsum("tck,tk->tc", np.concatenate([stated, np.zeros((1, 3))])[number], vectors)
    turned = np.where(direction < 0, number + len(stated), number)
    everything = np.concatenate([stated, -stated, smooth])
    return everything, np.where(is_stated, turned, own + 2 * len(stated))


def unique_columns(keys: Ints) -> tuple[Ints, Ints]:
    """Of integer columns (K, N): where each different one stands first, and (N,) which one each is."""
    code = np.zeros(keys.shape[1], np.int64)
    first = np.zeros(min(1, keys.shape[1]), np.int64)
    for row in keys:
        shifted = row - row.min(initial=0)
        code = code * (int(shifted.max(initial=0)) + 1) + shifted
        _, first, code = np.unique(code, return_index=True, return_inverse=True)
    return first, code.ravel()


def _lines(data: bytes) -> list[bytes]:
    """Lines; a backslash at the end of one continues it."""
    if b"\\" in data:
        data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    return data.splitlines()


class _Reader:
    """Collects the words of a file line by line, and makes numbers of them all at once."""

    def __init__(self) -> None:
        self._numbers: dict[bytes, list[bytes]] = {b"v": [], b"vt": [], b"vn": []}
        self._corners: list[bytes] = []
        self._lengths: list[int] = []
        self._material: list[int] = []
        self._names: dict[str, int] = {}
        self._libraries: list[str] = []
        self._current = -1

    def take(self, line: bytes) -> None:
        """One line of the file."""
        words = line.split()
        if not words:
            return
        keyword = words[0]
        if keyword == b"f":
            self._take_face(words[1:], is_relative=b"-" in line)
        elif keyword in self._numbers:
            width = _WIDTHS[keyword]
            if len(words) <= width:
                raise ValueError(f"{len(words) - 1} numbers; {width} are needed")
            self._numbers[keyword] += words[1 : width + 1]
        elif keyword == b"usemtl":
            self._use(_text(line))
        elif keyword == b"mtllib":
            self._libraries.append(_text(line))

    def _take_face(self, corners: list[bytes], *, is_relative: bool) -> None:
        if self._current < 0:
            self._use("")
        if is_relative:
            counts = [len(self._numbers[k]) // _WIDTHS[k] for k in (b"v", b"vt", b"vn")]
            corners = [_absolute(corner, counts) for corner in corners]
        self._corners += corners
        self._lengths.append(len(corners))
        self._material.append(self._current)

    def _use(self, name: str) -> None:
        self._current = self._names.setdefault(name, len(self._names))
        if len(self._names) > limits.MAX_MATERIALS:
            raise ValueError(f"more than {limits.MAX_MATERIALS} materials")

    def result(self) -> ObjFile:
        """Everything taken so far, as numbers.

        Raises:
            ValueError: If something is no number or out of range; the message is the end of a sentence.
        """
        lengths = np.array(self._lengths, np.int64)
        num_triangles = int(np.maximum(lengths - 2, 0).sum())
        if num_triangles > limits.MAX_TRIANGLES:
            raise ValueError(f"has {num_triangles} triangles; at most {limits.MAX_TRIANGLES} are read")
        vertices, uvs, normals = (
            _floats(self._numbers[k], _WIDTHS[k], k.decode()) for k in (b"v", b"vt", b"vn")
        )
        # Exporters leave rubbish in texture coordinates: two of the 820 Debian files have 3.4e9 in them.
        uvs[np.abs(uvs) > limits.MAX_EXTENT] = 0
        corners = _references(self._corners)
        for column, (name, there) in enumerate((("vertex", vertices), ("texture", uvs), ("normal", normals))):
            _check_range(corners[:, column], len(there), name, is_needed=column == 0)
        return ObjFile(
            vertices=vertices,
            uvs=uvs,
            normals=normals,
            corners=corners - 1,
            lengths=lengths,
            material=np.array(self._material, np.int64),
            material_names=tuple(self._names),
            libraries=tuple(self._libraries),
        )


_WIDTHS = {b"v": 3, b"vt": 2, b"vn": 3}


def _text(line: bytes) -> str:
    """What follows the keyword; names may hold blanks."""
    return line.split(maxsplit=1)[1].strip().decode("utf-8", "replace")


def _absolute(corner: bytes, counts: Sequence[int]) -> bytes:
    """A corner that counts back from what was there when its face was read, counting from the front."""
    parts = [int(part) if part else 0 for part in corner.split(b"/")]
    forward = [n + 1 + part if part < 0 else part for part, n in zip(parts, counts, strict=False)]
    if any(part < 0 and now < 1 for part, now in zip(parts, forward, strict=False)):
        raise ValueError("a relative index before the first")
    return b"/".join(str(part).encode() for part in forward)


def _floats(words: list[bytes], width: int, keyword: str) -> Floats:
    try:
        values = np.array(list(map(float, words)), np.float64)
    except ValueError as error:
        raise ValueError(f"has a {keyword!r} that is no number: {error}") from error
    largest = math.inf if keyword == "vt" else limits.MAX_EXTENT
    if not (np.isfinite(values) & (np.abs(values) <= largest)).all():
        raise ValueError(f"has a {keyword!r} that is no number within ±{limits.MAX_EXTENT:g}")
    if len(values) > width * limits.MAX_VERTICES:
        raise ValueError(f"has {len(values) // width} {keyword!r}; at most {limits.MAX_VERTICES} are read")
    return values.reshape(-1, width)


def _references(corners: list[bytes]) -> Ints:
    """(C, 3): the numbers of each corner as written, 0 where there is none."""
    text = b" ".join(corners)
    odd = text.translate(None, b"0123456789/ ")
    if odd:
        raise ValueError(f"has a face corner with {odd[:20]!r} in it")
    letters = np.frombuffer(text, np.uint8)
    corner_of = np.cumsum(letters == ord(" "))
    num_slashes = np.bincount(corner_of[letters == ord("/")], minlength=len(corners))
    if num_slashes.max(initial=0) > 2:
        raise ValueError("has a face corner of more than three numbers")
    # "7//3" has no texture coordinate, nor has "7/": zeros take their place.
    numbers = np.fromstring(_without_gaps(text).replace(b"/", b" "), np.int64, sep=" ")
    references = np.zeros((len(corners), 3), np.int64)
    is_stated = np.arange(3) <= num_slashes[:, None]
    if is_stated.sum() != len(numbers):
        raise ValueError("has a face corner without a vertex")
    references[is_stated] = numbers
    return references


def _without_gaps(text: bytes) -> bytes:
    for gap, filled in ((b"//", b"/0/"), (b"/ ", b"/0 ")):
        text = text.replace(gap, filled)
    return text + b"0" if text.endswith(b"/") else text


def _check_range(numbers: Ints, num: int, name: str, *, is_needed: bool) -> None:
    wrong = numbers[(numbers < (1 if is_needed else 0)) | (numbers > num)]
    if len(wrong):
        raise ValueError(f"has a face that names {name} {wrong[0]}; there are {num}")
