"""An OpenGL context with its programs, textures and targets, shared by all renderers of a thread.

Pictures are made in three passes. ``surfaces`` draws what each pixel's centre sees: depth, face, texture
coordinates, normal. ``faces`` draws faces alone at twice the size, for ``antialias``. ``colors`` shades
every pixel once from what the first pass left.
"""

import os
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from langwm_data.config_io import ConfigError
from langwm_data.sim import atlas, shading
from langwm_data.sim.atlas import Atlas

FACE_COLUMNS = 4096
"""A face's texture stands in the table of faces at column face % 4096, row 2 * (face // 4096); its lamp
and how many texels its texture has to a metre one row below."""
_UNITS = {"atlas": 0, "face_table": 1, "surface": 2, "uvs": 3, "normals": 4}

_SURFACE_VERTICES = """#version 330
uniform mat4 world_to_clip;
in vec3 position; in vec3 normal; in vec2 uv; in float face;
out vec3 surface_normal; out vec2 surface_uv; flat out float surface_face;

void main() {
    surface_normal = normal;
    surface_uv = uv;
    surface_face = face;
    gl_Position = world_to_clip * vec4(position, 1.0);
}
"""
_SURFACES = """#version 330
in vec3 surface_normal; in vec2 surface_uv; flat in float surface_face;
layout(location = 0) out vec2 surface;  // depth in metres, face
layout(location = 1) out vec2 uv;
layout(location = 2) out vec4 normal;

void main() {
    surface = vec2(1.0 / gl_FragCoord.w, surface_face);
    uv = surface_uv;
    // Pictures are drawn upside down, which turns fronts into backs.
    vec3 towards_eye = gl_FrontFacing ? -surface_normal : surface_normal;
    normal = vec4((towards_eye * 127.0 + 128.0) / 255.0, 1.0);
}
"""
_FACE_VERTICES = """#version 330
uniform mat4 world_to_clip;
in vec3 position; in float face;
flat out float surface_face;

void main() {
    surface_face = face;
    gl_Position = world_to_clip * vec4(position, 1.0);
}
"""
_FACES = """#version 330
flat in float surface_face;
out float face;

void main() { face = surface_face; }
"""
_SCREEN_VERTICES = """#version 330
void main() { gl_Position = vec4(vec2(gl_VertexID % 2, gl_VertexID / 2) * 4.0 - 1.0, 0.0, 1.0); }
"""
_COLORS = f"""#version 330
uniform sampler2D surface; uniform sampler2D uvs; uniform sampler2D normals; uniform sampler2D face_table;
uniform vec3 eye;
uniform mat3 pixel_to_ray;
uniform float texels_per_metre;
out vec4 color;
{shading.SHADER}
{atlas.SHADER}
void main() {{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec2 depth_and_face = texelFetch(surface, at, 0).xy;
    float z = depth_and_face.x;
    int face = int(depth_and_face.y);
    ivec2 entry = ivec2(face % {FACE_COLUMNS}, 2 * (face / {FACE_COLUMNS}));
    vec4 block = texelFetch(face_table, entry, 0);
    vec4 lamp_and_density = texelFetch(face_table, entry + ivec2(0, 1), 0);
    vec3 lamp = lamp_and_density.xyz;
    float density = lamp_and_density.w;
    vec3 normal = (texelFetch(normals, at, 0).xyz * 255.0 - 128.0) / 127.0;
    vec3 ray = pixel_to_ray * vec3(gl_FragCoord.xy, 1.0);
    vec2 tile = texelFetch(uvs, at, 0).xy * (density / block.z);
    float level = level_of_detail(normal, ray, z) + log2(density / texels_per_metre);
    vec3 texture_color = look_up(block, tile, level);
    vec3 lit = texture_color * light(normal, lamp - (eye + ray * z));
    color = face == 0 ? vec4(0.0) : vec4(lit, 1.0);
}}
"""


@dataclass(frozen=True, kw_only=True)
class Targets:
    """What is drawn into, for one size of picture."""

    centers: Any
    """Depth with face, texture coordinates and normal at the centre of every pixel."""
    quarters: Any
    """Faces at twice the size: at the middles of the four quarters of every pixel."""
    picture: Any
    """Colours."""


class GlDevice:
    """Draws triangles and shades pictures. Made by ``gl_device``."""

    def __init__(self, index: int) -> None:
        self.context = _open_context(index)
        self.surfaces = self._program(_SURFACE_VERTICES, _SURFACES)
        self.faces = self._program(_FACE_VERTICES, _FACES)
        self.colors = self._program(_SCREEN_VERTICES, _COLORS)
        for name, unit in _UNITS.items():
            self.colors[name] = unit
        self._screen = self.context.vertex_array(self.colors, [])
        self._targets: dict[tuple[int, int], Targets] = {}
        self._atlases: dict[int, tuple[Atlas, Any]] = {}

    @property
    def description(self) -> str:
        """What draws: names of the device and of the driver."""
        return f"{self.context.info['GL_RENDERER']}, OpenGL {self.context.info['GL_VERSION']}"

    def _program(self, vertices: str, fragments: str) -> Any:  # noqa: ANN401
        return self.context.program(vertex_shader=vertices, fragment_shader=fragments)

    def atlas(self, texture_px: int) -> tuple[Atlas, Any]:
        """The atlas of all renderers with textures this fine, and the picture that it fills."""
        if texture_px not in self._atlases:
            rows, columns = Atlas.shape(texture_px)
            picture = self.context.texture((columns, rows), 4)
            picture.filter = (self.context.LINEAR, self.context.LINEAR)

            def write(x: int, y: int, block: NDArray[np.uint8]) -> None:
                height, width = block.shape[:2]
                opaque = np.dstack([block, np.full((height, width), 255, np.uint8)])
                picture.write(opaque, viewport=(x, y, width, height))

            self._atlases[texture_px] = Atlas(texture_px, write), picture
        return self._atlases[texture_px]

    def targets(self, width: int, height: int) -> Targets:
        """What pictures of this size are drawn into."""
        if (width, height) not in self._targets:
            make, size, double = self.context, (width, height), (2 * width, 2 * height)
            centers = [make.texture(size, 2, dtype="f4"), make.texture(size, 2, dtype="f4")]
            centers.append(make.texture(size, 4))
            quarters = [make.texture(double, 1, dtype="f4")]
            self._targets[width, height] = Targets(
                centers=make.framebuffer(centers, make.depth_renderbuffer(size)),
                quarters=make.framebuffer(quarters, make.depth_renderbuffer(double)),
                picture=make.framebuffer([make.texture(size, 4)]),
            )
        return self._targets[width, height]

    def draw(self, target: Any, triangles: Any, count: int) -> None:  # noqa: ANN401
        """Clear a target and draw the first ``count`` triangles of a vertex array."""
        self.context.enable_only(self.context.DEPTH_TEST)
        target.clear()
        target.use()
        triangles.render(self.context.TRIANGLES, 3 * count)

    def shade(self, targets: Targets, textures: Mapping[str, Any]) -> None:
        """Make ``targets.picture`` from ``targets.centers``, the atlas and the table of faces."""
        self.context.enable_only(self.context.NOTHING)
        surface, uvs, normals = targets.centers.color_attachments
        bound = {"surface": surface, "uvs": uvs, "normals": normals, **textures}
        for name, unit in _UNITS.items():
            bound[name].use(unit)
        targets.picture.use()
        self._screen.render(self.context.TRIANGLES, 3)


def _open_context(index: int) -> Any:  # noqa: ANN401
    import moderngl

    # On pictures this small llvmpipe's threads mostly wait for one another; processes use the cores.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    create: Any = moderngl.create_context
    try:
        return create(standalone=True, backend="egl", require=330, device_index=index)
    except Exception as error:  # glcontext raises nothing more specific
        raise ConfigError(
            f"field 'render.egl_device': value {index} opens no OpenGL ({error}); gl needs a GPU's driver or"
            " Mesa (Debian: libegl1 libgl1-mesa-dri), embree neither"
        ) from error


def gl_device(index: int) -> GlDevice:
    """The device of this process and thread, opened when first asked for.

    Raises:
        ConfigError: If no OpenGL context opens on the EGL device ``index``.
    """
    return _gl_device(index, os.getpid(), threading.get_ident())


@cache
def _gl_device(index: int, _process: int, _thread: int) -> GlDevice:
    # A context lives in the thread that made it, and does not outlive a fork.
    return GlDevice(index)
