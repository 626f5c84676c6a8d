"""Let loose objects fall until they lie still: the only rigid-body dynamics of the project."""

import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from langwm_data.scenes.geometry import Boxes
from langwm_data.scenes.spec import ObjectSpec, PartSpec, Quat, SceneSpec, Vec3
from langwm_data.sim.bullet import connected, import_pybullet
from langwm_data.sim.collision import make_shape, part_pose
from langwm_data.sim.mesh import Mesh, part_mesh

PHYSICS_HZ = 240
MAX_SECONDS = 8.0
REST_STEPS = 60
"""Objects have come to rest when none has drifted over so many steps; contacts may make them tremble."""
REST_DRIFT_M = 0.0005
REST_TURN_RAD = 0.005
DENSITY_KG_M3 = 300.0

_REACH_M = 0.3
"""What is further than this to the side of a loose object, or above it, is out of its way; should it get
there all the same, it has long failed the check of where it landed."""

Pose = tuple[Vec3, Quat]
_OwnedPart = tuple[Vec3, Quat, PartSpec]


def drop(scene: SceneSpec, loose: Sequence[ObjectSpec]) -> list[Pose]:
    """Where gravity takes ``loose`` objects of ``scene``; everything else stands still.

    Raises:
        ValueError: If an object keeps moving.
    """
    with connected() as client, tempfile.TemporaryDirectory(prefix="langwm-hulls-") as folder:
        for part in _supports(scene, loose):
            _add_static(client, *part)
        bodies = [_add_loose(client, obj, Path(folder)) for obj in loose]
        starts = [_pose(client, body) for body in bodies]
        moving = _simulate(client, bodies)
        ends = [_pose(client, body) for body in bodies]
    if moving:
        obj = loose[moving[0]]
        raise ValueError(
            f"scene {scene.name!r}: {obj.category} {obj.instance} ({obj.model}) does not come to rest in"
            f" {MAX_SECONDS:g} s"
        )
    return [_moved(*poses) for poses in zip(loose, starts, ends, strict=True)]


def _supports(scene: SceneSpec, loose: Sequence[ObjectSpec]) -> Iterator[_OwnedPart]:
    """Parts that some loose object may touch: below it at any depth, and close by."""
    falling = {obj.instance for obj in loose}
    parts = [entry[1:] for entry in scene.iter_parts() if entry[0] not in falling]
    bounds = Boxes.of_parts(parts).bounds
    is_near = np.zeros(len(parts), bool)
    for obj in loose:
        boxes = Boxes.of_parts((obj.position, obj.orientation, part) for part in obj.parts).bounds
        low, high = boxes[:, 0].min(axis=0) - _REACH_M, boxes[:, 1].max(axis=0) + _REACH_M
        low[2] = -np.inf
        is_near |= ((bounds[:, 0] <= high) & (bounds[:, 1] >= low)).all(axis=1)
    return (parts[number] for number in np.flatnonzero(is_near))


def _add_static(client: int, position: Vec3, orientation: Quat, part: PartSpec) -> None:
    where, turned = part_pose(position, orientation, part)
    import_pybullet().createMultiBody(
        baseMass=0,
        baseCollisionShapeIndex=make_shape(client, part),
        basePosition=where,
        baseOrientation=turned,
        physicsClientId=client,
    )


def _add_loose(client: int, obj: ObjectSpec, folder: Path) -> int:
    """A dynamic body made of the convex hulls of the object's parts."""
    bullet = import_pybullet()
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


def _simulate(client: int, bodies: Sequence[int]) -> list[int]:
    """Let time pass until everything lies still; the numbers of the bodies that do not."""
    bullet = import_pybullet()
    bullet.setGravity(0, 0, -9.81, physicsClientId=client)
    bullet.setPhysicsEngineParameter(
        fixedTimeStep=1 / PHYSICS_HZ, deterministicOverlappingPairs=1, physicsClientId=client
    )
    poses, moving = [_pose(client, body) for body in bodies], [0]
    for _ in range(round(MAX_SECONDS * PHYSICS_HZ / REST_STEPS)):
        for _ in range(REST_STEPS):
            bullet.stepSimulation(physicsClientId=client)
        before, poses = poses, [_pose(client, body) for body in bodies]
        moving = [i for i, pair in enumerate(zip(before, poses, strict=True)) if _has_drifted(*pair)]
        if not moving:
            break
    return moving


def _has_drifted(before: Pose, after: Pose) -> bool:
    same = min(1.0, abs(float(np.dot(before[1], after[1]))))
    return math.dist(before[0], after[0]) > REST_DRIFT_M or 2 * math.acos(same) > REST_TURN_RAD


def _pose(client: int, body: int) -> Pose:
    return import_pybullet().getBasePositionAndOrientation(body, physicsClientId=client)


def _moved(obj: ObjectSpec, start: Pose, end: Pose) -> Pose:
    """The object's pose after the motion from ``start`` to ``end`` of its centre of mass."""
    bullet = import_pybullet()
    motion = bullet.multiplyTransforms(*end, *bullet.invertTransform(*start))
    position, orientation = bullet.multiplyTransforms(*motion, obj.position, obj.orientation)
    # A tenth of a millimetre is far below what the simulation can promise.
    x, y, z = (round(float(v), 4) for v in position)
    unit = np.asarray(orientation) / np.linalg.norm(orientation)
    qx, qy, qz, qw = (round(float(v), 6) for v in unit * (1.0 if unit[3] >= 0 else -1.0))
    return (x, y, z), (qx, qy, qz, qw)
