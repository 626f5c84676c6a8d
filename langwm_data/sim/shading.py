"""How bright a surface is and how fine its texture: each formula once for NumPy, once for the shader.

Colours are multiplied as they are displayed: a texture looks as it was drawn where the light is 1, and
no light exceeds 1. There are no shadows. Source: ours (ADR-0008).
"""

import numpy as np
from numpy.typing import NDArray

from langwm_data.sim.camera import Camera
from langwm_data.sim.lights import Lights

SKY = 0.15
"""How much of the ambient light depends on whether a surface looks up or down."""
LAMP_RADIUS_M = 0.6
"""A lamp's light reaches around surfaces as if the lamp were this large; stands for what walls throw back."""
LAMP_REACH_M = 1.5
"""Within this distance a lamp's light hardly falls off; far beyond, it falls with the distance."""
MAX_STRETCH = 16.0
"""Beyond this ratio a pixel's footprint on a surface seen at a grazing angle counts as no longer."""

Floats = NDArray[np.float32]

SHADER = f"""
uniform mat3 lights;  // columns: ambient, sun, lamp
uniform vec3 sun_direction;
uniform float texels;  // of the finest level, per pixel, one metre away

vec3 light(vec3 normal, vec3 to_lamp) {{
    float lamp = max(dot(normal, to_lamp) + {LAMP_RADIUS_M}, 0.0)
        * {LAMP_REACH_M} / (dot(to_lamp, to_lamp) + {LAMP_REACH_M**2});
    float sun = 0.5 + 0.5 * dot(normal, sun_direction);
    float ambient = 1.0 + {SKY} * (normal.z - 1.0);
    return min(lights * vec3(ambient, sun, lamp), 1.0);
}}

float level_of_detail(vec3 normal, vec3 ray, float z) {{
    float squared = dot(ray, ray), across = dot(normal, ray), straight = texels * texels * z * z;
    float stretch = squared / max(across * across, squared * {MAX_STRETCH**-2:.9f});
    return 0.25 * log2(straight * straight * stretch);
}}
"""


def pixel_to_ray(camera: Camera) -> NDArray[np.float64]:
    """3x3: from (x, y, 1) in pixels to the ray from the eye to one metre along the optical axis."""
    return camera.camera_to_world[:3, :3] @ np.linalg.inv(camera.intrinsics)


def light(normal: Floats, to_lamp: Floats, lights: Lights) -> Floats:
    """Brightness of red, green and blue (3, N), 0 to 1, of surfaces with unit normals (3, N), ``to_lamp``
    (3, N) away from a lamp.
    """
    lamp = np.maximum(_dot(normal, to_lamp) + LAMP_RADIUS_M, 0)
    lamp *= LAMP_REACH_M / (_dot(to_lamp, to_lamp) + LAMP_REACH_M**2)
    sun = 0.5 + 0.5 * (np.asarray(lights.sun_direction, np.float32) @ normal)
    ambient = 1 + SKY * (normal[2] - 1)
    colors = np.array([lights.ambient, lights.sun, lights.lamp], np.float32)[..., None]
    return np.minimum(colors[0] * ambient + colors[1] * sun + colors[2] * lamp, 1)


def level_of_detail(normal: Floats, ray: Floats, z: Floats, texels: float) -> Floats:
    """Which level (N,) of a texture has texels as large as a pixel; each level halves the one before.

    Between the footprint's short and its long side: one blurs, the other flickers.

    Args:
        normal: (3, N), unit length.
        ray: (3, N), from the eye to one metre along the optical axis.
        z: (N,), depth along the optical axis, metres; may be 0.
        texels: Texels of level 0 to a pixel that looks straight at a surface one metre away.
    """
    squared, across = _dot(ray, ray), _dot(normal, ray)
    stretch = squared / np.maximum(across * across, squared * np.float32(MAX_STRETCH**-2))
    straight = np.square(np.float32(texels) * np.maximum(z, np.float32(1e-6)))
    return np.float32(0.25) * np.log2(straight * straight * stretch)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("kn,kn->n", a, b)
