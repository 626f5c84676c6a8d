"""What a renderer is: the protocol that every backend follows, and the frame it returns."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from langwm_data.scenes.spec import MaterialRef, SceneSpec
from langwm_data.sim.camera import Camera
from langwm_data.sim.lights import Lights


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One rendered view: three images of the same size."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth: NDArray[np.float32]
    """(H, W), metres along the optical axis, 0 where nothing was hit."""
    instance: NDArray[np.uint16]
    """(H, W), 0 = background."""


class Renderer(Protocol):
    """Holds one scene at a time and draws it from any camera."""

    name: str

    def load(self, scene: SceneSpec) -> None:
        """Replace the scene held."""
        ...

    def set_palette(self, palette: Sequence[MaterialRef]) -> None:
        """Change the materials of the scene held, keeping its geometry."""
        ...

    def set_lights(self, lights: Lights) -> None:
        """Change the lights, from those of the config on; they stay whatever scene is loaded."""
        ...

    def render(self, camera: Camera) -> Frame:
        """Draw the scene held. Same scene, palette, lights and camera: same bytes, whatever came before."""
        ...

    def close(self) -> None:
        """Free what the renderer holds."""
        ...
