"""TinyRenderer, PyBullet's software rasteriser, behind the renderer protocol.

Every (instance, slot) group of triangles is one body. Geometry is loaded once for each scene; a new
palette only changes textures.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.config import RenderConfig
from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.scenes.textures import texture_image, tile_size_m
from langwm_data.sim.bullet import import_pybullet, quiet
from langwm_data.sim.camera import Camera
from langwm_data.sim.mesh import MeshGroup, scene_groups
from langwm_data.sim.render import Frame

PATCH_M = 2.0
"""Extent of every image given to PyBullet: a whole number of tiles of any material, so that texture
coordinates stay as they are when the palette changes."""

LIGHT_DIRECTION = (0.64, 0.38, 0.67)
"""Towards the light, in world axes; all six directions of walls, floor and ceiling differ in brightness."""
AMBIENT, DIFFUSE = 0.6, 0.4


class TinyRenderer:
    """Holds one scene at a time and draws it on the CPU; needs no OpenGL."""

    name = "tiny"

    def __init__(self, config: RenderConfig) -> None:
        self._config = config
        self._bullet = import_pybullet()
        with quiet():
            self._client: int = self._bullet.connect(self._bullet.DIRECT)
        self._folder = tempfile.TemporaryDirectory(prefix="langwm-textures-")
        self._textures: dict[MaterialRef, int] = {}
        self._bodies: list[tuple[int, int]] = []
        """Body and slot of every group."""
        self._instance_of_body = np.zeros(1, np.uint16)
        self._scene: SceneSpec | None = None

    def load(self, scene: SceneSpec) -> None:
        """Replace the scene held."""
        self._bullet.resetSimulation(physicsClientId=self._client)
        self._textures.clear()
        groups = scene_groups(scene)
        self._bodies = [(self._add(group), group.slot) for group in groups]
        # The last entry stays 0: PyBullet marks pixels without a body by -1.
        table = np.zeros(max((body for body, _ in self._bodies), default=-1) + 2, np.uint16)
        for (body, _), group in zip(self._bodies, groups, strict=True):
            table[body] = group.instance
        self._instance_of_body = table
        self._scene = scene
        self.set_palette(scene.palette)

    def set_palette(self, palette: Sequence[MaterialRef]) -> None:
        """Change the materials of the scene held, keeping its geometry.

        Raises:
            ValueError: If the palette does not fit the scene.
        """
        assert self._scene is not None, "load a scene first"
        self._scene = self._scene.with_palette(palette)
        for body, slot in self._bodies:
            texture = self._texture(palette[slot])
            self._bullet.changeVisualShape(
                body, -1, textureUniqueId=texture, rgbaColor=(1, 1, 1, 1), physicsClientId=self._client
            )

    def render(self, camera: Camera) -> Frame:
        """Draw the scene held."""
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

    def _add(self, group: MeshGroup) -> int:
        mesh = group.mesh
        uvs = mesh.uvs / PATCH_M
        # TinyRenderer wraps positive coordinates only.
        uvs = uvs - np.floor(uvs.min(axis=0))
        shape = self._bullet.createVisualShape(
            self._bullet.GEOM_MESH,
            vertices=mesh.vertices.tolist(),
            indices=mesh.triangles.ravel().tolist(),
            uvs=uvs.tolist(),
            normals=_wrapped_normals(mesh.normals).tolist(),
            physicsClientId=self._client,
        )
        return self._bullet.createMultiBody(
            baseMass=0, baseVisualShapeIndex=shape, physicsClientId=self._client
        )

    def _texture(self, material: MaterialRef) -> int:
        if material not in self._textures:
            path = Path(self._folder.name) / f"{material.category}-{material.id}.png"
            if not path.exists():
                image = _patch(material, self._config.texture_px)
                cv2.imwrite(str(path), image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
            self._textures[material] = self._bullet.loadTexture(str(path), physicsClientId=self._client)
        return self._textures[material]


def _patch(material: MaterialRef, texture_px: int) -> NDArray[np.uint8]:
    """A texture repeated over ``PATCH_M`` metres, no finer than twice ``texture_px`` across."""
    repeats = PATCH_M / tile_size_m(material.category)
    assert repeats == int(repeats), material.category
    tiled = np.tile(texture_image(material, texture_px), (int(repeats), int(repeats), 1))
    size = min(2 * texture_px, len(tiled))
    return cv2.resize(tiled, (size, size), interpolation=cv2.INTER_AREA).astype(np.uint8)


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
