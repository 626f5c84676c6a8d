"""OpenGL behind the renderer protocol: on a GPU, or in software where Mesa's llvmpipe is installed.

Colours are antialiased, ids and depth never. What is drawn how stands in ``gl_device``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import RenderConfig
from langwm_data.scenes.assets import NO_ASSETS, Assets
from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.sim.antialias import QUARTERS, OpenQuarters, find_open_quarters, smooth_edges
from langwm_data.sim.atlas import Blocks, texel_density
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Frame
from langwm_data.sim.gl_device import FACE_COLUMNS, Targets, gl_device
from langwm_data.sim.lights import Lights
from langwm_data.sim.scene_mesh import SceneMesh, scene_mesh
from langwm_data.sim.shading import pixel_to_ray


class GlRenderer:
    """Holds one scene at a time. Belongs to the thread that made it."""

    name = "gl"

    def __init__(self, config: RenderConfig, assets: Assets = NO_ASSETS) -> None:
        self._config = config
        self._assets = assets
        self._lights = Lights.of(config.lights)
        self._device = gl_device(config.egl_device)
        self._atlas, self._picture = self._device.atlas(config.texture_px)
        self._held: list[Any] = []

    def load(self, scene: SceneSpec) -> None:
        """Replace the scene held."""
        self.close()
        self._scene, self._mesh = scene, scene_mesh(scene, self._assets)
        make, mesh = self._device.context, self._mesh
        vertices = make.buffer(_vertex_data(mesh))
        self._indices = make.buffer(reserve=mesh.triangles.nbytes)
        layout = (vertices, "3f 3f 2f 1f", "position", "normal", "uv", "face")
        self._surfaces = make.vertex_array(self._device.surfaces, [layout], index_buffer=self._indices)
        layout = (vertices, "3f 20x 1f", "position", "face")
        self._faces = make.vertex_array(self._device.faces, [layout], index_buffer=self._indices)
        rows = 2 * -(-len(mesh.face_texture) // FACE_COLUMNS)
        self._face_table = make.texture((FACE_COLUMNS, rows), 4, dtype="f4")
        self._held = [self._surfaces, self._faces, vertices, self._indices, self._face_table]
        self._use_palette()

    def set_palette(self, palette: Sequence[MaterialRef]) -> None:
        """Change the materials of the scene held, keeping its geometry.

        Raises:
            ValueError: If the palette does not fit the scene.
        """
        assert self._held, "load a scene first"
        self._scene = self._scene.with_palette(palette)
        self._use_palette()

    def set_lights(self, lights: Lights) -> None:
        """Change the lights, keeping the scene and its materials."""
        self._lights = lights

    def render(self, camera: Camera) -> Frame:
        """Draw the scene held."""
        assert self._held, "load a scene first"
        device, targets = self._device, self._device.targets(camera.width, camera.height)
        triangles = self._mesh.visible_triangles(camera)
        self._set_camera(camera)
        self._draw(targets.centers, self._surfaces, triangles)
        surface = np.empty((camera.height, camera.width, 2), np.float32)
        targets.centers.read_into(surface, components=2, dtype="f4", alignment=1)
        faces = surface[..., 1].astype(np.int32)
        is_seen = _seen_faces(faces, len(self._mesh.face_texture))
        self._place_textures(np.flatnonzero(is_seen))
        device.shade(targets, {"atlas": self._picture, "face_table": self._face_table})
        rgb = np.empty((*faces.shape, 3), np.uint8)
        targets.picture.read_into(rgb, components=3, alignment=1)
        if self._config.is_antialiased:
            # Only what some pixel's centre shows can lend its colour to a quarter.
            is_lender = is_seen.take(self._mesh.faces.take(triangles[:, 0]))
            self._draw(targets.quarters, self._faces, triangles.compress(is_lender, axis=0))
            quarters = find_open_quarters(faces)
            smooth_edges(rgb, faces, quarters, _read_quarters(targets, quarters, faces.shape))
        return Frame(rgb=rgb, depth=surface[..., 0].copy(), instance=self._mesh.face_instance.take(faces))

    def close(self) -> None:
        """Free the scene held; a second call does nothing."""
        for held in self._held:
            held.release()
        self._held = []

    def _use_palette(self) -> None:
        self._blocks = Blocks(self._atlas, [*self._scene.palette, *self._mesh.own], self._assets)

    def _draw(self, target: Any, drawn: Any, triangles: NDArray[np.int32]) -> None:  # noqa: ANN401
        if len(triangles):
            self._indices.write(triangles)
        self._device.draw(target, drawn, len(triangles))

    def _place_textures(self, faces: NDArray[np.intp]) -> None:
        if self._blocks.fill_seen(self._mesh.face_texture.take(faces)):
            self._face_table.write(_face_table(self._mesh, self._blocks.table, self._config.texture_px))

    def _set_camera(self, camera: Camera) -> None:
        world_to_clip = _by_columns(_world_to_clip(camera))
        self._device.surfaces["world_to_clip"].write(world_to_clip)
        self._device.faces["world_to_clip"].write(world_to_clip)
        config, colors = self._config, self._device.colors
        colors["pixel_to_ray"].write(_by_columns(pixel_to_ray(camera)))
        colors["eye"] = camera.position
        colors["texels"] = config.texture_px / camera.focal_px
        colors["texels_per_metre"] = config.texture_px
        colors["atlas_size"] = self._picture.size
        lights = self._lights
        colors["lights"] = (*lights.ambient, *lights.sun, *lights.lamp)
        colors["sun_direction"] = lights.sun_direction


def _seen_faces(faces: NDArray[np.int32], num: int) -> NDArray[np.bool_]:
    """Which of ``num`` faces the pixels (H, W) show."""
    flat = faces.ravel()
    last_of_run = np.append(np.flatnonzero(flat[1:] != flat[:-1]), flat.size - 1)
    is_seen = np.zeros(num, np.bool_)
    is_seen[flat.take(last_of_run)] = True
    return is_seen


def _read_quarters(targets: Targets, quarters: OpenQuarters, shape: tuple[int, ...]) -> NDArray[np.int32]:
    """The faces that quarters of pixels show."""
    height, width = shape
    fine = np.empty((2 * height, 2 * width), np.float32)
    targets.quarters.read_into(fine, components=1, dtype="f4", alignment=1)
    first_of_pixel = 2 * quarters.pixel + 2 * width * (quarters.pixel // width)
    down, across = (QUARTERS.T + 1) // 2
    step_to_quarter = (down * 2 * width + across)[quarters.number]
    return fine.take(first_of_pixel + step_to_quarter).astype(np.int32)


def _vertex_data(mesh: SceneMesh) -> NDArray[np.float32]:
    return np.column_stack([mesh.vertices, mesh.normals, mesh.uvs, mesh.faces]).astype(np.float32)


def _face_table(mesh: SceneMesh, blocks: NDArray[np.float32], texture_px: int) -> NDArray[np.float32]:
    """Block, lamp and density of texels of each face, as ``gl_device`` lays them out."""
    num_faces = len(mesh.face_texture)
    rows = -(-num_faces // FACE_COLUMNS)
    table = np.zeros((2, rows * FACE_COLUMNS, 4), np.float32)
    table[0, :num_faces] = blocks[mesh.face_texture]
    table[1, :num_faces, :3] = mesh.face_lamp
    table[1, :num_faces, 3] = texel_density(mesh.face_tile_m, table[0, :num_faces, 2], texture_px)
    return np.ascontiguousarray(table.reshape(2, rows, FACE_COLUMNS, 4).swapaxes(0, 1))


def _by_columns(matrix: NDArray[np.float64]) -> bytes:
    """A matrix as a shader takes it."""
    return matrix.T.astype(np.float32).tobytes()


def _world_to_clip(camera: Camera) -> NDArray[np.float64]:
    """World to OpenGL's clip space, the first row of the picture at the bottom, where OpenGL begins."""
    near, far = camera.near_m, camera.far_m
    rotation = camera.camera_to_world[:3, :3].T
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = rotation
    world_to_camera[:3, 3] = -rotation @ camera.position
    projection = np.zeros((4, 4))
    projection[0, 0] = 2 * camera.focal_px / camera.width
    projection[1, 1] = 2 * camera.focal_px / camera.height
    projection[2, 2:] = (far + near) / (far - near), -2 * far * near / (far - near)
    projection[3, 2] = 1
    return projection @ world_to_camera
