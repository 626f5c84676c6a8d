"""Pinhole camera: where it stands, and how pixels and metres belong together.

Camera axes are OpenCV's: x right, y down, z forward. Pixel centres lie at .5. Depth is z-depth.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import CameraConfig

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """One view: image size, field of view and pose. Angles in radians, yaw counter-clockwise from +x."""

    height: int
    width: int
    vertical_fov_rad: float
    position: tuple[float, float, float]
    yaw_rad: float
    pitch_rad: float = 0.0
    """Positive looks up."""
    near_m: float = 0.05
    far_m: float = 40.0

    @classmethod
    def on_robot(cls, config: CameraConfig, xy: tuple[float, float], yaw_rad: float) -> Self:
        """The camera of a robot that stands at ``xy`` and faces ``yaw_rad``."""
        return cls(
            height=config.height,
            width=config.width,
            vertical_fov_rad=math.radians(config.vertical_fov_deg),
            position=(float(xy[0]), float(xy[1]), config.mount_height_m),
            yaw_rad=float(yaw_rad),
            pitch_rad=math.radians(config.pitch_deg),
            near_m=config.near_m,
            far_m=config.far_m,
        )

    @property
    def focal_px(self) -> float:
        """Focal length in pixels; pixels are square."""
        return 0.5 * self.height / math.tan(0.5 * self.vertical_fov_rad)

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """K, 3x3, in pixels."""
        f = self.focal_px
        return np.array([[f, 0, self.width / 2], [0, f, self.height / 2], [0, 0, 1]], dtype=np.float64)

    @cached_property
    def camera_to_world(self) -> NDArray[np.float64]:
        """4x4, metres: columns are the camera's right, down and forward axes and its position."""
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        forward, right = (cy * cp, sy * cp, sp), (sy, -cy, 0.0)
        columns = [(*right, 0.0), (*_cross(forward, right), 0.0), (*forward, 0.0), (*self.position, 1.0)]
        pose = np.array(list(zip(*columns, strict=True)), dtype=np.float64)
        pose.setflags(write=False)
        return pose

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """World points (N, 3) to (N, 3): pixel x, pixel y, z-depth in metres."""
        pose = self.camera_to_world
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        pixels = local @ self.intrinsics.T
        return np.column_stack([pixels[:, :2] / pixels[:, 2:], local[:, 2]])

    def unproject(self, depth: NDArray[np.float32]) -> NDArray[np.float64]:
        """Z-depth image (H, W) in metres to world points (H, W, 3)."""
        v, u = np.mgrid[0.5 : self.height, 0.5 : self.width]
        rays = np.stack(
            [(u - self.width / 2) / self.focal_px, (v - self.height / 2) / self.focal_px], axis=-1
        )
        local = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1) * depth[..., None]
        pose = self.camera_to_world
        return local @ pose[:3, :3].T + pose[:3, 3]


def _cross(a: Vector, b: Vector) -> Vector:
    """The product that is at right angles to both; for one pair NumPy's takes many times as long."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
