"""The lights of a home: how bright, which colour, and where the directional one comes from.

Owns drawing them at random. What they do to a surface stands in ``shading``.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from langwm_data.config import LightLimits, LightsConfig

Color = tuple[float, float, float]
Direction = tuple[float, float, float]

SUN_DIRECTION: Direction = (0.64, 0.38, 0.67)
"""Towards the directional light, unit length; all six directions of walls, floor and ceiling differ."""
_SUN_HEIGHT_RAD = (math.radians(25), math.radians(65))
_XYZ_TO_RGB = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))
"""Source: IEC 61966-2-1 (sRGB)."""


@dataclass(frozen=True, kw_only=True)
class Lights:
    """Strengths by red, green and blue; where their sum exceeds 1 a texture looks as it was drawn."""

    ambient: Color
    sun: Color
    lamp: Color
    sun_direction: Direction = SUN_DIRECTION
    """Towards the sun, unit length."""

    @classmethod
    def of(cls, config: LightsConfig) -> Self:
        """White lights as bright as the config says."""
        ambient, sun, lamp = ((s, s, s) for s in (config.ambient, config.sun, config.lamp))
        return cls(ambient=ambient, sun=sun, lamp=lamp)

    @classmethod
    def parse(cls, document: dict[str, Any]) -> Self:
        """The inverse of ``describe``."""
        return cls(**{name: tuple(values) for name, values in document.items()})

    def describe(self) -> dict[str, list[float]]:
        """As they stand in a sample's JSON."""
        return {name: [float(v) for v in values] for name, values in dataclasses.asdict(self).items()}


def sample_lights(rng: np.random.Generator, config: LightsConfig, limits: LightLimits) -> Lights:
    """Lights around those of ``config``: each with a strength and a warmth of its own."""
    colors: list[Color] = []
    for strength in (config.ambient, config.sun, config.lamp):
        factor = strength * rng.uniform(*limits.light_factor)
        tint = black_body_tint(rng.uniform(*limits.light_temperature_k))
        colors.append((factor * tint[0], factor * tint[1], factor * tint[2]))
    azimuth, height = rng.uniform(-math.pi, math.pi), rng.uniform(*_SUN_HEIGHT_RAD)
    level = math.cos(height)
    direction = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(height))
    return Lights(ambient=colors[0], sun=colors[1], lamp=colors[2], sun_direction=direction)


def chromaticity(temperature_k: float) -> tuple[float, float]:
    """CIE 1931 x, y of a black body between 2222 and 25,000 K.

    Source: Kim et al. 2002, US patent 7024034 (cubic approximation of the Planckian locus).
    """
    t = 1000 / temperature_k
    if temperature_k <= 4000:
        x = -0.2661239 * t**3 - 0.2343589 * t**2 + 0.8776956 * t + 0.179910
        return x, -0.9549476 * x**3 - 1.37418593 * x**2 + 2.09137015 * x - 0.16748867
    x = -3.0258469 * t**3 + 2.1070379 * t**2 + 0.2226347 * t + 0.240390
    return x, 3.0817580 * x**3 - 5.87338670 * x**2 + 3.75112997 * x - 0.37001483


def black_body_tint(temperature_k: float) -> Color:
    """Displayed red, green and blue of a black body, the greatest of them 1; 6500 K is about white."""
    x, y = chromaticity(temperature_k)
    linear = np.clip(np.array(_XYZ_TO_RGB) @ (x / y, 1.0, (1 - x - y) / y), 0, None)
    red, green, blue = ((linear / linear.max()) ** (1 / 2.2)).tolist()
    return red, green, blue
