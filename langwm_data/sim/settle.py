"""Let loose objects fall and come to rest, and check that a scene is physically sound."""

import dataclasses

import numpy as np

from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.spec import ObjectSpec, Quat, SceneSpec, Vec3
from langwm_data.sim.collision import Solids
from langwm_data.sim.drop import drop

MAX_TILT_RAD = 0.2
MAX_DROP_M = 0.1
"""A loose object is put down, not thrown: it starts at most this far above its place."""
MAX_PENETRATION_M = 0.005
MAX_FLOAT_M = 0.02
"""Everything stands on, hangs on or leans against something that is no further away."""


def settle(scene: SceneSpec) -> SceneSpec:
    """The scene with its loose objects at rest where gravity takes them.

    Raises:
        ValueError: If an object falls over, falls down, keeps moving, floats, or is stuck in another.
    """
    loose = [obj for obj in scene.objects if not obj.is_fixed]
    if loose:
        poses = drop(scene, loose)
        for obj, (position, orientation) in zip(loose, poses, strict=True):
            _check_landing(scene, obj, position, orientation)
        moved = {
            obj.instance: dataclasses.replace(obj, position=position, orientation=orientation)
            for obj, (position, orientation) in zip(loose, poses, strict=True)
        }
        objects = tuple(moved.get(obj.instance, obj) for obj in scene.objects)
        scene = dataclasses.replace(scene, objects=objects)
    check_contacts(scene)
    return scene


def check_contacts(scene: SceneSpec) -> None:
    """Refuse a scene in which objects overlap each other or the building, or touch nothing.

    Raises:
        ValueError: Naming the objects and by how much they overlap.
    """
    objects = {obj.instance for obj in scene.objects}
    touched: set[int] = set()
    solids = Solids(scene)
    try:
        for i, j, gap in solids.iter_neighbours(MAX_FLOAT_M):
            pair = int(solids.instances[i]), int(solids.instances[j])
            if gap.distance < -MAX_PENETRATION_M and objects & set(pair):
                first, second = (_describe(scene, instance) for instance in pair)
                raise ValueError(
                    f"scene {scene.name!r}: {first} and {second} overlap by {-1000 * gap.distance:.0f} mm"
                )
            touched.update(pair)
    finally:
        solids.close()
    for obj in scene.objects:
        if obj.instance not in touched:
            raise ValueError(
                f"scene {scene.name!r}: {_describe(scene, obj.instance)} floats: nothing is near"
            )


def _describe(scene: SceneSpec, instance: int) -> str:
    name = scene.instances()[instance]
    return f"{name.category} {instance} ({name.model})"


def _check_landing(scene: SceneSpec, obj: ObjectSpec, position: Vec3, orientation: Quat) -> None:
    up_before, up_after = (quat_matrix(q)[:, 2] for q in (obj.orientation, orientation))
    tilt = float(np.arccos(np.clip(up_before @ up_after, -1, 1)))
    name = f"scene {scene.name!r}: {_describe(scene, obj.instance)}"
    if tilt > MAX_TILT_RAD:
        raise ValueError(f"{name} falls over: it tilts by {np.degrees(tilt):.0f} degrees")
    moved = np.subtract(obj.position, position)
    if np.abs(moved).max() > MAX_DROP_M:
        raise ValueError(f"{name} does not stay in its place: it moves by {np.linalg.norm(moved):.2f} m")
