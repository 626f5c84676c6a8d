"""TinyRenderer, PyBullet's software rasteriser, behind the renderer protocol.

Every (instance, slot) group of triangles is one body. Geometry is loaded once for each scene; a new
palette only changes textures, and not before the next frame is drawn.
"""

import dataclasses
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.config import RenderConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.scenes.textures import texture_image, tile_size_m
from langwm_data.sim.bullet import import_pybullet, quiet
from langwm_data.sim.camera import Camera
from langwm_data.sim.lights import Lights
from langwm_data.sim.mesh import Mesh, scene_groups
from langwm_data.sim.render import Frame

PATCH_M = 2.0
"""Extent of every image given to PyBullet: a whole number of tiles of any material, so that texture
coordinates stay as they are when the palette changes."""

LIGHT_DIRECTION = (0.64, 0.38, 0.67)
"""Towards the light, in world axes; all six directions of walls, floor and ceiling differ in brightness."""
AMBIENT, DIFFUSE = 0.6, 0.4


@dataclass(frozen=True, kw_only=True)
class Model:
    """The file with the triangles of one instance and slot."""

    instance: int
    slot: int
    path: Path


class TinyRenderer:
    """Holds one scene at a time and draws it on the CPU; needs no OpenGL."""

    name = "tiny"

    def __init__(self, config: RenderConfig) -> None:
        self._config = config
        self._bullet = import_pybullet()
        with quiet():
            self._client: int = self._bullet.connect(self._bullet.DIRECT)
        self._folder = tempfile.TemporaryDirectory(prefix="langwm-tiny-")
        self._models: dict[SceneSpec, list[Model]] = {}
        """Files of the scenes seen so far; the key has no palette."""
        self._textures: dict[MaterialRef, int] = {}
        self._bodies: list[tuple[int, int]] = []
        """Body and slot of every group."""
        self._instance_of_body = np.zeros(1, np.uint16)
        self._scene: SceneSpec | None = None
        self._shown: tuple[MaterialRef, ...] = ()

    def load(self, scene: SceneSpec) -> None:
        """Replace the scene held."""
        self._bullet.resetSimulation(physicsClientId=self._client)
        self._textures.clear()
        models = self._write_models(scene)
        self._bodies = [(self._add(model), model.slot) for model in models]
        # The last entry stays 0: PyBullet marks pixels without a body by -1.
        table = np.zeros(max((body for body, _ in self._bodies), default=-1) + 2, np.uint16)
        for (body, _), model in zip(self._bodies, models, strict=True):
            table[body] = model.instance
        self._instance_of_body = table
        self._scene, self._shown = scene, ()

    def set_palette(self, palette: Sequence[MaterialRef]) -> None:
        """Change the materials of the scene held, keeping its geometry.

        Raises:
            ValueError: If the palette does not fit the scene.
        """
        assert self._scene is not None, "load a scene first"
        self._scene = self._scene.with_palette(palette)

    def set_lights(self, lights: Lights) -> None:
        """Refused: the lights of this renderer are fixed.

        Raises:
            ConfigError: Always.
        """
        raise ConfigError("render.backend 'tiny' has lights of its own; allowed: gl, embree")

    def render(self, camera: Camera) -> Frame:
        """Draw the scene held."""
        self._show_palette()
        _, _, rgba, buffer, bodies = self._bullet.getCameraImage(
            camera.width,
            camera.height,
            viewMatrix=_view_matrix(camera),
            projectionMatrix=_projection_matrix(camera),
            renderer=self._bullet.ER_TINY_RENDERER,
            shadow=0,
            lightDirection=LIGHT_DIRECTION,
            lightColor=(1, 1, 1),
            lightAmbientCoeff=AMBIENT,
            lightDiffuseCoeff=DIFFUSE,
            lightSpecularCoeff=0,
            physicsClientId=self._client,
        )
        shape = camera.height, camera.width
        instance = self._instance_of_body[np.reshape(bodies, shape)]
        depth = _metric_depth(np.reshape(buffer, shape), camera.near_m, camera.far_m)
        depth[instance == 0] = 0
        rgb = np.reshape(rgba, (*shape, 4))[..., :3].astype(np.uint8)
        rgb[instance == 0] = 0
        return Frame(rgb=rgb, depth=depth, instance=instance)

    def close(self) -> None:
        """Free what the renderer holds; a second call does nothing."""
        if self._client >= 0:
            self._bullet.disconnect(self._client)
            self._client = -1
            self._folder.cleanup()

    def _write_models(self, scene: SceneSpec) -> list[Model]:
        geometry = dataclasses.replace(scene, palette=())
        if geometry not in self._models:
            folder = Path(self._folder.name) / f"scene-{len(self._models)}"
            folder.mkdir()
            models = []
            for group in scene_groups(scene):
                path = folder / f"{group.instance}-{group.slot}.obj"
                path.write_text(_obj_text(group.mesh))
                models.append(Model(instance=group.instance, slot=group.slot, path=path))
            self._models[geometry] = models
        return self._models[geometry]

    def _add(self, model: Model) -> int:
        # Not from arrays in memory: createVisualShape never frees the lists that it is given.
        shape = self._bullet.createVisualShape(
            self._bullet.GEOM_MESH, fileName=str(model.path), physicsClientId=self._client
        )
        return self._bullet.createMultiBody(
            baseMass=0, baseVisualShapeIndex=shape, physicsClientId=self._client
        )

    def _show_palette(self) -> None:
        palette = self._scene.palette if self._scene else ()
        if palette == self._shown:
            return
        for body, slot in self._bodies:
            texture = self._texture(palette[slot])
            self._bullet.changeVisualShape(
                body, -1, textureUniqueId=texture, rgbaColor=(1, 1, 1, 1), physicsClientId=self._client
            )
        self._shown = palette

    def _texture(self, material: MaterialRef) -> int:
        if material not in self._textures:
            # PyBullet reads textures from files only; of its formats BMP is the quickest to read.
            path = Path(self._folder.name) / f"{material.category}-{material.id}.bmp"
            if not path.exists():
                cv2.imwrite(str(path), _patch(material, self._config.texture_px)[..., ::-1])
            self._textures[material] = self._bullet.loadTexture(str(path), physicsClientId=self._client)
        return self._textures[material]


def _obj_text(mesh: Mesh) -> str:
    """A mesh as a Wavefront file, texture coordinates in units of ``PATCH_M``."""
    uvs = mesh.uvs / PATCH_M
    # TinyRenderer wraps positive coordinates only.
    uvs = uvs - np.floor(uvs.min(axis=0))
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in uvs.tolist()]
    lines += [f"vn {x:.9g} {y:.9g} {z:.9g}" for x, y, z in _wrapped_normals(mesh.normals).tolist()]
    lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in (mesh.triangles + 1).tolist()]
    return "\n".join(lines) + "\n"


def _patch(material: MaterialRef, px_per_m: int) -> NDArray[np.uint8]:
    """A texture repeated over ``PATCH_M`` metres."""
    tile_m = tile_size_m(material.category)
    repeats = round(PATCH_M / tile_m)
    assert repeats * tile_m == PATCH_M, material.category
    return np.tile(texture_image(material, round(tile_m * px_per_m)), (repeats, repeats, 1))


def _wrapped_normals(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normals turned towards the light so that plain Lambert shading falls off over the whole sphere.

    A surface at cosine c to the light gets brightness (1 + c) / 2 instead of max(c, 0); otherwise all
    surfaces that look away from the light would be equally dark and the corners of a room would vanish.
    """
    light = np.asarray(LIGHT_DIRECTION) / np.linalg.norm(LIGHT_DIRECTION)
    cosine = normals @ light
    across = normals - cosine[:, None] * light
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    wrapped = (1 + cosine) / 2
    return wrapped[:, None] * light + np.sqrt(1 - wrapped**2)[:, None] * across


def _view_matrix(camera: Camera) -> list[float]:
    """World to OpenGL camera axes (x right, y up, z backward), column by column."""
    world_to_camera = np.linalg.inv(camera.camera_to_world)
    return (np.diag([1.0, -1.0, -1.0, 1.0]) @ world_to_camera).T.ravel().tolist()


def _projection_matrix(camera: Camera) -> list[float]:
    """OpenGL projection of the pinhole camera, column by column."""
    near, far = camera.near_m, camera.far_m
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 2 * camera.focal_px / camera.width
    matrix[1, 1] = 2 * camera.focal_px / camera.height
    # TinyRenderer samples the lower left corner of each pixel; half a pixel brings that to the centre.
    matrix[:2, 2] = 1 / camera.width, 1 / camera.height
    matrix[2, 2:] = (far + near) / (near - far), 2 * far * near / (near - far)
    matrix[3, 2] = -1
    return matrix.T.ravel().tolist()


def _metric_depth(buffer: NDArray[np.float32], near: float, far: float) -> NDArray[np.float32]:
    """Z-depth in metres from the values 0 (near plane) to 1 (far plane) of a depth buffer."""
    return (near * far / (far - (far - near) * buffer.astype(np.float64))).astype(np.float32)
