"""Homes with catalogue furniture: which models stand where, at rest, in scenes, datasets and cards."""

import dataclasses
import io
import json
import tarfile

import numpy as np
import pytest
import yaml

from agent.config import EnvConfig
from agent.envs.pointnav import PointNavEnv
from agent.rollout import run_episode
from agent.systems.controls import make_control
from langwm_data import render_dataset
from langwm_data.config import DatasetConfig, RobotConfig, ScenesConfig
from langwm_data.config_io import build_config
from langwm_data.scenes.checks import overlapping_pairs
from langwm_data.scenes.homes import Homes, make_home
from langwm_data.scenes.spec import SceneSpec
from langwm_data.scenes.splits import check_models, check_palette
from langwm_data.shards.ood import verify_ood
from langwm_data.shards.scenes import scene_path
from langwm_data.shards.verify import verify_dataset
from langwm_data.shards.writer import TarWriter
from langwm_data.sim.settle import settle

FLOORS = ("Alder_0", "Birch_1", "Maple_0", "Rowan_0")


@pytest.fixture
def homes(furnish):
    return Homes(0, furnish())


def catalogue_objects(scene):
    return [o for o in scene.objects if o.mesh is not None]


@pytest.mark.parametrize("name", FLOORS)
def test_furnished_homes_are_sound_and_show_models_of_their_split(homes, name):
    scene = settle(homes.make(name))
    check_palette(scene)
    check_models(scene)
    shown = {o.model for o in catalogue_objects(scene)}
    assert shown == {record.model for record in scene.models}
    assert {record.split for record in scene.models} == {scene.split}
    categories = {o.category for o in catalogue_objects(scene)}
    assert {"bed", "chair", "sofa"} & categories
    # There is one washbasin only, which is for training: test homes have procedural ones.
    basins = {o.mesh is not None for o in scene.objects if o.category == "washbasin"}
    assert basins <= {scene.split == "train"}
    assert not [pair for pair in overlapping_pairs(scene, tolerance_m=0.006)]
    for obj in catalogue_objects(scene):
        assert (homes.assets.folders[0] / f"{obj.mesh.name}.npz").is_file()
    assert SceneSpec.from_json(scene.to_json()) == scene


@pytest.mark.parametrize("name", ["Birch_1", "Maple_0"])
def test_the_map_touches_what_physics_touches(homes, name):
    from benchmarks.env import drive_both

    drives = drive_both(settle(homes.make(name)), RobotConfig(), episodes=4)
    assert 0.02 < drives.flags[:, 0].mean() < 0.8
    assert (drives.flags[:, 0] == drives.flags[:, 1]).mean() > 0.99
    assert np.quantile(drives.apart_m, 0.95) < 0.01


@pytest.mark.parametrize("contacts", ["physics", "map"])
def test_the_oracle_finds_its_way_among_catalogue_furniture(furnish, contacts):
    scenes = ScenesConfig(furniture=str(furnish()))
    env = PointNavEnv(EnvConfig(scenes=scenes, contacts=contacts, is_blind=True), "test")
    records = [run_episode(env, make_control("oracle", env), seed=k) for k in range(4)]
    env.close()
    assert all(record.success and record.spl > 0.9 for record in records)


def test_the_same_catalogues_give_the_same_homes(furnish):
    folder = furnish()
    first = Homes(0, folder).make("Alder_0")
    assert Homes(0, folder).make("Alder_0") == first
    assert first != Homes(1, folder).make("Alder_0")
    assert first != make_home("Alder_0", seed=0)


def test_homes_without_catalogues_have_no_identity(homes):
    assert dict(Homes(0).identity) == {}
    assert set(homes.identity) == {"furniture"}


def test_a_folder_without_catalogues_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"no Sweet Home 3D catalogue \(.sh3f\) in it"):
        Homes(0, tmp_path)


def test_a_scene_with_a_model_of_the_other_split_is_refused(homes):
    scene = homes.make("Alder_0")
    wrong = dataclasses.replace(scene.models[0], split="test")
    leaky = dataclasses.replace(scene, models=(wrong, *scene.models[1:]))
    with pytest.raises(
        ValueError, match=rf"scene 'Alder_0' is for train; model '{wrong.model}' of 'Tiny' is for test"
    ):
        check_models(leaky)


def test_a_test_scene_shows_models_for_test_or_of_a_source_that_holds_out_none(homes):
    scene = homes.make("Maple_0")
    seen = [dataclasses.replace(record, split="train") for record in scene.models]
    assert len(seen) > 1
    check_models(scene)
    check_models(dataclasses.replace(scene, models=tuple(seen)))
    with pytest.raises(ValueError, match=r"scene 'Maple_0' is for test; model .* of 'Tiny' is for train"):
        check_models(dataclasses.replace(scene, models=(scene.models[0], *seen[1:])))


@pytest.fixture
def dataset(furnish, tmp_path):
    values = {
        "frames": 12,
        "camera": {"height": 48, "width": 60},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.5},
        "scenes": {"furniture": str(furnish(license="CC-BY | 3.0"))},
    }
    return render_dataset(build_config(DatasetConfig, values), tmp_path / "dataset")


def edit_first_document(folder, split, change):
    """Change the document of the first frame of a split; the shard is written anew."""
    path = folder / split / f"{split}-000000.tar"
    with tarfile.open(path) as tar:
        members = [(m, tar.extractfile(m).read()) for m in tar]
    at = next(i for i, (m, _) in enumerate(members) if m.name.endswith(".json"))
    document = json.loads(members[at][1])
    change(document)
    members[at] = members[at][0], json.dumps(document, separators=(",", ":")).encode()
    buffer = io.BytesIO()
    writer = TarWriter(buffer)
    for member, data in members:
        writer.add(member.name, data)
    writer.finish()
    path.write_bytes(buffer.getvalue())


def test_a_furnished_dataset_is_sound_names_its_authors_and_proves_its_splits(dataset):
    report = verify_dataset(dataset)
    assert report.is_sound, report.as_text()
    proof = verify_ood(dataset)
    assert proof.is_sound, proof.as_text()
    assert proof.held_out_models
    card = (dataset / "README.md").read_text()
    head = yaml.safe_load(card.split("---\n")[1])
    assert (head["license"], head["license_link"]) == ("other", "README.md#licence")
    scenes = [SceneSpec.from_json(path.read_bytes()) for path in (dataset / "scenes").iterdir()]
    for record in (record for scene in scenes for record in scene.models):
        row = f"| {record.model} | {record.name} | Ann | CC-BY \\| 3.0 | Tiny | {record.split} |"
        assert row in card
    assert "no third-party assets" not in card

    held_out = min(proof.held_out_models)
    edit_first_document(dataset, "train", lambda d: d["objects"][-1].update(model=held_out, category="bed"))
    leaky = verify_ood(dataset)
    assert f"model {held_out} is held out for test" in leaky.as_text()
    assert leaky.as_text().splitlines()[-1].startswith("NOT PROVED: ")


def test_a_scene_of_the_dataset_that_shows_the_other_split_is_found(dataset):
    name = next(p.stem for p in sorted((dataset / "scenes").iterdir()) if p.stem < "M")
    path = scene_path(dataset, name)
    document = json.loads(path.read_text())
    document["models"][0]["split"] = "test"
    path.write_text(json.dumps(document, separators=(",", ":"), sort_keys=True))
    for findings in (verify_ood(dataset).findings, verify_dataset(dataset).findings):
        assert any(
            f.where == f"scenes/{name}.json" and "is for train; model 'Tiny#" in f.what for f in findings
        ), findings
