"""TinyRenderer, PyBullet's software rasteriser, behind the renderer protocol.

Every group of triangles of one instance and one texture is one body. Geometry is loaded once for each
scene; a new palette only changes textures, and not before the next frame is drawn.
"""

import dataclasses
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from langwm_data.config import RenderConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.assets import NO_ASSETS, Assets
from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.sim.bullet import import_pybullet, quiet
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Frame
from langwm_data.sim.lights import Lights
from langwm_data.sim.scene_mesh import SceneMesh, scene_mesh
from langwm_data.sim.texture import Texture, texture_picture, texture_tile_m

PATCH_M = 2.0
"""Extent of every image given to PyBullet: a whole number of tiles of any material, so that texture
coordinates stay as they are when the palette changes."""

LIGHT_DIRECTION = (0.64, 0.38, 0.67)
"""Towards the light, in world axes; all six directions of walls, floor and ceiling differ in brightness."""
AMBIENT, DIFFUSE = 0.6, 0.4

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Model:
    """The file with the triangles of one instance and one texture."""

    instance: int
    texture: int
    """As ``SceneMesh.face_texture``."""
    path: Path


class TinyRenderer:
    """Holds one scene at a time and draws it on the CPU; needs no OpenGL."""

    name = "tiny"

    def __init__(self, config: RenderConfig, assets: Assets = NO_ASSETS) -> None:
        self._config = config
        self._assets = assets
        self._bullet = import_pybullet()
        with quiet():
            self._client: int = self._bullet.connect(self._bullet.DIRECT)
        self._folder = tempfile.TemporaryDirectory(prefix="langwm-tiny-")
        self._models: dict[SceneSpec, list[Model]] = {}
        """Files of the scenes seen so far; the key has no palette."""
        self._textures: dict[Texture, int] = {}
        self._files: dict[Texture, Path] = {}
        self._bodies: list[tuple[int, int]] = []
        """Body and texture of every group."""
        self._instance_of_body = np.zeros(1, np.uint16)
        self._scene: SceneSpec | None = None
        self._shown: tuple[Texture, ...] = ()

    def load(self, scene: SceneSpec) -> None:
        """Replace the scene held."""
        self._bullet.resetSimulation(physicsClientId=self._client)
        self._textures.clear()
        models = self._write_models(scene)
        self._bodies = [(self._add(model), model.texture) for model in models]
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
            self._models[geometry] = list(_write_groups(scene_mesh(scene, self._assets), folder))
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
        scene = self._scene
        if scene is None or scene.palette == self._shown:
            return
        textures = (*scene.palette, *scene_mesh(scene, self._assets).own)
        for body, number in self._bodies:
            self._bullet.changeVisualShape(
                body,
                -1,
                textureUniqueId=self._texture(textures[number]),
                rgbaColor=(1, 1, 1, 1),
                physicsClientId=self._client,
            )
        self._shown = scene.palette

    def _texture(self, texture: Texture) -> int:
        if texture not in self._textures:
            if texture not in self._files:
                # PyBullet reads textures from files only; of its formats BMP is the quickest to read.
                path = Path(self._folder.name) / f"texture-{len(self._files)}.bmp"
                cv2.imwrite(str(path), self._patch(texture)[..., ::-1])
                self._files[texture] = path
            path = self._files[texture]
            self._textures[texture] = self._bullet.loadTexture(str(path), physicsClientId=self._client)
        return self._textures[texture]

    def _patch(self, texture: Texture) -> NDArray[np.uint8]:
        """A texture as PyBullet gets it: a material of the palette repeated over ``PATCH_M`` metres."""
        picture = texture_picture(texture, self._assets, self._config.texture_px)
        if not isinstance(texture, MaterialRef):
            return picture
        tile_m = texture_tile_m(texture)
        repeats = round(PATCH_M / tile_m)
        assert repeats * tile_m == PATCH_M, texture.category
        return np.tile(picture, (repeats, repeats, 1))


def _write_groups(mesh: SceneMesh, folder: Path) -> Iterator[Model]:
    """A file for each instance and texture, in their order."""
    face = mesh.faces[mesh.triangles[:, 0]]
    tile_m = np.where(mesh.face_tile_m > 0, mesh.face_tile_m, PATCH_M)
    keys = np.stack([mesh.face_instance[face], mesh.face_texture[face]], axis=1)
    groups, group_of = np.unique(keys, axis=0, return_inverse=True)
    for number, (instance, texture) in enumerate(groups.tolist()):
        mine = np.flatnonzero(group_of == number)
        used, triangles = np.unique(mesh.triangles[mine], return_inverse=True)
        triangles = triangles.reshape(-1, 3)
        path = folder / f"{instance}-{texture}.obj"
        path.write_text(
            _obj_text(
                mesh.vertices[used].astype(np.float64),
                mesh.normals[used].astype(np.float64),
                mesh.uvs[used] / tile_m[mesh.faces[used]][:, None],
                triangles,
                triangles[mesh.is_two_sided[mine]],
            )
        )
        yield Model(instance=instance, texture=texture, path=path)


def _obj_text(
    vertices: Floats,
    normals: Floats,
    uvs: Floats,
    triangles: NDArray[np.intp],
    two_sided: NDArray[np.intp],
) -> str:
    """A mesh as a Wavefront file, texture coordinates in widths of the texture.

    TinyRenderer leaves out triangles that turn away, so some are there a second time the other way round.
    """
    # TinyRenderer wraps positive coordinates only.
    uvs = uvs - np.floor(uvs.min(axis=0))
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in uvs.tolist()]
    lines += [f"vn {x:.9g} {y:.9g} {z:.9g}" for x, y, z in _wrapped_normals(normals).tolist()]
    if len(two_sided):
        lines += [f"vn {x:.9g} {y:.9g} {z:.9g}" for x, y, z in _wrapped_normals(-normals).tolist()]
    lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in (triangles + 1).tolist()]
    n = len(vertices)
    lines += [f"f {c}/{c}/{c + n} {b}/{b}/{b + n} {a}/{a}/{a + n}" for a, b, c in (two_sided + 1).tolist()]
    return "\n".join(lines) + "\n"


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
