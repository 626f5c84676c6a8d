"""Datasets of scenes with meshes hold all needed to draw them again, and nothing that is not theirs."""

import dataclasses
import shutil

import numpy as np
import pytest
from mesh_scenes import TABLE, with_meshes

from langwm_data import ShardDataset, baking, render_dataset
from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig, ScenesConfig
from langwm_data.config_io import ConfigError, build_config
from langwm_data.estimate import estimate
from langwm_data.redraw import redraw_frames
from langwm_data.repair import repair_dataset
from langwm_data.scenes.assets import Assets
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.verify import verify_dataset

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 6,
        "camera": {"height": 48, "width": 60},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.0},
        "scenes": {"furniture": "somewhere"},
    },
)


class Study:
    """One training floor with two meshes."""

    is_at_rest = False

    def __init__(self, scene, assets, identity):
        self.scene, self.assets, self.identity = scene, assets, identity

    def names(self, split=None):
        return ("Alder_0",) if split in (None, "train") else ()

    def make(self, name):
        return self.scene


@pytest.fixture(scope="module")
def study(small_scene, tmp_path_factory):
    assets = Assets(tmp_path_factory.mktemp("cache"))
    return Study(with_meshes(small_scene, assets), assets, {"furniture": "ab" * 32})


@pytest.fixture
def offered(study, monkeypatch):
    """Has ``study`` offer the scenes of this test."""
    original = baking._source

    def source(config, baked, holds_out):
        return study if config.furniture is not None else original(config, baked, holds_out)

    monkeypatch.setattr(baking, "_source", source)
    open_scenes.cache_clear()
    yield study
    open_scenes.cache_clear()


@pytest.fixture
def folder(offered, tmp_path):
    return render_dataset(CONFIG, tmp_path / "data")


def test_assets_lie_in_the_dataset_and_it_is_sound(folder, study):
    assert tuple(sorted(p.name for p in (folder / "assets").iterdir())) == study.scene.assets()
    assert verify_dataset(folder).findings == ()
    assert redraw_frames(folder, 3) == ()
    assert ShardDataset(folder).manifest.sources == {"furniture": "ab" * 32}


def test_captions_use_the_nouns_of_models(folder):
    dataset = ShardDataset(folder)
    named = [o for n in range(len(dataset)) for o in dataset[n].meta["objects"] if o["instance"] == TABLE]
    assert named
    assert {o["phrase"] for o in named} == {"small orange table"}
    assert all("small orange table" in c["text"] for o in named for c in o["captions"])
    assert "small orange table" in dataset.objects["phrase"].to_pylist()


def test_it_can_be_drawn_again_where_the_models_are_not(folder, study, tmp_path):
    moved = tmp_path / "moved"
    shutil.copytree(folder, moved)
    study.assets.folders[0].rename(tmp_path / "gone")
    try:
        assert redraw_frames(moved, 6) == ()
        library = open_scenes(ScenesConfig(baked=str(moved)))
        assert library.names("train") == ("Alder_0",)
        assert library.load("Alder_0") == ShardDataset(moved).scene("Alder_0")
        assert library.assets.mesh(study.scene.objects[0].mesh.name).sizes == (2,)
        with pytest.raises(ValueError, match=r"scene 'Elm_0' is not in the dataset .*; allowed: Alder_0"):
            library.load("Elm_0")
    finally:
        (tmp_path / "gone").rename(study.assets.folders[0])


def test_frames_are_not_planned_from_the_floors_of_another_dataset_alone(folder, tmp_path):
    config = dataclasses.replace(CONFIG, scenes=ScenesConfig(baked=str(folder)))
    sentence = r"tells of no floors but those that it shows; to render frames, give scenes\.furniture as well"
    for plan in (lambda: render_dataset(config, tmp_path / "out"), lambda: estimate(config)):
        with pytest.raises(ConfigError, match=sentence):
            plan()
    assert not (tmp_path / "out").exists()
    both = dataclasses.replace(config.scenes, furniture="somewhere")
    again = render_dataset(dataclasses.replace(config, scenes=both), tmp_path / "again")
    for shard in ShardDataset(folder).manifest.shards:
        assert (again / shard.path).read_bytes() == (folder / shard.path).read_bytes()


def test_other_sources_are_refused(folder, study, monkeypatch):
    monkeypatch.setattr(study, "identity", {"furniture": "cd" * 32})
    open_scenes.cache_clear()
    with pytest.raises(ConfigError, match=r"made from scenes\.furniture abab.*; allowed: .* cdcd"):
        open_scenes(ScenesConfig(furniture="somewhere", baked=str(folder)))
    with pytest.raises(ConfigError, match=r"allowed: a dataset of scenes made from scenes\.furniture cdcd"):
        open_scenes(ScenesConfig(furniture="else", baked=str(folder)))


@pytest.mark.parametrize("kind", ["missing", "damaged", "foreign", "a folder"])
def test_damaged_assets_are_named(folder, kind):
    file = sorted((folder / "assets").iterdir())[0]
    if kind == "missing":
        file.unlink()
    elif kind == "damaged":
        file.write_bytes(file.read_bytes()[:-1] + b"!")
    elif kind == "foreign":
        (folder / "assets" / "x.py").write_text("print()")
    else:
        file.unlink()
        file.mkdir()
    (finding,) = verify_dataset(folder).findings
    sentence = {
        "missing": "is missing",
        "damaged": "does not match its name",
        "foreign": "is no part of this dataset",
        "a folder": "is not a plain file",
    }[kind]
    assert sentence in finding.what
    assert finding.where.startswith("assets/")


def test_damaged_assets_are_made_again(folder):
    file = sorted((folder / "assets").iterdir())[0]
    whole = file.read_bytes()
    file.write_bytes(whole[:100])
    findings = verify_dataset(folder).findings
    assert "scenes/Alder_0.json" in repair_dataset(folder, findings)
    assert file.read_bytes() == whole
    assert verify_dataset(folder).is_sound


def test_repair_refuses_other_models(folder, study, monkeypatch):
    sorted((folder / "assets").iterdir())[0].write_bytes(b"")
    findings = verify_dataset(folder).findings
    monkeypatch.setattr(study, "identity", {"furniture": "cd" * 32})
    open_scenes.cache_clear()
    with pytest.raises(DatasetError, match="made from other files than those that its configuration names"):
        repair_dataset(folder, findings)


def test_the_environment_shows_what_the_dataset_shows(offered, small_scene):
    from agent.config import EnvConfig
    from agent.envs.pointnav import PointNavEnv

    scenes = ScenesConfig(furniture="somewhere")
    config = dataclasses.replace(EnvConfig(), scenes=scenes, camera=CONFIG.camera, with_labels=True)
    env = PointNavEnv(config, split="train")
    seen = set()
    for seed in range(6):
        observation, info = env.reset(seed=seed)
        seen |= {o.noun for o in info["objects"]}
        assert observation["rgb"].std() > 5
        assert np.isfinite(observation["depth"]).all()
    env.close()
    assert "small orange table" in seen
