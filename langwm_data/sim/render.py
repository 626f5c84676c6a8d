"""Which renderer draws, by configuration and by what this machine has."""

import dataclasses
import logging
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from typing import Literal

import numpy as np

from langwm_data.config import RenderConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.assets import NO_ASSETS, Assets
from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.frame import Frame, Renderer
from langwm_data.sim.lights import Lights

_log = logging.getLogger(__name__)


class BlindRenderer:
    """Draws nothing: black frames without depth, for whoever reads no pixels and should not wait for them."""

    name = "blind"

    def load(self, scene: SceneSpec) -> None:
        """Nothing to hold."""

    def set_palette(self, palette: Sequence[MaterialRef]) -> None:
        """Nothing to change."""

    def set_lights(self, lights: Lights) -> None:
        """Nothing to light."""

    def render(self, camera: Camera) -> Frame:
        """A frame of zeros."""
        size = (camera.height, camera.width)
        return Frame(
            rgb=np.zeros((*size, 3), np.uint8),
            depth=np.zeros(size, np.float32),
            instance=np.zeros(size, np.uint16),
        )

    def close(self) -> None:
        """Nothing to free."""


def make_renderer(config: RenderConfig, assets: Assets = NO_ASSETS) -> Renderer:
    """The renderer that ``config`` asks for. Engines are imported only when one is made.

    Args:
        config: Which one, and how it draws.
        assets: Where the meshes and pictures of its scenes lie.
    """
    backend = resolve_backend(config).backend
    if backend == "gl":
        from langwm_data.sim.render_gl import GlRenderer

        return GlRenderer(config, assets)
    if backend == "embree":
        from langwm_data.sim.render_embree import EmbreeRenderer

        return EmbreeRenderer(config, assets)
    from langwm_data.sim.render_tiny import TinyRenderer

    return TinyRenderer(config, assets)


def resolve_backend(config: RenderConfig) -> RenderConfig:
    """``config`` with ``auto`` replaced by what it means on this machine."""
    if config.backend != "auto":
        return config
    return dataclasses.replace(config, backend=_best_backend(config.egl_device))


def describe_renderer(config: RenderConfig) -> str:
    """What draws on this machine, down to versions: pictures are the same bytes where this is the same.

    Raises:
        ConfigError: If ``config`` asks for ``gl`` and it does not open.
    """
    backend = resolve_backend(config).backend
    if backend == "gl":
        from langwm_data.sim.gl_device import gl_device

        return f"gl: {gl_device(config.egl_device).description}"
    return f"embree {version('embreex')}" if backend == "embree" else f"tiny {version('pybullet')}"


@cache
def _best_backend(egl_device: int) -> Literal["gl", "embree"]:
    from langwm_data.sim.gl_device import gl_device

    try:
        device = gl_device(egl_device)
    except ConfigError as error:
        _log.info("renderer: embree; %s", error)
        return "embree"
    _log.info("renderer: gl; %s", device.description)
    return "gl"
