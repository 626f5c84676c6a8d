"""Let loose objects fall and come to rest, and check that a scene is physically sound."""

import dataclasses
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from langwm_data.scenes.spec import ObjectSpec, Quat, SceneSpec, Vec3
from langwm_data.sim.collision import Solids
from langwm_data.sim.mesh import Mesh, part_mesh, rotation_matrix

PHYSICS_HZ = 240
MAX_SECONDS = 8.0
REST_STEPS = 60
"""Objects have come to rest when none has drifted over so many steps; contacts may make them tremble."""
REST_DRIFT_M = 0.0005
REST_TURN_RAD = 0.005

DENSITY_KG_M3 = 300.0
MAX_TILT_RAD = 0.2
MAX_DROP_M = 0.1
"""A loose object is put down, not thrown: it starts at most this far above its place."""
MAX_PENETRATION_M = 0.005
MAX_FLOAT_M = 0.02
"""Everything stands on, hangs on or leans against something that is no further away."""

Pose = tuple[Vec3, Quat]


def settle(scene: SceneSpec) -> SceneSpec:
    """The scene with its loose objects at rest where gravity takes them.

    Raises:
        ValueError: If an object falls over, falls down, keeps moving, floats, or is stuck in another.
    """
    loose = [obj for obj in scene.objects if not obj.is_fixed]
    if loose:
        poses = _drop(scene, loose)
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
    category, model = scene.instances()[instance]
    return f"{category} {instance} ({model})"


def _check_landing(scene: SceneSpec, obj: ObjectSpec, position: Vec3, orientation: Quat) -> None:
    up_before, up_after = (rotation_matrix(q)[:, 2] for q in (obj.orientation, orientation))
    tilt = float(np.arccos(np.clip(up_before @ up_after, -1, 1)))
    name = f"scene {scene.name!r}: {_describe(scene, obj.instance)}"
    if tilt > MAX_TILT_RAD:
        raise ValueError(f"{name} falls over: it tilts by {np.degrees(tilt):.0f} degrees")
    moved = np.subtract(obj.position, position)
    if np.abs(moved).max() > MAX_DROP_M:
        raise ValueError(f"{name} does not stay in its place: it moves by {np.linalg.norm(moved):.2f} m")


def _drop(scene: SceneSpec, loose: Sequence[ObjectSpec]) -> list[Pose]:
    falling = {obj.instance for obj in loose}
    solids = Solids(scene, keep=lambda instance: instance not in falling)
    try:
        with tempfile.TemporaryDirectory(prefix="langwm-hulls-") as folder:
            bodies = [_add_loose(solids, obj, Path(folder)) for obj in loose]
            starts = [_pose(solids, body) for body in bodies]
            _simulate(solids, scene, loose, bodies)
            ends = [_pose(solids, body) for body in bodies]
    finally:
        solids.close()
    return [_moved(solids, *poses) for poses in zip(loose, starts, ends, strict=True)]


def _add_loose(solids: Solids, obj: ObjectSpec, folder: Path) -> int:
    """A dynamic body made of the convex hulls of the object's parts."""
    bullet, client = solids.bullet, solids.client
    path = folder / f"{obj.instance}.obj"
    meshes = [part_mesh(part) for part in obj.parts]
    path.write_text(_obj_text(meshes))
    shape = bullet.createCollisionShape(bullet.GEOM_MESH, fileName=str(path), physicsClientId=client)
    body = bullet.createMultiBody(
        baseMass=DENSITY_KG_M3 * sum(_volume(mesh) for mesh in meshes),
        baseCollisionShapeIndex=shape,
        baseInertialFramePosition=_center_of_mass(meshes),
        basePosition=obj.position,
        baseOrientation=obj.orientation,
        physicsClientId=client,
    )
    bullet.changeDynamics(
        body,
        -1,
        lateralFriction=0.7,
        rollingFriction=0.002,
        spinningFriction=0.002,
        linearDamping=0.2,
        angularDamping=0.2,
        physicsClientId=client,
    )
    return body


def _obj_text(meshes: Sequence[Mesh]) -> str:
    lines, first = [], 1
    for i, mesh in enumerate(meshes):
        lines.append(f"o part{i}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.triangles + first]
        first += len(mesh.vertices)
    return "\n".join(lines) + "\n"


def _volume(mesh: Mesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _center_of_mass(meshes: Sequence[Mesh]) -> list[float]:
    """Of solids of one density: each tetrahedron from the origin to a triangle, weighted by its volume."""
    moment, total = np.zeros(3), 0.0
    for mesh in meshes:
        a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
        volumes = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        moment += volumes @ (a + b + c) / 4
        total += float(volumes.sum())
    return (moment / total).tolist()


def _simulate(solids: Solids, scene: SceneSpec, loose: Sequence[ObjectSpec], bodies: Sequence[int]) -> None:
    bullet, client = solids.bullet, solids.client
    bullet.setGravity(0, 0, -9.81, physicsClientId=client)
    bullet.setPhysicsEngineParameter(
        fixedTimeStep=1 / PHYSICS_HZ, deterministicOverlappingPairs=1, physicsClientId=client
    )
    poses, moving = [_pose(solids, body) for body in bodies], [0]
    for _ in range(round(MAX_SECONDS * PHYSICS_HZ / REST_STEPS)):
        for _ in range(REST_STEPS):
            bullet.stepSimulation(physicsClientId=client)
        before, poses = poses, [_pose(solids, body) for body in bodies]
        moving = [i for i, pair in enumerate(zip(before, poses, strict=True)) if _has_drifted(*pair)]
        if not moving:
            return
    name = _describe(scene, loose[moving[0]].instance)
    raise ValueError(f"scene {scene.name!r}: {name} does not come to rest in {MAX_SECONDS:g} s")


def _has_drifted(before: Pose, after: Pose) -> bool:
    same = min(1.0, abs(float(np.dot(before[1], after[1]))))
    return math.dist(before[0], after[0]) > REST_DRIFT_M or 2 * math.acos(same) > REST_TURN_RAD


def _pose(solids: Solids, body: int) -> Pose:
    return solids.bullet.getBasePositionAndOrientation(body, physicsClientId=solids.client)


def _moved(solids: Solids, obj: ObjectSpec, start: Pose, end: Pose) -> Pose:
    """The object's pose after the motion from ``start`` to ``end`` of its centre of mass."""
    bullet = solids.bullet
    motion = bullet.multiplyTransforms(*end, *bullet.invertTransform(*start))
    position, orientation = bullet.multiplyTransforms(*motion, obj.position, obj.orientation)
    # A tenth of a millimetre is far below what the simulation can promise.
    x, y, z = (round(float(v), 4) for v in position)
    unit = np.asarray(orientation) / np.linalg.norm(orientation)
    qx, qy, qz, qw = (round(float(v), 6) for v in unit * (1.0 if unit[3] >= 0 else -1.0))
    return (x, y, z), (qx, qy, qz, qw)
