"""A frame that is well formed and yet not the one that the configuration plans is named, by shard and key."""

import json
import shutil

import pytest

from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import build_config
from langwm_data.repair import rewrite_index
from langwm_data.scenes.splits import texture_ids
from langwm_data.shards.manifest import read_manifest
from langwm_data.shards.verify import verify_dataset
from langwm_data.sim.camera import Camera

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 16,
        "seed": 3,
        "camera": {"height": 16, "width": 20},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.25},
        "cameras": {"mode": "trajectory", "frames_per_palette": 12, "trajectory_length": 6},
        "randomize": {"lights": "block"},
        "shards": {"samples_per_shard": 4},
    },
)


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Two drives of six frames in three shards, and four frames of a test drive. Do not write into it."""
    return render_dataset(CONFIG, tmp_path_factory.mktemp("drives") / "dataset")


@pytest.fixture
def driver(drives, tmp_path, vandal_of):
    """Damages drives. ``key`` is the second frame of the first drive."""
    return vandal_of(shutil.copytree(drives, tmp_path / "drives"))


def move(document, x, y, yaw_rad):
    """Put robot and camera somewhere else, consistently."""
    camera = Camera.on_robot(CONFIG.camera, (x, y), yaw_rad)
    document["pose"] = [x, y, yaw_rad]
    document["camera"] |= {"camera_to_world": camera.camera_to_world.tolist(), "yaw_rad": yaw_rad}


def moved_by(dx=0.0, dy=0.0, turn_rad=0.0):
    def change(document):
        x, y, yaw_rad = document["pose"]
        move(document, x + dx, y + dy, yaw_rad + turn_rad)

    return change


def raise_camera(document):
    document["camera"]["camera_to_world"][2][3] += 0.5


def brighten(document):
    document["lights"]["sun"][0] += 0.01


def other_of(texture):
    """Another training texture of the same category."""
    category, number = texture.split("/")
    ids = [n for n in texture_ids(category, "train") if n != int(number)]
    return f"{category}/{ids[0]:02d}"


LIES = {
    "another action": (
        lambda d: d["action"].__setitem__(1, d["action"][1] / 2 + 0.1),
        "its action leads from the frame before to .*, not to its pose",
    ),
    "too much of an action": (
        lambda d: d.update(action=[1.5, 0.0]),
        r"action is \[1\.5, 0\.0\]; allowed: -1",
    ),
    "a step to the side": (moved_by(dx=0.004), "its action leads from the frame before to"),
    "a turn": (moved_by(turn_rad=0.01), "its action leads from the frame before to"),
    "a place outside": (moved_by(dx=500.0), r"the camera at .* is not 0\.25 m clear of all obstacles"),
    "another step": (lambda d: d.update(step=3), r"trajectory and step are 0, 3; by its number \(0, 1\)"),
    "another drive": (
        lambda d: d.update(trajectory=-1, step=0, action=[0.0, 0.0]),
        r"trajectory and step are -1, 0; by its number \(0, 1\)",
    ),
    "a camera in the air": (raise_camera, "is not the pose of yaw_rad, at the height and pitch of the"),
    "another pitch": (lambda d: d["camera"].update(pitch_rad=0.1), r"pitch_rad is 0\.1; the configuration"),
    "another texture of its split": (
        lambda d: d["palette"].__setitem__(0, other_of(d["palette"][0])),
        "slot .* holds .*; the seed draws",
    ),
    "another light": (brighten, "light sun is .*; the configuration gives"),
}


@pytest.mark.parametrize("case", LIES, ids=str)
def test_a_frame_that_is_not_as_planned_is_named_even_where_the_index_agrees(driver, case):
    change, message = LIES[case]
    driver.edit_json(change)
    rewrite_index(driver.folder, read_manifest(driver.folder))
    following = driver.keys[2]  # an action that leads on from a false pose is false, too
    driver.assert_found(message, also=following)


def test_a_drive_is_followed_across_shards(driver):
    driver.key = driver.keys_of("train/train-000001.tar")[0]
    driver.edit_json(lambda d: d["action"].__setitem__(1, d["action"][1] / 2 + 0.1), "train/train-000001.tar")
    rewrite_index(driver.folder, read_manifest(driver.folder))
    driver.assert_found("its action leads from the frame before to", where="train/train-000001.tar")


def test_a_drive_starts_without_an_action(driver):
    driver.key = driver.keys[0]
    driver.edit_json(lambda d: d.update(action=[0.5, 0.0]))
    driver.assert_found(r"action is \[0\.5, 0\.0\] at the start of a drive; allowed: zeros")


def test_a_way_through_furniture_is_named(driver, drives):
    """All poses of a drive are moved alike, so that each action still leads to the next."""
    document = json.loads(dict(driver.files())[f"{driver.keys[0]}.json"])
    scene = json.loads((drives / f"scenes/{document['scene']}.json").read_text())
    piece = next(o for o in scene["objects"] if o["category"] in ("bed", "sofa", "wardrobe", "bathtub"))
    dx, dy = (piece["position"][n] - document["pose"][n] for n in (0, 1))
    for key in driver.keys:
        driver.key = key
        driver.edit_json(moved_by(dx=dx, dy=dy))
    findings = [f for f in verify_dataset(driver.folder).findings if f.where == driver.train and f.key]
    assert sum("is not 0.25 m clear of all obstacles" in f.what for f in findings) >= 1
    assert not any("not to its pose" in f.what for f in findings)


def test_frames_in_another_order_are_named(driver):
    files = driver.files()
    driver.write([*files[:5], *files[10:15], *files[5:10], *files[15:]])
    found = {f.key: f.what for f in verify_dataset(driver.folder).findings if f.where == driver.train}
    assert found[driver.keys[2]].startswith("it has number 2; the one that comes here is 1")


def test_a_key_of_another_number_is_named(driver):
    other = f"{driver.key.rpartition('-')[0]}-000009"
    driver.write([(name.replace(driver.key, other), data) for name, data in driver.files()])
    said = " ".join(f.what for f in verify_dataset(driver.folder).findings if f.key == other)
    assert "it has number 9; the one that comes here is 1" in said


def test_single_views_are_no_drive(vandal):
    vandal.edit_json(lambda d: d.update(trajectory=0, step=1))
    vandal.assert_found(r"trajectory and step are 0, 1; by its number \(-1, 0\)")


def test_a_single_view_from_outside_is_named(vandal):
    vandal.edit_json(moved_by(dx=30.0))
    vandal.assert_found(r"the camera at .* is not 0\.25 m clear of all obstacles")
