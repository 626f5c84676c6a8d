"""Ray casting with Embree behind the renderer protocol: needs nothing but pip.

A ray through the centre of every pixel finds depth, face and colour; more rays near edges find the faces
that ``antialias`` asks for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import RenderConfig
from langwm_data.scenes.assets import NO_ASSETS, Assets
from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.sim.antialias import QUARTERS, find_open_quarters, smooth_edges
from langwm_data.sim.atlas import Atlas, Blocks, look_up, texel_density
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Frame
from langwm_data.sim.lights import Lights
from langwm_data.sim.scene_mesh import SCENES_KEPT, SceneMesh, scene_mesh
from langwm_data.sim.shading import level_of_detail, light, pixel_to_ray

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """What rays hit first."""

    depth: Floats
    """(N,), metres along the optical axis; 0 for nothing."""
    face: Ints
    """(N,); 0 for nothing."""
    normal: Floats
    """(3, N)."""
    uv: Floats
    """(2, N), metres along the surface."""


class RayCaster:
    """The triangles of one scene, ready to be hit."""

    def __init__(self, mesh: SceneMesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene: Any = EmbreeScene()
        self._triangles = TriangleMesh(self._scene, mesh.vertices, mesh.triangles)
        # One entry more, for rays that hit nothing: Embree numbers it -1.
        self._face = np.append(mesh.faces[mesh.triangles[:, 0]], np.int32(0))
        corners = np.concatenate([mesh.normals, mesh.uvs], axis=1)[mesh.triangles]
        corners[:, 1:] -= corners[:, :1]
        self._corners = np.zeros((15, len(corners) + 1), np.float32)
        self._corners[:, :-1] = corners.reshape(-1, 15).T
        # Zero for triangles that are only ever seen from before: their normals stay as they are.
        self._behind = np.zeros((3, len(corners) + 1), np.float32)
        self._behind[:, :-1] = (mesh.planes[:, :3] * mesh.is_two_sided[:, None]).T

    def faces(self, camera: Camera, rays: Floats) -> Ints:
        """The face (N,) that each ray (N, 3) hits; 0 for none."""
        return self._face[self._scene.run(_on_near_plane(camera, rays), rays)]

    def surfaces(self, camera: Camera, rays: Floats) -> Surfaces:
        """What each ray (N, 3) hits."""
        hit = self._scene.run(_on_near_plane(camera, rays), rays, output=True)
        triangle, u, v = hit["primID"], hit["u"], hit["v"]
        depth = hit["tfar"] + np.float32(camera.near_m)
        face = self._face[triangle] * (depth < camera.far_m)
        depth[face == 0] = 0
        first, second, third = self._corners.take(triangle, axis=1, mode="wrap").reshape(3, 5, -1)
        normal_and_uv = first + u * second + v * third
        is_from_behind = np.einsum("kn,nk->n", self._behind.take(triangle, axis=1, mode="wrap"), rays) > 0
        normal_and_uv[:3, is_from_behind] *= -1
        return Surfaces(depth=depth, face=face, normal=normal_and_uv[:3], uv=normal_and_uv[3:])


def _on_near_plane(camera: Camera, rays: Floats) -> Floats:
    return rays * np.float32(camera.near_m) + np.asarray(camera.position, np.float32)


# Meshes are compared by identity, and ``scene_mesh`` keeps as many.
_ray_caster = lru_cache(maxsize=SCENES_KEPT)(RayCaster)


class TextureStore:
    """An atlas in memory; all renderers of a process with textures as fine share one."""

    def __init__(self, texture_px: int) -> None:
        self.picture = np.zeros((*Atlas.shape(texture_px), 3), np.uint8)
        self.atlas = Atlas(texture_px, self._write)

    def _write(self, x: int, y: int, block: NDArray[np.uint8]) -> None:
        height, width = block.shape[:2]
        self.picture[y : y + height, x : x + width] = block


_texture_store = cache(TextureStore)


class EmbreeRenderer:
    """Holds one scene at a time and draws it on the CPU."""

    name = "embree"

    def __init__(self, config: RenderConfig, assets: Assets = NO_ASSETS) -> None:
        self._config = config
        self._assets = assets
        self._lights = Lights.of(config.lights)
        self._store = _texture_store(config.texture_px)
        self._scene: SceneSpec | None = None

    def load(self, scene: SceneSpec) -> None:
        """Replace the scene held."""
        self._scene, self._mesh = scene, scene_mesh(scene, self._assets)
        self._caster = _ray_caster(self._mesh)
        self._use_palette()

    def set_palette(self, palette: Sequence[MaterialRef]) -> None:
        """Change the materials of the scene held, keeping its geometry.

        Raises:
            ValueError: If the palette does not fit the scene.
        """
        assert self._scene is not None, "load a scene first"
        self._scene = self._scene.with_palette(palette)
        self._use_palette()

    def set_lights(self, lights: Lights) -> None:
        """Change the lights, keeping the scene and its materials."""
        self._lights = lights

    def render(self, camera: Camera) -> Frame:
        """Draw the scene held."""
        assert self._scene is not None, "load a scene first"
        shape = camera.height, camera.width
        to_ray = pixel_to_ray(camera)
        rays = _center_rays(camera, to_ray)
        hit = self._caster.surfaces(camera, rays)
        rgb = self._shade(camera, np.ascontiguousarray(rays.T), hit).reshape(*shape, 3)
        faces = hit.face.reshape(shape)
        if self._config.is_antialiased:
            quarters = find_open_quarters(faces)
            steps = (QUARTERS / 4) @ to_ray[:, 1::-1].T
            through = rays[quarters.pixel] + steps.astype(np.float32)[quarters.number]
            smooth_edges(rgb, faces, quarters, self._caster.faces(camera, through))
        return Frame(rgb=rgb, depth=hit.depth.reshape(shape), instance=self._mesh.face_instance[faces])

    def close(self) -> None:
        """Forget the scene held; a second call does nothing."""
        self._scene = None

    def _use_palette(self) -> None:
        assert self._scene is not None
        textures = [*self._scene.palette, *self._mesh.own]
        self._blocks = Blocks(self._store.atlas, textures, self._assets)

    def _shade(self, camera: Camera, ray: Floats, hit: Surfaces) -> NDArray[np.uint8]:
        """Colours (N, 3) of what rays (3, N) hit."""
        texture = self._mesh.face_texture[hit.face]
        self._blocks.fill_seen(texture)
        block = self._blocks.table.T.take(texture, axis=1)
        texture_px = self._config.texture_px
        density = texel_density(self._mesh.face_tile_m[hit.face], block[2], texture_px)
        level = level_of_detail(hit.normal, ray, hit.depth, texture_px / camera.focal_px)
        level += np.log2(density / texture_px)
        color = look_up(self._store.picture, block, hit.uv * (density / block[2]), level)
        eye = np.asarray(camera.position, np.float32)[:, None]
        to_lamp = self._mesh.face_lamp.T.take(hit.face, axis=1)
        to_lamp -= eye + ray * hit.depth
        brightness = light(hit.normal, to_lamp, self._lights) * (hit.face > 0)
        planes = (color * brightness + np.float32(0.5)).astype(np.uint8)
        return np.ascontiguousarray(planes.T)


def _center_rays(camera: Camera, to_ray: NDArray[np.float64]) -> Floats:
    """(H W, 3): from the eye through the centre of each pixel to one metre along the optical axis."""
    across, down, corner = to_ray.T
    columns = (np.arange(camera.width)[:, None] + 0.5) * across
    rows = (np.arange(camera.height)[:, None] + 0.5) * down + corner
    return (rows.astype(np.float32)[:, None] + columns.astype(np.float32)).reshape(-1, 3)
