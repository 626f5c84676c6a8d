"""What is behind a pixel, asked of a library that is no renderer."""

import numpy as np
import pytest

from langwm_data.sim.mesh import scene_groups


@pytest.fixture(scope="module")
def ray_caster(small_scene):
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
