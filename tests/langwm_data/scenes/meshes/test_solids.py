"""Boxes that hug a mesh, the pieces they are made from, and the level top on which things are put."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from langwm_data.scenes.meshes.pieces import cut
from langwm_data.scenes.meshes.solids import MAX_SOLIDS, MIN_THICKNESS_M, hugging_boxes
from langwm_data.scenes.meshes.tops import level_top
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def blocks(*boxes):
    """A mesh of cuboids, each given by its lowest and its highest corner."""
    boxes = np.array(boxes, float)
    vertices = np.concatenate([low + CORNERS * (high - low) for low, high in boxes])
    triangles = np.concatenate([SIDES + 8 * i for i in range(len(boxes))])
    return TriangleMesh(
        vertices=vertices.astype(np.float32),
        normals=np.zeros_like(vertices, np.float32),
        uvs=np.zeros((len(vertices), 2), np.float32),
        triangles=triangles.astype(np.int32),
        sizes=(len(triangles),),
        materials=(Material(color=(0.5, 0.5, 0.5)),),
    )


TABLE = blocks(
    ((0, 0, 0.7), (1.6, 0.8, 0.74)),
    *(((x, y, 0), (x + 0.06, y + 0.06, 0.7)) for x in (0.0, 1.54) for y in (0.0, 0.74)),
)


def volume(boxes):
    return float(np.prod(boxes[:, 1] - boxes[:, 0], axis=1).sum())


def covers(boxes, points):
    inside = (points[:, None] >= boxes[:, 0] - 1e-6) & (points[:, None] <= boxes[:, 1] + 1e-6)
    return inside.all(axis=2).any(axis=1)


def test_pieces_are_short_and_make_up_the_same_surface():
    pieces = cut(TABLE)
    edges = np.roll(pieces.corners, 1, axis=1) - pieces.corners
    assert np.linalg.norm(edges, axis=2).max() <= pieces.cell_m
    corners = TABLE.vertices[TABLE.triangles].astype(float)
    whole = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert pieces.areas.sum() == pytest.approx(whole.sum() / 2)


def test_the_space_between_the_legs_of_a_table_stays_free():
    boxes = hugging_boxes(cut(TABLE), 0.74)
    # 1.6 x 0.8 x 0.04 for the top and four legs: the true volume is 0.061 cubic metres.
    assert volume(boxes) < 0.08
    under = np.array([[0.8, 0.4, 0.3], [0.2, 0.4, 0.3], [0.8, 0.1, 0.3]])
    assert not covers(boxes, under).any()
    legs = np.array([[0.03, 0.03, 0.3], [1.57, 0.77, 0.3]])
    assert covers(boxes, legs).all()


@pytest.mark.parametrize("seed", range(5))
def test_every_point_of_a_mesh_is_in_a_box_and_no_box_sticks_out(seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, 1, (6, 3))
    mesh = blocks(*zip(low, low + rng.uniform(0.05, 0.6, (6, 3)), strict=True))
    pieces = cut(mesh)
    top = level_top(pieces)
    boxes = hugging_boxes(pieces, None if top is None else top[0])
    assert len(boxes) <= MAX_SOLIDS
    assert covers(boxes, pieces.corners.reshape(-1, 3)).all()
    assert (boxes.min(axis=(0, 1)) >= mesh.vertices.min(axis=0) - 1e-6).all()
    assert (boxes.max(axis=(0, 1)) <= mesh.vertices.max(axis=0) + 1e-6).all()
    assert (boxes == hugging_boxes(cut(mesh), None if top is None else top[0])).all()


def test_a_shell_counts_as_full_even_if_its_bottom_is_open():
    cupboard = blocks(((0, 0, 0), (1, 0.5, 2)))
    is_bottom = (cupboard.vertices[cupboard.triangles][..., 2] == 0).all(axis=1)
    shell = TriangleMesh(
        vertices=cupboard.vertices,
        normals=cupboard.normals,
        uvs=cupboard.uvs,
        triangles=cupboard.triangles[~is_bottom],
        sizes=(int((~is_bottom).sum()),),
        materials=cupboard.materials,
    )
    boxes = hugging_boxes(cut(shell))
    assert len(boxes) == 1
    assert boxes[0] == pytest.approx(np.array([[0, 0, 0], [1, 0.5, 2]]))


def test_sheets_have_some_thickness():
    wall = blocks(((0, 0, 0), (1, 0.001, 1)), ((0, 0, 0), (1, 1, 0.001)))
    boxes = hugging_boxes(cut(wall))
    assert (boxes[:, 1] - boxes[:, 0]).min() >= MIN_THICKNESS_M - 1e-9


def test_no_box_reaches_through_the_height_on_which_things_are_put():
    # A dresser with a mirror: the box around both would fill the air over the dresser.
    mesh = blocks(((0, 0, 0), (1, 0.5, 0.8)), ((0.1, 0, 0.8), (0.9, 0.03, 1.6)))
    pieces = cut(mesh)
    height, x0, y0, x1, y1 = level_top(pieces)
    assert height == pytest.approx(0.8, abs=1e-6)
    assert (x1 - x0) * (y1 - y0) > 0.4
    boxes = hugging_boxes(pieces, height)
    xs, ys = np.meshgrid(np.linspace(x0 + 0.01, x1 - 0.01, 20), np.linspace(y0 + 0.01, y1 - 0.01, 20))
    above = np.column_stack([xs.ravel(), ys.ravel(), np.full(xs.size, height + 0.01)])
    below = above - (0, 0, 0.02)
    assert not covers(boxes, above).any()
    assert covers(boxes, below).all()


def test_a_ball_has_no_level_top_worth_the_name():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(400, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    hull = ConvexHull(points)
    ball = TriangleMesh(
        vertices=points.astype(np.float32),
        normals=points.astype(np.float32),
        uvs=np.zeros((400, 2), np.float32),
        triangles=hull.simplices.astype(np.int32),
        sizes=(len(hull.simplices),),
        materials=(Material(color=(0.5, 0.5, 0.5)),),
    )
    _, x0, y0, x1, y1 = level_top(cut(ball))
    assert (x1 - x0) * (y1 - y0) < 0.1
