import dataclasses
import json
from pathlib import Path

import pytest

from agent.config import EnvConfig
from agent.envs import episode_file
from agent.envs.episode_file import (
    EpisodeSet,
    check_fits,
    digest_of,
    make_episode_set,
    read_episode_file,
    write_episode_file,
)
from agent.envs.episodes import EPISODES_VERSION, fixed_episodes
from langwm_data.config import RobotConfig, ScenesConfig

CONFIG = EnvConfig(distance_edges_m=(1.0, 2.0, 3.0, 5.0))


@pytest.fixture(scope="module")
def episodes(small_scene):
    return EpisodeSet(
        split="test",
        distance_edges_m=CONFIG.distance_edges_m,
        robot=CONFIG.robot,
        scenes={small_scene.name: digest_of(small_scene)},
        episodes=tuple(fixed_episodes(CONFIG, "test", 6, [small_scene])),
    )


@pytest.fixture
def path(episodes, tmp_path):
    write_episode_file(tmp_path / "episodes.json", episodes)
    return tmp_path / "episodes.json"


def test_episodes_come_back_exactly(episodes, path):
    assert read_episode_file(path) == episodes
    assert read_episode_file(path).sha256 == episodes.sha256 == json.loads(path.read_text())["sha256"]


def test_the_same_set_gives_the_same_bytes(episodes, path, tmp_path):
    write_episode_file(tmp_path / "again.json", read_episode_file(path))
    assert (tmp_path / "again.json").read_bytes() == path.read_bytes()


def test_the_first_of_every_scene(episodes):
    other = tuple(dataclasses.replace(e, scene="B") for e in episodes.episodes)
    both = dataclasses.replace(episodes, episodes=episodes.episodes + other)
    assert both.first(2).episodes == episodes.episodes[:2] + other[:2]
    with pytest.raises(ValueError, match="7 episodes on Alder_0 are wanted; there are 6"):
        both.first(7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "there is no file of episodes at"),
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[1]", "holds no episodes of this program"),
        ('{"format": "other"}', "holds no episodes of this program"),
        ('{"format": "langwm-episodes", "version": NaN}', "is not JSON"),
    ],
)
def test_what_is_no_file_of_episodes_is_refused(text, message, tmp_path):
    if text is not None:
        (tmp_path / "e.json").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_episode_file(tmp_path / "e.json")


def damage(path, change):
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))


def sign_again(path):
    """A file that was changed by someone who knows how checksums are made."""
    values = json.loads(path.read_text())
    del values["sha256"]
    values["sha256"] = episode_file.hashlib.sha256(episode_file._canonical(values)).hexdigest()
    path.write_text(json.dumps(values))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: v.update(version=1), f"of version 1; this program reads {EPISODES_VERSION}"),
        (lambda v: v.update(colour=1), "is damaged: colour"),
        (lambda v: v["episodes"][0].pop("goal_xy"), "is damaged: episodes.0.goal_xy"),
        (lambda v: v["episodes"][0].update(start_yaw="left"), "is damaged: episodes.0.start_yaw"),
        (lambda v: v["episodes"][0].update(start_yaw=0.5), "is damaged: its episodes are not those"),
        (lambda v: v["episodes"].pop(), "is damaged: its episodes are not those"),
    ],
)
def test_damage_is_named(path, change, message):
    damage(path, change)
    with pytest.raises(ValueError, match=message):
        read_episode_file(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: v["episodes"].clear(), "holds no episodes$"),
        (lambda v: v["episodes"][1].update(tier=0), "episode 1 of .* m does not lie in tier 0"),
        (lambda v: v["episodes"][1].update(tier=9), "episode 1 of .* m does not lie in tier 9"),
        (lambda v: v["episodes"][1].update(tier=2**70), "does not lie in tier"),
        (lambda v: v["episodes"][1].update(scene="../x"), "episode 1 is of another version or scene"),
        (lambda v: v["episodes"][1].update(version=1), "episode 1 is of another version or scene"),
    ],
)
def test_episodes_that_contradict_the_file_are_refused(path, change, message):
    damage(path, change)
    sign_again(path)
    with pytest.raises(ValueError, match=message):
        read_episode_file(path)


def test_a_file_that_is_too_large_is_not_read(path, monkeypatch):
    monkeypatch.setattr(episode_file, "LARGEST_BYTES", 100)
    with pytest.raises(ValueError, match="bytes; allowed: 100 or fewer"):
        read_episode_file(path)


@pytest.fixture(scope="module")
def homes():
    return make_episode_set(EnvConfig(), "test", 3)


def test_every_test_floor_has_as_many_episodes_in_every_tier(homes):
    assert homes.counts() == dict.fromkeys(homes.scenes, 3)
    assert [e.tier for e in homes.episodes] == [0, 1, 2] * len(homes.scenes)
    check_fits(homes, EnvConfig(), "test", Path("e.json"))


@pytest.mark.parametrize(
    ("config", "split", "message"),
    [
        ({}, "train", "e.json holds episodes of test floors; --split train was asked for"),
        ({"robot": RobotConfig(radius_m=0.2)}, "test", r"e.json was made for RobotConfig\(radius_m=0.176"),
        ({"distance_edges_m": (1.0, 3.5)}, "test", r"distances 1, 3, 6, 10 m between .* has 1, 3.5"),
        ({"scenes": ScenesConfig(seed=5)}, "test", "was made for another scene 'Maple_0'"),
    ],
)
def test_episodes_of_something_else_are_refused(homes, config, split, message):
    with pytest.raises(ValueError, match=message):
        check_fits(homes, EnvConfig(**config), split, Path("e.json"))


def test_episodes_in_unknown_scenes_are_refused(homes):
    other = dataclasses.replace(homes, scenes={"Attic_0": "00"})
    with pytest.raises(ValueError, match="episodes in scene 'Attic_0'; this environment has Maple_0"):
        check_fits(other, EnvConfig(), "test", Path("e.json"))
