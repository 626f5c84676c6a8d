import dataclasses
import json
import math

import numpy as np
import pytest

from agent.config import EnvConfig
from agent.envs.episodes import Episode, fixed_episodes, sample_episode
from agent.envs.sites import Site
from langwm_data.config_io import ConfigError, build_config

CONFIG = EnvConfig(distance_edges_m=(1.0, 2.0, 3.0, 5.0))


@pytest.fixture(scope="module")
def site(small_scene):
    with Site(small_scene, CONFIG) as site:
        yield site


@pytest.fixture(scope="module")
def fixed(small_scene):
    return fixed_episodes(CONFIG, "test", 9, [small_scene])


def test_episodes_start_and_end_where_the_robot_fits(site):
    rng = np.random.default_rng(0)
    for _ in range(20):
        e = sample_episode(rng, site, CONFIG)
        assert not site.world.collides(e.start_xy, e.start_yaw)
        assert not site.world.collides(e.goal_xy, 0.0)
        assert 1.0 <= e.geodesic_distance < 5.0
        assert -math.pi <= e.start_yaw < math.pi
        # Interpolation on the grid may fall short of the straight line by a fraction of a cell.
        assert e.geodesic_distance > math.dist(e.start_xy, e.goal_xy) - 0.1


def test_the_distance_is_that_of_the_free_space(site):
    e = sample_episode(np.random.default_rng(1), site, CONFIG)
    assert e.geodesic_distance == float(site.free.distance_field(e.goal_xy).distance(e.start_xy))


def test_a_tier_bounds_the_distance(site):
    rng = np.random.default_rng(2)
    for tier, (low, high) in enumerate([(1, 2), (2, 3), (3, 5)]):
        e = sample_episode(rng, site, CONFIG, tier=tier)
        assert low <= e.geodesic_distance < high
        assert e.tier == tier


def test_drawn_episodes_may_keep_to_the_nearest_tiers(site):
    rng = np.random.default_rng(4)
    near = dataclasses.replace(CONFIG, drawn_tiers=2)
    drawn = [sample_episode(rng, site, near) for _ in range(20)]
    assert {e.tier for e in drawn} == {0, 1}
    assert all(e.geodesic_distance < 3.0 for e in drawn)
    assert sample_episode(rng, site, near, tier=2).tier == 2


def test_more_tiers_than_there_are_cannot_be_drawn_from():
    assert build_config(EnvConfig, {"drawn_tiers": 3}).drawn_tiers == 3
    with pytest.raises(
        ConfigError, match=r"env\.drawn_tiers 4 is not allowed: env\.distance_edges_m has 3 tiers"
    ):
        build_config(EnvConfig, {"drawn_tiers": 4})


def test_both_rooms_are_visited(site):
    rng = np.random.default_rng(3)
    episodes = [sample_episode(rng, site, CONFIG) for _ in range(30)]
    assert {e.start_xy[0] < 4 for e in episodes} == {True, False}
    assert {e.goal_xy[0] < 4 for e in episodes} == {True, False}


def test_fixed_episodes_are_the_same_every_time(small_scene, fixed):
    assert fixed_episodes(CONFIG, "test", 9, [small_scene]) == fixed


def test_a_shorter_list_is_the_beginning_of_a_longer_one(small_scene, fixed):
    assert fixed_episodes(CONFIG, "test", 4, [small_scene]) == fixed[:4]


def test_fixed_episodes_cover_the_tiers_evenly(fixed):
    assert [e.tier for e in fixed] == [0, 1, 2] * 3


def test_another_seed_or_split_gives_other_episodes(small_scene, fixed):
    other = dataclasses.replace(CONFIG, seed_eval=1)
    assert fixed_episodes(other, "test", 1, [small_scene])[0] != fixed[0]
    assert fixed_episodes(CONFIG, "train", 1, [small_scene])[0] != fixed[0]


def test_episodes_survive_json(fixed):
    for e in fixed:
        assert Episode.from_dict(json.loads(json.dumps(e.to_dict()))) == e


def test_wrong_episode_files_are_refused(fixed):
    values = fixed[0].to_dict()
    with pytest.raises(ValueError, match="episode has version 7; this program reads 3"):
        Episode.from_dict(values | {"version": 7})
    with pytest.raises(ValueError, match=r"not an episode: .*colour"):
        Episode.from_dict(values | {"colour": 1})
    with pytest.raises(ValueError, match=r"not an episode: .*goal_xy"):
        Episode.from_dict({k: v for k, v in values.items() if k != "goal_xy"})


@pytest.mark.parametrize(
    "change",
    [
        {"start_yaw": math.nan},
        {"goal_xy": (1.0, math.inf)},
        {"tier": -1},
        {"start_xy": (1.0,)},
        {"palette_seed": -1},
    ],
)
def test_impossible_episodes_are_refused(fixed, change):
    with pytest.raises(ValueError, match=f"not an episode: {next(iter(change))}"):
        Episode.from_dict(fixed[0].to_dict() | change)


def test_a_tier_that_a_scene_is_too_small_for_is_left_out(small_scene, caplog):
    config = dataclasses.replace(CONFIG, distance_edges_m=(1.0, 2.0, 3.0, 30.0, 40.0))
    episodes = fixed_episodes(config, "test", 8, [small_scene])
    assert [e.tier for e in episodes] == [0, 1, 2, 0, 1, 2, 0, 1]
    assert fixed_episodes(config, "test", 5, [small_scene]) == episodes[:5]
    assert "no start and goal 30 to 40 m apart; its other distances take turns" in caplog.text


def test_a_scene_too_small_for_the_distance_is_named(site):
    far = dataclasses.replace(CONFIG, distance_edges_m=(30.0, 40.0))
    with pytest.raises(ValueError, match="'Alder_0': found no start and goal 30 to 40 m apart"):
        sample_episode(np.random.default_rng(0), site, far)
    with pytest.raises(ValueError, match="found no start and goal 30 to 40 m apart"):
        fixed_episodes(far, "test", 1, [site.scene])


@pytest.mark.parametrize("edges", [[1.0], [3.0, 1.0], [0.0, 2.0]])
def test_distance_edges_must_ascend(edges):
    with pytest.raises(ConfigError, match=r"distance_edges_m.*at least two positive distances in ascending"):
        build_config(EnvConfig, {"distance_edges_m": edges})
