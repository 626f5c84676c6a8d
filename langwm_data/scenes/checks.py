"""What must hold for every scene, whoever made it: nothing stands in another thing or in a wall.

Owns the geometric check of a description; physics has its own in ``sim.world``.
"""

import numpy as np

from langwm_data.scenes.geometry import Array, Boxes
from langwm_data.scenes.spec import IDENTITY, SceneSpec


def overlapping_pairs(scene: SceneSpec, *, tolerance_m: float = 0.002) -> list[tuple[int, int]]:
    """Pairs of instances that share space, the smaller id first; touching is not sharing.

    Objects are compared with each other and with walls, floors and ceilings, part by part. Round
    parts count as the boxes around them, so the answer errs towards overlap.

    Args:
        scene: Any scene.
        tolerance_m: How deep two parts may reach into each other.
    """
    bodies = _bodies(scene)
    bounds = np.array([_around(boxes) for _, boxes in bodies])
    reach = tolerance_m
    pairs = []
    num_surfaces = len(scene.surfaces)
    for i in range(len(bodies)):
        first = max(i + 1, num_surfaces)
        near = (bounds[first:, 0] < bounds[i, 1] - reach) & (bounds[i, 0] < bounds[first:, 1] - reach)
        for j in first + np.flatnonzero(near.all(axis=1)):
            if bodies[i][1].overlap(bodies[j][1], tolerance_m=tolerance_m).any():
                a, b = sorted((bodies[i][0], bodies[j][0]))
                pairs.append((a, b))
    return sorted(set(pairs))


def _bodies(scene: SceneSpec) -> list[tuple[int, Boxes]]:
    """Surfaces one by one, then objects whole: instance and boxes."""
    origin = (0.0, 0.0, 0.0)
    surfaces = [(s.instance, Boxes.of_parts([(origin, IDENTITY, s.part)])) for s in scene.surfaces if s.part]
    objects = [
        (o.instance, Boxes.of_parts((o.position, o.orientation, part) for part in o.parts))
        for o in scene.objects
    ]
    return surfaces + objects


def _around(boxes: Boxes) -> Array:
    bounds = boxes.bounds
    return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
