"""What is behind a pixel, asked of a library that is no renderer."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import pytest

from langwm_data.sim.mesh import Mesh, concatenate, part_mesh


@dataclass(frozen=True, kw_only=True)
class MeshGroup:
    """What one instance shows of one material slot, in world coordinates."""

    instance: int
    slot: int
    mesh: Mesh


@pytest.fixture(scope="session")
def scene_groups():
    """All triangles of a procedural scene, put together part by part: one group an instance and slot."""

    def groups(scene):
        surfaces = {s.instance for s in scene.surfaces}
        meshes = defaultdict(list)
        for instance, position, orientation, part in scene.iter_parts():
            mesh = part_mesh(part, along_grain=instance not in surfaces)
            meshes[instance, part.slot].append(mesh.transformed(position, orientation))
        return [MeshGroup(instance=i, slot=s, mesh=concatenate(meshes[i, s])) for i, s in sorted(meshes)]

    return groups


@pytest.fixture(scope="module")
def ray_caster(small_scene, scene_groups):
    """Bullet's own ray test on the same triangles: z-depth and ids by another way than rasterising."""
    pybullet = pytest.importorskip("pybullet")
    client = pybullet.connect(pybullet.DIRECT)
    instance_of = {}
    for group in scene_groups(small_scene):
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=group.mesh.vertices.tolist(),
            indices=group.mesh.triangles.ravel().tolist(),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=client,
        )
        instance_of[pybullet.createMultiBody(0, shape, physicsClientId=client)] = group.instance

    def cast(camera):
        far = camera.unproject(np.full((camera.height, camera.width), camera.far_m, np.float32)).reshape(
            -1, 3
        )
        hits = pybullet.rayTestBatch([camera.position] * len(far), far.tolist(), physicsClientId=client)
        size = camera.height, camera.width
        depth = np.reshape([h[2] * camera.far_m if h[0] >= 0 else 0.0 for h in hits], size)
        return depth, np.reshape([instance_of.get(h[0], 0) for h in hits], size)

    yield cast
    pybullet.disconnect(client)
