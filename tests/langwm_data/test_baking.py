"""Homes read from a dataset are the homes that physics settles; other seeds and damaged files are refused."""

import json
import subprocess
import sys

import pytest

from langwm_data import render_dataset
from langwm_data.baking import open_scenes
from langwm_data.config import DatasetConfig, ScenesConfig
from langwm_data.config_io import ConfigError, build_config
from langwm_data.frames import BakeTask, RenderWorker
from langwm_data.pipeline import fingerprint
from langwm_data.shards.manifest import read_manifest
from langwm_data.shards.scenes import scene_path

ONE_FRAME = {
    "frames": 1,
    "camera": {"height": 16, "width": 20},
    "render": {"texture_px": 16},
    "splits": {"test_fraction": 0.0},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A dataset that shows one floor. Shared: do not write into it."""
    return render_dataset(build_config(DatasetConfig, ONE_FRAME), tmp_path_factory.mktemp("baked") / "data")


@pytest.fixture(scope="module")
def name(folder):
    (path,) = (folder / "scenes").iterdir()
    return path.stem


def test_a_home_that_is_read_equals_the_one_that_is_settled(folder, name):
    assert open_scenes(ScenesConfig(baked=str(folder))).load(name) == open_scenes(ScenesConfig()).load(name)


def test_a_floor_that_the_dataset_lacks_is_settled(folder, name):
    other = "Rowan_0"
    assert other != name
    assert open_scenes(ScenesConfig(baked=str(folder))).load(other) == open_scenes(ScenesConfig()).load(other)


def test_reading_needs_no_physics_engine(folder, name):
    code = f"""
import sys
sys.modules["pybullet"] = None
from langwm_data.baking import open_scenes
from langwm_data.config import ScenesConfig
print(open_scenes(ScenesConfig(baked={str(folder)!r})).load({name!r}).name)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == name


def test_a_dataset_made_of_baked_scenes_has_the_same_bytes(folder, tmp_path):
    config = build_config(DatasetConfig, ONE_FRAME | {"scenes": {"baked": str(folder)}})
    render_dataset(config, tmp_path / "again")
    for name in ("train/train-000000.tar", "index/frames.parquet"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()
    assert fingerprint(config) == fingerprint(build_config(DatasetConfig, ONE_FRAME))


def test_physics_is_part_of_the_fingerprint(monkeypatch):
    config = build_config(DatasetConfig, ONE_FRAME)
    before = fingerprint(config)
    monkeypatch.setattr("langwm_data.baking.describe_physics", lambda: "pybullet 9.9")
    assert fingerprint(config) != before


def test_baked_scenes_keep_the_fingerprint_of_the_physics_that_settled_them(folder, monkeypatch):
    config = build_config(DatasetConfig, ONE_FRAME | {"scenes": {"baked": str(folder)}})
    monkeypatch.setattr("langwm_data.baking.describe_physics", lambda: "pybullet 9.9")
    assert fingerprint(config) == read_manifest(folder).fingerprint
    assert fingerprint(build_config(DatasetConfig, ONE_FRAME), read_manifest(folder)) == fingerprint(config)


def test_a_floor_that_other_physics_would_settle_is_refused(folder, monkeypatch):
    monkeypatch.setattr("langwm_data.baking.describe_physics", lambda: "pybullet 9.9")
    library = open_scenes(ScenesConfig(baked=str(folder)))
    with pytest.raises(
        ConfigError,
        match=r"has no scene 'Rowan_0', and its scenes were settled by pybullet \d.*by pybullet 9\.9",
    ):
        library.load("Rowan_0")


def test_a_dataset_is_rendered_without_a_physics_engine_where_scenes_are_baked(folder, tmp_path):
    code = f"""
import sys
sys.modules["pybullet"] = None
from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError, build_config
values = {ONE_FRAME!r}
try:
    render_dataset(build_config(DatasetConfig, values), {str(tmp_path / "refused")!r})
except ConfigError as error:
    print(error)
baked = values | {{"scenes": {{"baked": {str(folder)!r}}}}}
render_dataset(build_config(DatasetConfig, baked), {str(tmp_path / "baked")!r})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "needs the package pybullet" in done.stdout
    assert "without it, give scenes.baked, a finished dataset of these scenes" in done.stdout
    assert not (tmp_path / "refused").exists()
    mine, theirs = read_manifest(tmp_path / "baked"), read_manifest(folder)
    assert (mine.fingerprint, mine.physics, mine.shards) == (
        theirs.fingerprint,
        theirs.physics,
        theirs.shards,
    )


def test_a_node_with_other_physics_settles_nothing(tmp_path):
    config = build_config(DatasetConfig, ONE_FRAME)
    with (
        RenderWorker(config, tmp_path) as worker,
        pytest.raises(
            ConfigError, match=r"scene 'Alder_0' would be settled by pybullet \d.* by pybullet 9\.9"
        ),
    ):
        worker(BakeTask(scene="Alder_0", physics="pybullet 9.9"), lambda _: None)


def test_another_seed_is_refused(folder, name):
    with pytest.raises(
        ConfigError,
        match=r"field 'scenes\.baked': value .* holds scenes of seed 0 by langwm [\d.]+; allowed: .*seed 3",
    ):
        open_scenes(ScenesConfig(seed=3, baked=str(folder))).load(name)


@pytest.mark.parametrize("scenes", [None, 7, {}], ids=["missing", "no mapping", "no seed"])
def test_a_manifest_that_tells_no_seed_is_refused(folder, name, scenes, tmp_path):
    document = json.loads((folder / "dataset.json").read_text())
    document["config"]["scenes"] = scenes
    (tmp_path / "dataset.json").write_text(json.dumps(document))
    with pytest.raises(ConfigError, match="holds scenes of seed None"):
        open_scenes(ScenesConfig(baked=str(tmp_path))).load(name)


def test_what_is_no_dataset_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no finished dataset at"):
        open_scenes(ScenesConfig(baked=str(tmp_path))).load("Rowan_0")


def test_unknown_homes_are_refused(folder):
    with pytest.raises(ValueError, match=r"scene '\.\./Rowan_0' is unknown"):
        open_scenes(ScenesConfig(baked=str(folder))).load("../Rowan_0")


def test_names_lead_to_no_other_folder(tmp_path):
    with pytest.raises(ConfigError, match=r"scene name '\.\./secret' is not allowed"):
        scene_path(tmp_path, "../secret")


@pytest.mark.parametrize("field", ["furniture", "igibson"])
def test_folders_without_scenes_are_named_by_their_field(field, tmp_path):
    with pytest.raises(
        ConfigError, match=rf"field 'scenes\.{field}': value '{tmp_path}' .*; allowed: a folder with"
    ):
        open_scenes(ScenesConfig(**{field: str(tmp_path)}))


def test_furniture_is_for_homes():
    with pytest.raises(ConfigError, match=r"scenes\.furniture 'a' is for homes; it cannot be given with"):
        ScenesConfig(furniture="a", igibson="b")
