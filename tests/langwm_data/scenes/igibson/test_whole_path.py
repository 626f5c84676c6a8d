"""A copy of iGibson is rendered, verified, drawn again and driven in like homes are."""

import dataclasses
import json
import shutil

import gymnasium
import numpy as np
import pytest
import yaml

import agent  # noqa: F401  # registers the environment
from agent.config import EnvConfig
from agent.envs.pointnav import PointNavEnv
from agent.envs.sites import load_scene
from agent.rollout import run_episode
from agent.systems.controls import make_control
from langwm_data import ShardDataset, render_dataset
from langwm_data.baking import open_scenes
from langwm_data.config import CameraConfig, DatasetConfig, RenderConfig, ScenesConfig
from langwm_data.config_io import build_config
from langwm_data.redraw import redraw_frames
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.splits import HELD_OUT_TEXTURE_IDS
from langwm_data.shards.ood import verify_ood
from langwm_data.shards.verify import verify_dataset
from langwm_data.sim.camera import Camera
from langwm_data.sim.render import make_renderer

OPTIONS = {
    "frames": 20,
    "camera": {"height": 64, "width": 80},
    "render": {"texture_px": 32},
    "splits": {"test_fraction": 0.3},
    "shards": {"samples_per_shard": 8},
}


@pytest.fixture(scope="module")
def folder(shared_dataset, tmp_path_factory):
    """A rendered dataset. Shared: do not write into it."""
    config = build_config(DatasetConfig, OPTIONS | {"scenes": {"igibson": str(shared_dataset)}})
    return render_dataset(config, tmp_path_factory.mktemp("whole") / "data")


@pytest.fixture
def env_config():
    return EnvConfig(camera=CameraConfig(height=32, width=40), render=RenderConfig(texture_px=16))


def test_a_dataset_is_sound_and_proved(folder):
    report = verify_dataset(folder)
    assert report.is_sound, report.as_text()
    proof = verify_ood(folder)
    assert proof.is_sound, proof.as_text()
    assert {split: set(shown.buildings) for split, shown in proof.shown.items()} == {
        "train": {"Beechwood"},
        "test": {"Rs"},
    }
    # Of paper nothing is held out: both splits may show it.
    assert "paper/01" in proof.shown["train"].textures.keys() & proof.shown["test"].textures.keys()


def test_every_frame_records_textures_of_its_split(folder):
    for sample in ShardDataset(folder):
        for text in sample.meta["palette"]:
            category, _, number = text.rpartition("/")
            held_out = HELD_OUT_TEXTURE_IDS.get(category)
            assert held_out is None or (int(number) in held_out) == (sample.meta["split"] == "test")


def test_frames_are_drawn_again_without_the_copy(folder, tmp_path):
    moved = tmp_path / "elsewhere"
    shutil.copytree(folder, moved)
    findings = redraw_frames(moved, 6)
    assert findings == ()


def test_the_card_forbids_to_pass_it_on(folder):
    text = (folder / "README.md").read_text()
    head = yaml.safe_load(text.split("---\n")[1])
    assert (head["license"], head["license_name"]) == ("other", "igibson-1.0-dataset")
    assert "**Not to be passed on.**" in text
    assert "Apache" not in text
    manifest = json.loads((folder / "dataset.json").read_text())
    assert set(manifest["sources"]) == {"igibson"}


def test_captions_call_things_by_igibson_s_names(folder):
    nouns = {o["phrase"] for sample in ShardDataset(folder) for o in sample.meta["objects"]}
    assert {"chair", "bottom cabinet"} <= nouns


def test_a_held_out_texture_or_building_in_training_is_a_leak(folder, tmp_path):
    spoiled = tmp_path / "data"
    shutil.copytree(folder, spoiled)
    shutil.copy(spoiled / "test/test-000000.tar", spoiled / "train/train-000000.tar")
    found = verify_ood(spoiled).as_text()
    assert "building Rs is for test, the frame is for train" in found
    assert "is for test only, the frame is for train" in found


@pytest.mark.parametrize(("backend", "error_m"), [("gl", 0.002), ("embree", 0.002), ("tiny", 0.03)])
def test_walls_are_as_far_as_they_are_and_nothing_is_mirrored(scene, source, backend, error_m):
    config = CameraConfig()
    try:
        renderer = make_renderer(RenderConfig(backend=backend), source.assets)
    except ValueError as error:
        pytest.skip(str(error))
    renderer.load(scene)
    for yaw, expected, instance in ((0.0, 3.9, 1), (np.pi, 0.9, 1), (-np.pi / 2, 0.9, 1)):
        frame = renderer.render(Camera.on_robot(config, (-3.0, -2.0), yaw))
        middle = frame.depth.shape[0] // 2, frame.depth.shape[1] // 2
        assert frame.depth[middle] == pytest.approx(expected, abs=error_m)
        assert frame.instance[middle] == instance
    assert_texture_is_upright(renderer, config)
    renderer.close()


def assert_texture_is_upright(renderer, config):
    """The front of chair_1: white at its left, yellow above, blue below."""
    yaw, center = -1.2, np.array([0.0, 1.5])
    right, forward = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    eye = center - 1.3 * forward
    camera = Camera.on_robot(config, (eye[0], eye[1]), float(np.arctan2(forward[1], forward[0])))
    frame = renderer.render(camera)
    for across, z, channels in ((-0.18, 0.1, "rgb"), (0.1, 0.4, "rg"), (0.1, 0.1, "b")):
        point = np.array([*(center - 0.25 * forward + across * right), z, 1.0])
        x, y, depth, _ = np.linalg.inv(camera.camera_to_world) @ point
        u, v, _ = camera.intrinsics @ (x / depth, y / depth, 1.0)
        assert frame.depth[int(v), int(u)] == pytest.approx(1.05, abs=0.03)
        color = frame.rgb[int(v), int(u)].astype(int)
        bright = {name for name, value in zip("rgb", color, strict=True) if value > 0.6 * color.max()}
        assert bright == set(channels)


def test_the_environment_drives_in_it_with_held_out_textures(env_config, shared_dataset):
    config = dataclasses.replace(env_config, scenes=ScenesConfig(igibson=str(shared_dataset)))
    env = gymnasium.make("LangWM/PointNav-v0", config=config, split="test")
    observation, info = env.reset(seed=3)
    assert info["scene"] == "Rs_0"
    free = FreeSpace.from_scene(open_scenes(config.scenes).load("Rs_0"), robot=config.robot)
    assert free.is_free(info["pose"][:2])
    assert free.is_free(info["goal"])
    for _ in range(5):
        observation, reward, *_, info = env.step(np.array([1.0, 0.2]))
        assert np.isfinite(reward)
        assert observation["rgb"].any()
        assert (observation["depth"] > 0).mean() > 0.99
    assert env.unwrapped.scene_names == ("Rs_0",)
    for material in env.unwrapped.palette:
        held_out = HELD_OUT_TEXTURE_IDS.get(material.category)
        assert held_out is None or material.id in held_out
    env.close()


@pytest.mark.parametrize("name", ["Beechwood_0", "Rs_0"])
def test_the_map_touches_what_physics_touches(env_config, shared_dataset, name):
    from benchmarks.env import drive_both

    config = dataclasses.replace(env_config, scenes=ScenesConfig(igibson=str(shared_dataset)))
    drives = drive_both(load_scene(name, config), config.robot, episodes=4)
    assert 0.02 < drives.flags[:, 0].mean() < 0.8
    assert (drives.flags[:, 0] == drives.flags[:, 1]).mean() > 0.99
    assert np.quantile(drives.apart_m, 0.95) < 0.01


@pytest.mark.parametrize("contacts", ["physics", "map"])
def test_the_oracle_finds_its_way_in_it(env_config, shared_dataset, contacts):
    config = dataclasses.replace(
        env_config, scenes=ScenesConfig(igibson=str(shared_dataset)), contacts=contacts, is_blind=True
    )
    env = PointNavEnv(config, "test")
    records = [run_episode(env, make_control("oracle", env), seed=k) for k in range(4)]
    env.close()
    assert all(record.success and record.spl > 0.9 for record in records)


def test_the_environment_needs_no_more_than_a_rendered_dataset(env_config, folder):
    config = dataclasses.replace(env_config, scenes=ScenesConfig(baked=str(folder)))
    env = gymnasium.make("LangWM/PointNav-v0", config=config, split="train")
    observation, info = env.reset(seed=0)
    assert info["scene"] == "Beechwood_0"
    assert observation["rgb"].any()
    env.close()


def test_a_copy_elsewhere_gives_the_same_bytes_from_an_empty_cache(
    folder, shared_dataset, tmp_path, monkeypatch
):
    shutil.copytree(shared_dataset, tmp_path / "copy")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    config = build_config(DatasetConfig, OPTIONS | {"scenes": {"igibson": str(tmp_path / "copy")}})
    again = render_dataset(config, tmp_path / "data")
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in ("config.yaml", "dataset.json"):  # say where the copy lies
            assert (again / path.relative_to(folder)).read_bytes() == path.read_bytes(), path
