"""Meshes and pictures made by hand, and a scene in which they stand."""

import dataclasses

import cv2
import numpy as np

from langwm_data.scenes.meshes.triangles import Material, TriangleMesh
from langwm_data.scenes.spec import IDENTITY, OWN, MeshSpec, ObjectSpec, PartSpec

QUADRANTS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
"""Red and green above, blue and white below."""
ORANGE = (0.8, 0.4, 0.2)
BOARD, TABLE = 40, 41
"""Instances."""

_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
_SIDES = [(6, 7, 5, 4), (1, 3, 2, 0), (3, 7, 6, 2), (4, 5, 1, 0), (5, 7, 3, 1), (2, 6, 4, 0)]
"""Of a box, counter-clockwise seen from outside: +x, -x, +y, -y, +z, -z."""


def png(picture, size=64):
    large = cv2.resize(picture, (size, size), interpolation=cv2.INTER_NEAREST)
    return cv2.imencode(".png", large[..., ::-1])[1].tobytes()


def quads(corners, materials):
    """A mesh of one group for each entry of ``corners``, a list of quads (4, 3), with flat normals."""
    vertices = np.concatenate([np.reshape(group, (-1, 3)) for group in corners]).astype(np.float32)
    first = np.arange(0, len(vertices), 4)[:, None]
    triangles = np.concatenate([first + np.array(half) for half in ((0, 1, 2), (0, 2, 3))], axis=1).reshape(
        -1, 3
    )
    a, b, c = np.moveaxis(vertices[triangles[::2]], 1, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return TriangleMesh(
        vertices=vertices,
        normals=np.repeat(normals, 4, axis=0).astype(np.float32),
        uvs=np.tile(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32), (len(first), 1)),
        triangles=triangles.astype(np.int32),
        sizes=tuple(2 * len(group) for group in corners),
        materials=tuple(materials),
    )


def box_quads(low, high):
    corners = np.array(low) + _CORNERS * (np.array(high) - low)
    return [corners[list(side)] for side in _SIDES]


def board_mesh(bottom=0.0):
    """An upright sheet, 1.2 m wide and 0.8 m high, whose picture is seen from +y, its own front."""
    low, high = bottom, bottom + 0.8
    return quads(
        [[[(0.6, 0, low), (-0.6, 0, low), (-0.6, 0, high), (0.6, 0, high)]]],
        [Material(color=(1.0, 1.0, 1.0), texture=png(QUADRANTS))],
    )


def table_mesh():
    """A top of its own colour, and legs for a material of the scene: neither convex nor one piece."""
    legs = [
        quad
        for x in (-0.4, 0.35)
        for y in (-0.3, 0.25)
        for quad in box_quads((x, y, 0), (x + 0.05, y + 0.05, 0.5))
    ]
    top = box_quads((-0.4, -0.3, 0.5), (0.4, 0.3, 0.55))
    return quads([top, legs], [Material(color=ORANGE), Material(color=(0.0, 0.0, 0.0))])


def solid(size):
    return PartSpec(shape="box", size=size, position=(0.0, 0.0, size[2] / 2), slot=0)


def with_meshes(scene, assets, *, leg_slot=5):
    """The study of the small scene without its furniture, but with a board and a table."""
    board, table = assets.add_mesh(board_mesh(bottom=0.4)), assets.add_mesh(table_mesh())
    common = {"room": "study", "orientation": IDENTITY}
    objects = (
        ObjectSpec(
            instance=BOARD,
            category="picture",
            model="board",
            position=(1.2, 0.6, 0.0),
            size=(1.2, 0.02, 1.2),
            parts=(solid((1.2, 0.02, 1.2)),),
            mesh=MeshSpec(name=board, slots=(OWN,)),
            **common,
        ),
        ObjectSpec(
            instance=TABLE,
            category="coffee_table",
            model="table",
            position=(2.9, 1.9, 0.0),
            size=(0.8, 0.6, 0.55),
            parts=(solid((0.8, 0.6, 0.55)),),
            mesh=MeshSpec(name=table, slots=(OWN, leg_slot)),
            phrase="small orange table",
            **common,
        ),
    )
    return dataclasses.replace(scene, objects=objects)
