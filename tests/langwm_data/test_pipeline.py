"""The whole of stage one on real homes, small and few."""

import dataclasses
import errno
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from langwm_data import ShardDataset, pipeline, render_dataset
from langwm_data.config import DatasetConfig, RenderConfig
from langwm_data.config_io import ConfigError, build_config, config_to_yaml
from langwm_data.labels.amodal import amodal_extents, scene_solids
from langwm_data.labels.instances import label_frame
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.splits import HELD_OUT_TEXTURE_IDS
from langwm_data.shards.manifest import MANIFEST_FILE, read_manifest
from langwm_data.shards.writer import WORK_DIR, TarWriter, sha256_of
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import describe_renderer, make_renderer

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 8,
        "seed": 5,
        "camera": {"height": 48, "width": 60},
        "render": {"texture_px": 32},
        "splits": {"test_fraction": 0.25},
        "cameras": {"frames_per_palette": 6},
        "shards": {"samples_per_shard": 3},
    },
)


SMALL = build_config(
    DatasetConfig,
    {
        "frames": 3,
        "camera": {"height": 24, "width": 30},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.0},
        "shards": {"samples_per_shard": 1},
    },
)
"""For what can go wrong on the way: three shards of one frame, one floor."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Eight frames of two floors in three shards. Shared: do not write into it."""
    return render_dataset(CONFIG, tmp_path_factory.mktemp("rendered") / "dataset")


@pytest.fixture(scope="module")
def dataset(folder):
    return ShardDataset(folder)


def contents(folder):
    return {str(p.relative_to(folder)): sha256_of(p) for p in sorted(folder.rglob("*")) if p.is_file()}


def test_two_workers_write_the_same_bytes(folder, tmp_path):
    calls = []
    render_dataset(CONFIG, tmp_path / "two", workers=2, progress=lambda *a: calls.append(a))
    assert contents(tmp_path / "two") == contents(folder)
    assert calls == [(n, 8) for n in range(9)]


SCRIPT = """
import sys
from pathlib import Path
from langwm_data import render_dataset
from langwm_data.config import DatasetConfig, RenderConfig
from langwm_data.config_io import load_config_file

if __name__ == "__main__":
    config = load_config_file(DatasetConfig, Path(sys.argv[1]))
    render_dataset(config, Path(sys.argv[2]), progress=lambda done, total: print(done, flush=True))
"""


def test_killed_and_started_again_gives_the_same_bytes(folder, tmp_path):
    (tmp_path / "config.yaml").write_text(config_to_yaml(CONFIG))
    (tmp_path / "job.py").write_text(SCRIPT)
    out = tmp_path / "killed"
    command = [sys.executable, tmp_path / "job.py", tmp_path / "config.yaml", out]
    environment = os.environ | {"PYTHONPATH": str(Path.cwd())}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as job:
        try:
            while int(job.stdout.readline()) < 4:
                pass
        finally:
            job.send_signal(signal.SIGKILL)
    assert (out / "train/train-000000.tar").is_file()
    assert not (out / MANIFEST_FILE).exists()
    calls = []
    render_dataset(CONFIG, out, progress=lambda *a: calls.append(a))
    assert calls[0] == (3, 8)
    assert contents(out) == contents(folder)


def test_a_finished_dataset_is_left_alone(folder):
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*.tar")}
    calls = []
    assert render_dataset(CONFIG, folder, progress=lambda *a: calls.append(a)) == folder
    assert calls == []
    assert before == {p: p.stat().st_mtime_ns for p in folder.rglob("*.tar")}


def test_another_configuration_is_refused(folder):
    before = contents(folder)
    other = build_config(DatasetConfig, {"frames": 99})
    with pytest.raises(ConfigError, match=r"another configuration: .*frames \(8 there, 99 asked for\)"):
        render_dataset(other, folder)
    assert contents(folder) == before


def stop_after(monkeypatch, samples):
    """The disk is full after so many samples."""
    add, count = TarWriter.add, 0

    def limited(self, name, data):
        nonlocal count
        count += name.endswith("rgb.png")
        if count > samples:
            raise OSError(errno.ENOSPC, "No space left on device")
        return add(self, name, data)

    monkeypatch.setattr(TarWriter, "add", limited)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return contents(render_dataset(SMALL, tmp_path_factory.mktemp("small") / "dataset"))


@pytest.fixture
def begun(tmp_path, monkeypatch):
    """A dataset of which two of three shards were made when the disk was full."""
    stop_after(monkeypatch, 2)
    with pytest.raises(OSError, match="No space left on device"):
        render_dataset(SMALL, tmp_path / "begun")
    monkeypatch.undo()
    return tmp_path / "begun"


def finish(folder):
    """Render the rest; how many frames were there at the start."""
    calls = []
    render_dataset(SMALL, folder, progress=lambda *a: calls.append(a))
    return calls[0][0]


def test_a_full_disk_leaves_no_half_written_shard(begun, small):
    assert sorted(p.name for p in begun.rglob("*.tar*")) == ["train-000000.tar", "train-000001.tar"]
    assert not (begun / MANIFEST_FILE).exists()
    assert finish(begun) == 2
    assert contents(begun) == small


def test_a_damaged_shard_is_made_again(begun, small):
    tar = begun / "train/train-000001.tar"
    tar.write_bytes(tar.read_bytes()[:-512])
    assert finish(begun) == 1
    assert contents(begun) == small


def test_work_of_another_version_is_not_mixed_in(begun, small):
    (begun / WORK_DIR / "fingerprint").write_text("another version")
    assert finish(begun) == 0
    assert contents(begun) == small


def test_fresh_starts_over(begun, small):
    render_dataset(SMALL, begun, fresh=True)
    assert contents(begun) == small


def test_another_configuration_may_start_over_in_a_finished_dataset(folder):
    with pytest.raises(ConfigError, match=r"seed \(5 there, 1 asked for\); .* or --fresh to start over$"):
        render_dataset(dataclasses.replace(CONFIG, seed=1), folder)


def test_fresh_does_not_remove_the_scenes_that_are_asked_for(folder, tmp_path):
    out = shutil.copytree(folder, tmp_path / "data")
    scenes = dataclasses.replace(CONFIG.scenes, baked=str(out))
    with pytest.raises(ConfigError, match=r"--fresh would remove '.*/data', which this command reads"):
        render_dataset(dataclasses.replace(CONFIG, scenes=scenes), out, fresh=True)
    assert contents(out) == contents(folder)


def test_the_manifest_tells_how_and_what(folder, dataset):
    manifest = read_manifest(folder)
    assert manifest.fingerprint == pipeline.fingerprint(CONFIG)
    assert (manifest.frames, manifest.generator) == (8, pipeline.GENERATOR)
    assert manifest.renderer == describe_renderer(CONFIG.render)
    assert {name: s.frames for name, s in manifest.splits.items()} == {"train": 6, "test": 2}
    assert Camera.on_robot(CONFIG.camera, (0, 0), 0).intrinsics.tolist() == manifest.camera.K
    assert [s.samples for s in manifest.shards] == [3, 3, 2]
    for shard in manifest.shards:
        assert sha256_of(folder / shard.path) == shard.sha256
    assert manifest.captions == sum(len(o["captions"]) for s in dataset for o in s.meta["objects"])


def test_every_renderer_has_a_fingerprint_of_its_own():
    marks = [
        pipeline.fingerprint(dataclasses.replace(CONFIG, render=RenderConfig(backend=backend)))
        for backend in ("embree", "tiny")
    ]
    assert marks[0] != marks[1]


def test_a_renderer_that_does_not_open_is_refused_before_anything_is_written(tmp_path):
    config = dataclasses.replace(CONFIG, render=RenderConfig(backend="gl", egl_device=99))
    with pytest.raises(ConfigError, match=r"'render\.egl_device': value 99 opens no OpenGL"):
        render_dataset(config, tmp_path / "data")
    assert not (tmp_path / "data").exists()


def test_frames_can_be_rendered_again_from_what_is_stored(dataset):
    renderer = make_renderer(CONFIG.render)
    for sample in (dataset[5], dataset[7]):
        stored = sample.meta["camera"]
        scene = dataset.scene(sample.meta["scene"])
        palette = [type(scene.palette[0]).parse(text) for text in sample.meta["palette"]]
        camera = Camera.on_robot(
            CONFIG.camera, tuple(r[3] for r in stored["camera_to_world"][:2]), stored["yaw_rad"]
        )
        assert camera.camera_to_world.tolist() == stored["camera_to_world"]
        renderer.load(scene.with_palette(palette))
        frame = renderer.render(camera)
        np.testing.assert_array_equal(frame.rgb, sample.rgb)
        np.testing.assert_array_equal(frame.instance, sample.instance)
        np.testing.assert_allclose(frame.depth, sample.depth, atol=6e-4)
    renderer.close()


def test_labels_can_be_made_again_from_the_stored_images(dataset):
    for sample in dataset:
        table = dataset.scene(sample.meta["scene"]).instances()
        labels = label_frame(sample.instance, sample.depth, table, CONFIG.labels, np.random.default_rng(0))
        for again, stored in zip(labels, sample.meta["objects"], strict=True):
            assert (again.instance, again.category) == (stored["instance"], stored["category"])
            assert list(again.bbox_xyxy) == stored["bbox_xyxy"]
            assert again.distance_m == stored["distance_m"]
            assert len(again.captions) == len(stored["captions"])


def test_what_is_hidden_and_cut_off_can_be_measured_again(dataset):
    for sample in dataset:
        stored = sample.meta["camera"]
        xy = tuple(row[3] for row in stored["camera_to_world"][:2])
        camera = Camera.on_robot(CONFIG.camera, xy, stored["yaw_rad"])
        visible = {o["instance"]: o["area_px"] for o in sample.meta["objects"]}
        extents = amodal_extents(scene_solids(dataset.scene(sample.meta["scene"])), camera, visible)
        for obj in sample.meta["objects"]:
            values = vars(extents[obj["instance"]])
            assert {name: obj[name] for name in values} == values
            assert all(type(value) is float for value in values.values())


def test_views_stand_clear_of_obstacles_and_show_something(dataset):
    names = set(dataset.frames["scene"].to_pylist())
    free = {name: FreeSpace.from_scene(dataset.scene(name), robot=CONFIG.robot) for name in names}
    for sample in dataset:
        xy = [row[3] for row in sample.meta["camera"]["camera_to_world"][:2]]
        assert free[sample.meta["scene"]].clearance(np.array(xy)) >= CONFIG.cameras.min_clearance_m
        assert sample.meta["camera"]["camera_to_world"][2][3] == CONFIG.camera.mount_height_m
        assert (sample.depth > 0).mean() > 0.99
    assert np.mean([bool(sample.caption) for sample in dataset]) > 0.9


def test_the_caption_is_that_of_the_largest_captioned_object(dataset):
    for sample in dataset:
        named = [o for o in sample.meta["objects"] if o["captions"]]
        largest = max(named, key=lambda o: o["area_px"], default=None)
        assert sample.caption == (largest["captions"][0]["text"] if largest else "")


def test_test_frames_wear_held_out_textures_only(dataset):
    for sample in dataset:
        for material in sample.meta["palette"]:
            category, number = material.split("/")
            is_held_out = int(number) in HELD_OUT_TEXTURE_IDS[category]
            assert is_held_out == (sample.meta["split"] == "test")


def test_a_block_shares_its_palette(dataset):
    palettes = dataset.frames["materials"].to_pylist()
    assert all(palette == palettes[0] for palette in palettes[:6])
    assert palettes[6] == palettes[7] != palettes[0]


def test_no_place_far_enough_from_obstacles_is_a_wrong_request(tmp_path):
    config = build_config(DatasetConfig, {"frames": 1, "cameras": {"min_clearance_m": 50.0}})
    with pytest.raises(ConfigError, match=r"field 'cameras\.min_clearance_m': value 50\.0 leaves no place"):
        render_dataset(config, tmp_path / "out")
