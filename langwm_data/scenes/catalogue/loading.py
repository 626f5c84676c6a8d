"""The mesh of a catalogue's model, in metres, in the frame of our furniture, with its own materials.

The frame: x to the piece's right-hand side, +y to its front, z up, the origin at the centre of its
footprint at its lowest point. The catalogues' models have y up, z to the front, x to the viewer's right.
"""

import posixpath
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from langwm_data.scenes.catalogue.archive import Archive, open_archive
from langwm_data.scenes.catalogue.catalogue import CatalogueModel
from langwm_data.scenes.meshes.images import texture_png
from langwm_data.scenes.meshes.mtl import MtlMaterial, parse_mtl
from langwm_data.scenes.meshes.obj import build_mesh, parse_obj
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh

TO_OURS = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
"""From the catalogues' axes: their x is the viewer's right, ours the piece's own."""

_CLEAR = 0.01
"""Materials below this opacity are not there at all."""


def load_mesh(model: CatalogueModel) -> TriangleMesh:
    """Read, turn and scale the mesh of a model.

    Raises:
        ValueError: If it is damaged, hostile or too large.
    """
    with open_archive(model.archive) as outer, _source(outer, model) as (archive, path):
        label = f"{archive.label}!{path}"
        obj = parse_obj(archive.read(path), label)
        find = _finder(archive, posixpath.dirname(path))
        described: dict[str, MtlMaterial] = {}
        for library in obj.libraries:
            name = find(library)
            if name is not None:
                described |= parse_mtl(archive.read(name), f"{archive.label}!{name}")
        used = {name: described[name] for name in obj.material_names if name in described}
        mesh = build_mesh(obj, _materials(used, archive, find), label)
    return placed(_without_clear_groups(mesh, label), model)


def placed(mesh: TriangleMesh, model: CatalogueModel) -> TriangleMesh:
    """The mesh turned upright, in our axes, scaled to the size that the catalogue states."""
    turn = TO_OURS @ np.reshape(model.rotation, (3, 3))
    vertices = mesh.vertices.astype(np.float64) @ turn.T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = high - low
    scale = np.where(extent > 0, np.asarray(model.size) / np.where(extent > 0, extent, 1), 1)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    normals = mesh.normals.astype(np.float64) @ turn.T / scale
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(
        mesh,
        vertices=((vertices - foot) * scale).astype(np.float32),
        normals=(normals / np.where(lengths > 0, lengths, 1)).astype(np.float32),
    )


@contextmanager
def _source(outer: Archive, model: CatalogueModel) -> Iterator[tuple[Archive, str]]:
    """The archive that holds the OBJ file, and its path there."""
    path, is_nested, inner = model.path.partition("!")
    if not is_nested and not path.lower().endswith(".zip"):
        yield outer, path
        return
    with outer.nested(path) as archive:
        found = [inner.lstrip("/")] if inner else [n for n in archive.names() if n.lower().endswith(".obj")]
        if len(found) != 1:
            raise ValueError(f"{archive.label}: {len(found)} OBJ files in it; exactly one is needed")
        yield archive, found[0]


def _finder(archive: Archive, folder: str) -> Callable[[str], str | None]:
    """Finds a file that an OBJ or MTL file names, which is often a path of the machine it was made on."""
    beside = {posixpath.basename(n).lower(): n for n in archive.names() if posixpath.dirname(n) == folder}

    def find(name: str) -> str | None:
        plain = name.replace("\\", "/")
        path = posixpath.normpath(posixpath.join(folder, plain))
        return path if path in archive else beside.get(posixpath.basename(plain).lower())

    return find


def _materials(
    described: Mapping[str, MtlMaterial], archive: Archive, find: Callable[[str], str | None]
) -> dict[str, Material]:
    """Colours and textures; where a texture is not in the archive its material has its plain colour."""
    textures: dict[str, bytes] = {}
    materials = {}
    for name, material in described.items():
        file = find(material.texture) if material.texture else None
        if file is not None and file not in textures:
            textures[file] = texture_png(archive.read(file), f"{archive.label}!{file}")
        materials[name] = Material(
            color=material.color,
            opacity=material.opacity,
            texture=None if file is None else textures[file],
        )
    return materials


def _without_clear_groups(mesh: TriangleMesh, label: str) -> TriangleMesh:
    keep = [i for i, material in enumerate(mesh.materials) if material.opacity >= _CLEAR]
    if len(keep) == len(mesh.materials):
        return mesh
    if not keep:
        raise ValueError(f"{label}: every material of it is clear")
    return mesh.part(np.isin(mesh.group_of_triangles(), keep))
