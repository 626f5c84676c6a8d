"""Meshes of others in the renderers, against what is known by hand and against one another."""

import dataclasses
import math

import numpy as np
import pytest
from backends import gl_opens
from mesh_scenes import (
    BOARD,
    ORANGE,
    QUADRANTS,
    TABLE,
    board_mesh,
    png,
    table_mesh,
    with_meshes,
)

from langwm_data.config import CameraConfig, LightsConfig, RenderConfig
from langwm_data.scenes.assets import Assets
from langwm_data.scenes.spec import MaterialRef, MeshSpec
from langwm_data.sim.asset_mesh import asset_mesh
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import make_renderer
from langwm_data.sim.scene_mesh import scene_mesh

SIZE = CameraConfig(height=96, width=120)


ALL = [
    pytest.param("gl", marks=pytest.mark.skipif(not gl_opens(), reason="no EGL device opens here")),
    "embree",
    "tiny",
]
BRIGHT = {
    "gl": {"lights": LightsConfig(ambient=2)},
    "embree": {"lights": LightsConfig(ambient=2)},
    "tiny": {},
}


@pytest.fixture(scope="module")
def assets(tmp_path_factory):
    return Assets(tmp_path_factory.mktemp("assets"))


@pytest.fixture(scope="module")
def scene(small_scene, assets):
    return with_meshes(small_scene, assets)


@pytest.fixture(params=ALL)
def draw(request, scene, assets):
    renderer = make_renderer(
        RenderConfig(backend=request.param, texture_px=64, is_antialiased=False, **BRIGHT[request.param]),
        assets,
    )

    def frame(camera, scene=scene):
        renderer.load(scene)
        return renderer.render(camera)

    yield frame
    renderer.close()


def view(xy, yaw, z=0.8, pitch=0.0):
    camera = Camera.on_robot(SIZE, xy, yaw)
    return dataclasses.replace(camera, position=(*xy, z), pitch_rad=pitch, vertical_fov_rad=1.0)


BEFORE, BEHIND = view((1.2, 2.2), -math.pi / 2), view((1.2, 0.05), math.pi / 2, z=0.8)


def quadrant_colors(frame):
    """The median colour of each quarter of the board's box, as it is seen."""
    rows, columns = np.nonzero(frame.instance == BOARD)
    assert len(rows) > 500
    middle_row, middle_column = (rows.min() + rows.max()) / 2, (columns.min() + columns.max()) / 2
    colors = np.zeros((2, 2, 3))
    for below in (0, 1):
        for right in (0, 1):
            own = ((rows > middle_row) == below) & ((columns > middle_column) == right)
            colors[below, right] = np.median(frame.rgb[rows[own], columns[own]], axis=0)
    return colors


def hues(colors):
    return np.argmax(colors, axis=-1) + 10 * (colors.min(axis=-1) > 60)


def test_own_textures_are_upright_and_not_mirrored(draw):
    assert np.array_equal(hues(quadrant_colors(draw(BEFORE))), [[0, 1], [2, 10]])


def test_a_sheet_is_seen_and_lit_from_behind_too(draw):
    colors = quadrant_colors(draw(BEHIND))
    assert np.array_equal(hues(colors), [[1, 0], [10, 2]])
    assert colors.max() > 100


def test_a_group_without_texture_has_its_plain_colour(draw):
    frame = draw(view((2.9, 0.8), math.pi / 2, z=1.2, pitch=-0.7))
    top = (frame.instance == TABLE) & (frame.rgb[..., 0] > 60) & (frame.depth < 1.6)
    color = np.median(frame.rgb[top], axis=0)
    np.testing.assert_allclose(color / color[0], np.array(ORANGE) / ORANGE[0], atol=0.03)


def test_a_group_with_a_slot_wears_the_material_of_the_slot(draw, scene):
    camera = view((2.9, 0.9), math.pi / 2, z=0.3)
    other = list(scene.palette)
    other[5] = MaterialRef(category="metal", id=4)
    first, second = draw(camera), draw(camera, scene.with_palette(other))
    is_top = first.rgb[..., 0] > 1.4 * first.rgb[..., 2]
    changed = np.abs(first.rgb.astype(int) - second.rgb).max(axis=-1) > 0
    legs = (first.instance == TABLE) & ~is_top
    assert changed[legs].mean() > 0.9
    assert not changed[~legs & (first.instance == TABLE)].any()


def test_depth_of_a_board_is_its_distance(draw):
    frame = draw(BEFORE)
    np.testing.assert_allclose(frame.depth[frame.instance == BOARD], 1.6, atol=0.002)


def test_renderers_agree_on_meshes(scene, assets):
    pytest.importorskip("pybullet")
    backends = ["embree", "tiny"] + (["gl"] if gl_opens() else [])
    renderers = {name: make_renderer(RenderConfig(backend=name, texture_px=16), assets) for name in backends}
    for renderer in renderers.values():
        renderer.load(scene)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        xy = tuple(rng.uniform((0.3, 0.9), (3.7, 2.8)).tolist())
        camera = view(xy, float(rng.uniform(-3, 3)), z=float(rng.uniform(0.2, 1.6)), pitch=-0.2)
        frames = {name: renderer.render(camera) for name, renderer in renderers.items()}
        truth = frames["embree"]
        for name, frame in frames.items():
            same = frame.instance == truth.instance
            assert same.mean() > 0.995, name
            assert (np.abs(frame.depth - truth.depth)[same] < 0.002).mean() > 0.99, name
    for renderer in renderers.values():
        renderer.close()


def test_texels_of_a_texture_are_as_large_as_the_surface_says(scene, assets):
    mesh = scene_mesh(scene, assets)
    (face,) = np.flatnonzero(mesh.face_instance == BOARD)
    assert mesh.face_tile_m[face] == pytest.approx(math.sqrt(1.2 * 0.8))
    own = mesh.uvs[mesh.faces == face] / mesh.face_tile_m[face]
    np.testing.assert_allclose(own.max(axis=0) - own.min(axis=0), 1, rtol=1e-6)
    assert (mesh.face_tile_m[mesh.face_texture < len(scene.slots)] == 0).all()


def test_faces_are_parted_at_creases_and_materials():
    mesh = asset_mesh(table_mesh())
    assert mesh.mesh.num_faces == 6 + 4 * 6
    assert np.bincount(mesh.face_group).tolist() == [6, 24]


def test_slots_must_fit_the_groups(scene, assets):
    table = scene.objects[1]
    wrong = dataclasses.replace(table, mesh=MeshSpec(name=table.mesh.name, slots=(5,)))
    with pytest.raises(ValueError, match=r"mesh [0-9a-f]{64} has 2 groups of triangles; .* for 1"):
        scene_mesh(dataclasses.replace(scene, objects=(wrong,)), assets)


def test_a_picture_is_a_material(draw, scene, assets):
    name = assets.add_picture(png(QUADRANTS))
    palette = [MaterialRef(category="paint", id=1, picture=name), *scene.palette[1:]]
    camera = view((2.0, 1.5), 0.0, z=1.5)
    frame = draw(camera, scene.with_palette(palette))
    points = camera.unproject(frame.depth)
    u, v = points @ camera.camera_to_world[:3, 0], points[..., 2]
    row, column = ((1 - v % 1) >= 0.5).astype(int), ((u % 1) >= 0.5).astype(int)
    inside = (np.abs(u % 0.5 - 0.25) < 0.2) & (np.abs(v % 0.5 - 0.25) < 0.2)
    inside &= (frame.instance == 10) & (np.abs(points[..., 0] - 4.0) < 0.01)
    assert inside.sum() > 300
    found, expected = hues(frame.rgb)[inside], hues(QUADRANTS)[row, column][inside]
    assert (found == expected).mean() > 0.99


def test_only_what_is_closed_is_left_out_from_behind():
    assert not asset_mesh(table_mesh()).is_two_sided.any()
    assert asset_mesh(board_mesh()).is_two_sided.all()
    table = table_mesh()
    inside_out = dataclasses.replace(table, triangles=table.triangles[:, ::-1].copy())
    assert asset_mesh(inside_out).is_two_sided.all()
    # A hole in one leg opens that leg alone.
    holed = dataclasses.replace(table, triangles=table.triangles[:-1], sizes=(12, 47))
    assert asset_mesh(holed).is_two_sided.sum() == 11
