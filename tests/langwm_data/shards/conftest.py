"""A small finished dataset of invented images, made without any renderer."""

from dataclasses import asdict

import numpy as np
import pytest

from langwm_data import atomic
from langwm_data.config import LabelsConfig
from langwm_data.labels.instances import label_frame
from langwm_data.scenes.spec import InstanceName
from langwm_data.shards.finish import Origin, finish_dataset
from langwm_data.shards.manifest import CameraRecord
from langwm_data.shards.sample import Sample
from langwm_data.shards.writer import write_shard

HEIGHT, WIDTH = 24, 32
K = [[29.0, 0.0, 16.0], [0.0, 29.0, 12.0], [0.0, 0.0, 1.0]]
TABLE = {
    1: InstanceName("wall", "study_wall", "wall"),
    2: InstanceName("chair", "chair_01", "chair"),
    3: InstanceName("sofa", "sofa_02", "sofa"),
}
EXTENT = {"visible_fraction": 0.5, "truncated_fraction": 0.0, "occluded_fraction": 0.5}
SHARD_SIZES = {"train": (5, 5, 3), "test": (2,)}


def make_sample(split, number):
    """Every third frame shows a chair, frame 0 and every fifth nothing but the wall, the others a sofa."""
    rng = np.random.default_rng([number, split == "test"])
    instance = np.ones((HEIGHT, WIDTH), np.uint16)
    if number % 5:
        instance[4:14, 2:12] = 2 if number % 3 == 0 else 3
    depth = (rng.integers(300, 9000, (HEIGHT, WIDTH)) / 1000).astype(np.float32)
    depth[0, 0] = 0
    labels = label_frame(instance, depth, TABLE, LabelsConfig(), rng)
    scene = "Alder_0" if split == "train" else "Rowan_0"
    captions = [c.text for o in labels for c in o.captions]
    pose = np.eye(4)
    pose[:3, 3] = 1.5, 2.5, 0.3
    return Sample(
        key=f"{scene}-{number:06d}",
        rgb=rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8),
        depth=depth,
        instance=instance,
        meta={
            "scene": scene,
            "building": scene[:-2],
            "floor": 0,
            "split": split,
            "palette": ["wood/01", "paint/02"],
            "lights": {
                "ambient": [0.5] * 3,
                "sun": [0.25] * 3,
                "lamp": [0.5] * 3,
                "sun_direction": [0.0, 0.0, 1.0],
            },
            "trajectory": number // 3,
            "step": number % 3,
            "action": [0.5, -0.25] if number % 3 else [0.0, 0.0],
            "pose": [1.5, 2.5, 0.5],
            "camera": {
                "height": HEIGHT,
                "width": WIDTH,
                "K": K,
                "camera_to_world": pose.tolist(),
                "yaw_rad": 0.5,
                "pitch_rad": 0.0,
            },
            "objects": [asdict(o) | EXTENT for o in labels],
        },
        caption=captions[0] if captions else "",
    )


def make_dataset(folder):
    records = []
    for split, sizes in SHARD_SIZES.items():
        start = 0
        for number, size in enumerate(sizes):
            samples = (make_sample(split, n) for n in range(start, start + size))
            records.append(write_shard(folder, split, number, samples))
            start += size
    camera = CameraRecord(height=HEIGHT, width=WIDTH, K=K, depth_unit_m=0.001)
    origin = Origin(
        generator="langwm 0",
        fingerprint="0" * 64,
        physics="none",
        renderer="none",
        config={"frames": 15},
        sources={},
        camera=camera,
    )
    for scene in ("Alder_0", "Rowan_0"):
        atomic.write_text(folder / f"scenes/{scene}.json", "{}")
    finish_dataset(folder, records, origin)
    return folder


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Thirteen training and two test frames in four shards. Shared: do not write into it."""
    return make_dataset(tmp_path_factory.mktemp("dataset"))


@pytest.fixture
def own_folder(tmp_path):
    """The same, for a test to damage."""
    return make_dataset(tmp_path / "dataset")


@pytest.fixture(scope="session")
def sample_at():
    """The sample as it was before it was written."""
    return make_sample
