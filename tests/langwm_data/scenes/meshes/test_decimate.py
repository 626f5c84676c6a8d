import numpy as np
import pytest

from langwm_data.scenes.meshes.decimate import decimate
from langwm_data.scenes.meshes.normals import face_vectors
from langwm_data.scenes.meshes.triangles import Material, TriangleMesh, fault

GREY = Material(color=(0.5, 0.5, 0.5))
ERROR_M = 0.005


def sheet(side, height=lambda x, y: 0 * x, is_second=None, is_textured=False):
    """A square of one metre in ``side`` x ``side`` vertices; ``is_second`` says which faces are of a second
    material."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side)))
    i = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([i, i + 1, i + side + 1], 1), np.stack([i, i + side + 1, i + side], 1)]
    )
    middle = np.column_stack([x, y])[triangles].mean(axis=1)
    second = np.zeros(len(triangles), bool) if is_second is None else is_second(*middle.T)
    triangles = np.concatenate([triangles[~second], triangles[second]])
    sizes = tuple(int(n) for n in (np.sum(~second), np.sum(second)) if n)
    uvs = np.column_stack([3 * x, 2 * y]) if is_textured else np.zeros((len(x), 2))
    return TriangleMesh(
        vertices=np.column_stack([x, y, height(x, y)]).astype(np.float32),
        normals=np.tile(np.float32([0, 0, 1]), (len(x), 1)),
        uvs=uvs.astype(np.float32),
        triangles=triangles.astype(np.int32),
        sizes=sizes,
        materials=(GREY,) * len(sizes),
    )


def ball(radius, rows, columns):
    polar = np.linspace(-np.pi / 2, np.pi / 2, rows + 1)
    around = np.linspace(0, 2 * np.pi, columns, endpoint=False)
    points = np.array(
        [[np.cos(p) * np.cos(a), np.cos(p) * np.sin(a), np.sin(p)] for p in polar for a in around]
    )
    faces = []
    for r in range(rows):
        for c in range(columns):
            a, b = r * columns + c, r * columns + (c + 1) % columns
            faces += [[a, b, b + columns]] if r > 0 else []
            faces += [[a, b + columns, a + columns]] if r < rows - 1 else []
    points[:columns], points[-columns:] = [0, 0, -1], [0, 0, 1]
    return TriangleMesh(
        vertices=(points * radius).astype(np.float32),
        normals=points.astype(np.float32),
        uvs=np.zeros((len(points), 2), np.float32),
        triangles=np.array(faces, np.int32),
        sizes=(len(faces),),
        materials=(GREY,),
    )


def corners(mesh):
    return mesh.vertices.astype(float)[mesh.triangles]


def areas(mesh):
    return np.linalg.norm(face_vectors(mesh.vertices.astype(float), mesh.triangles), axis=1) / 2


def sampled(mesh, num):
    rng = np.random.default_rng(1)
    area = areas(mesh)
    share = rng.dirichlet([1, 1, 1], num)
    return np.einsum("nc,nck->nk", share, corners(mesh)[rng.choice(len(area), num, p=area / area.sum())])


def farthest(points, mesh):
    """Metres from the point that is farthest from a mesh, by trimesh."""
    trimesh = pytest.importorskip("trimesh")
    triangles = corners(mesh)
    every = np.tile(triangles, (len(points), 1, 1)), np.repeat(points, len(triangles), axis=0)
    distance = np.linalg.norm(trimesh.triangles.closest_point(*every) - every[1], axis=1)
    return distance.reshape(len(points), -1).min(axis=1).max()


def test_a_flat_sheet_becomes_a_few_triangles_of_the_same_outline():
    thin = decimate(sheet(30), ERROR_M)
    assert len(thin.triangles) <= 10
    assert fault(thin) is None
    assert areas(thin).sum() == pytest.approx(1)
    assert (face_vectors(thin.vertices.astype(float), thin.triangles)[:, 2] > 0).all()
    assert {(0, 0), (0, 1), (1, 0), (1, 1)} <= {tuple(v) for v in thin.vertices[:, :2].tolist()}


def test_a_ball_stays_round():
    whole = ball(0.3, 40, 80)
    thin = decimate(whole, ERROR_M)
    assert len(thin.triangles) < len(whole.triangles) / 2
    radius = np.linalg.norm(sampled(thin, 20_000), axis=1)
    assert radius.min() > 0.3 - ERROR_M - 0.3 * (1 - np.cos(np.pi / 40))  # its own facets lie inside too
    assert radius.max() <= 0.3 + 1e-6
    cosine = np.einsum("vk,vk->v", thin.normals, thin.vertices / 0.3)
    assert cosine.min() > np.cos(np.radians(6))


@pytest.mark.parametrize("amplitude", [0.002, 0.01, 0.03])
def test_no_surface_moves_further_than_the_stated_error(amplitude):
    def bumps(x, y):
        return amplitude * np.sin(9 * x) * np.cos(7 * y) + amplitude / 4 * np.sin(50 * x + 20 * y)

    whole = sheet(25, bumps)
    thin = decimate(whole, ERROR_M)
    assert len(thin.triangles) < len(whole.triangles)
    assert farthest(whole.vertices, thin) <= ERROR_M
    assert farthest(sampled(whole, 100), thin) <= ERROR_M
    assert farthest(sampled(thin, 100), whole) <= ERROR_M


def test_vertices_that_stay_do_so_exactly():
    whole = ball(0.3, 30, 60)
    thin = decimate(whole, ERROR_M)
    assert {tuple(v) for v in thin.vertices.tolist()} <= {tuple(v) for v in whole.vertices.tolist()}


def test_the_line_between_two_materials_stays_where_it_is():
    def is_inside(x, y):
        return (x - 0.5) ** 2 + (y - 0.5) ** 2 < 0.09

    whole = sheet(60, is_second=is_inside)
    thin = decimate(whole, ERROR_M)
    assert len(thin.sizes) == 2
    assert len(thin.triangles) < len(whole.triangles) / 5
    before, after = (areas(m)[m.sizes[0] :].sum() for m in (whole, thin))
    assert after == pytest.approx(before, abs=ERROR_M * 2 * np.pi * 0.35)
    middle = corners(thin).mean(axis=1)[thin.sizes[0] :, :2]
    assert (np.linalg.norm(middle - 0.5, axis=1) < 0.3 + 2 / 60).all()


def test_a_texture_lies_where_it_lay():
    thin = decimate(sheet(30, is_textured=True), ERROR_M)
    assert len(thin.triangles) <= 10
    assert np.allclose(thin.uvs, thin.vertices[:, :2] * [3, 2], atol=1e-6)


def test_thin_blades_keep_their_length():
    num = 40
    z = np.linspace(0, 0.3, num)
    width = 0.002 * (1 - z / 0.3)
    points = np.concatenate([np.column_stack([side * width, 0 * z, z]) for side in (-1, 1)])
    i = np.arange(num - 1)
    triangles = np.concatenate(
        [np.stack([i, i + num, i + num + 1], 1), np.stack([i, i + num + 1, i + 1], 1)[:-1]]
    )
    blade = TriangleMesh(
        vertices=points.astype(np.float32),
        normals=np.tile(np.float32([0, -1, 0]), (2 * num, 1)),
        uvs=np.zeros((2 * num, 2), np.float32),
        triangles=triangles.astype(np.int32),
        sizes=(len(triangles),),
        materials=(GREY,),
    )
    thin = decimate(blade, ERROR_M)
    assert len(thin.triangles) < 10
    assert thin.vertices[:, 2].max() >= 0.3 - ERROR_M
    assert thin.vertices[:, 2].min() <= ERROR_M


def test_the_same_mesh_gives_the_same_result():
    first, second = (decimate(ball(0.3, 20, 40), ERROR_M) for _ in range(2))
    assert (first.triangles == second.triangles).all()
    assert (first.vertices == second.vertices).all()


def test_light_boxes_lose_nothing():
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([t for a, b, c, d in faces for t in ([a, b, c], [a, c, d])], np.int32)
    box = TriangleMesh(
        vertices=corner,
        normals=np.zeros((8, 3), np.float32),
        uvs=np.zeros((8, 2), np.float32),
        triangles=triangles,
        sizes=(12,),
        materials=(GREY,),
    )
    thin = decimate(box, ERROR_M)
    assert len(thin.triangles) == 12
    assert np.allclose(np.abs(thin.normals).max(axis=1), 1)


def test_large_flat_faces_stay_flat_beside_a_bevel():
    def board_with_a_bevel(x, y):
        return np.where(x > 0.95, (0.95 - x) * 0.4, 0.0)

    thin = decimate(sheet(41, board_with_a_bevel), ERROR_M)
    is_flat = (thin.vertices[thin.triangles][..., 0] < 0.96).all(axis=1)
    assert is_flat.any()
    assert (thin.normals[thin.triangles[is_flat]][..., 2] > 0.999).all()
