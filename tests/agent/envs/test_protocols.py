"""Both protocols on two hundred drives, beside measures written down here from their definitions."""

import contextlib
import dataclasses
import math

import numpy as np
import pytest

from agent.config import EnvConfig
from agent.envs.episodes import sample_episode
from agent.envs.pointnav import PointNavEnv
from agent.envs.protocols import judge
from agent.envs.sites import Site
from langwm_data.config import CameraConfig
from langwm_data.scenes.navigation import FreeSpace

CONFIG = EnvConfig(
    camera=CameraConfig(height=16, width=16),
    distance_edges_m=(0.5, 1.0, 3.0),
    is_blind=True,
    contacts="map",
    max_steps=60,
)
HABITAT = dataclasses.replace(CONFIG, protocol="habitat")
NUM = 200


def judged(config, **changes):
    verdict = judge(config, **({"straight_m": 5.0, "geodesic_m": 6.0, "is_stop": False} | changes))
    return verdict.is_success, verdict.is_over


def test_igibson_notices_that_the_goal_is_near():
    assert judged(CONFIG, straight_m=0.359) == (True, True)
    assert judged(CONFIG, straight_m=0.36) == (False, False)
    # Straight, even if the way around the wall is long.
    assert judged(CONFIG, straight_m=0.3, geodesic_m=3.0) == (True, True)


def test_habitat_waits_for_the_stop_and_measures_the_way():
    assert judged(HABITAT, straight_m=0.0, geodesic_m=0.0) == (False, False)
    assert judged(HABITAT, straight_m=0.19, geodesic_m=0.199, is_stop=True) == (True, True)
    assert judged(HABITAT, straight_m=0.19, geodesic_m=0.2, is_stop=True) == (False, True)
    assert judged(HABITAT, is_stop=True) == (False, True)


@dataclasses.dataclass
class Drive:
    """What one policy did under both protocols, step by step."""

    goal: tuple
    field: object
    infos: dict
    ends: dict


def policy(rng, info, stops):
    """Towards the goal with some noise; ``stops`` says how near it stops, now and then too early."""
    x, y, yaw = info["pose"]
    gx, gy = info["goal"]
    bearing = math.remainder(math.atan2(gy - y, gx - x) - yaw, 2 * math.pi)
    ahead = 1.0 if abs(bearing) < 0.4 else 0.0
    is_stop = math.dist((x, y), (gx, gy)) < stops or rng.random() < 0.01
    return np.array([ahead + rng.normal(0, 0.1), 3 * bearing + rng.normal(0, 0.3), 1.0 if is_stop else 0.0])


@pytest.fixture(scope="module")
def drives(small_scene):
    with (
        Site(small_scene, CONFIG) as site,
        contextlib.closing(PointNavEnv(CONFIG, scenes=[small_scene])) as igibson,
        contextlib.closing(PointNavEnv(HABITAT, scenes=[small_scene])) as habitat,
    ):
        rng, made = np.random.default_rng(0), []
        free = FreeSpace.from_scene(small_scene, robot=CONFIG.robot)
        for _ in range(NUM):
            episode = sample_episode(rng, site, CONFIG)
            stops = rng.choice([0.1, 0.19, 0.3])
            infos, ends = {}, {}
            for name, env in (("igibson", igibson), ("habitat", habitat)):
                noise = np.random.default_rng(episode.palette_seed)
                _, info = env.reset(options={"episode": episode})
                infos[name], over = [info], False
                while not over:
                    action = policy(noise, info, stops)[: env.action_space.shape[0]]
                    _, _, terminated, truncated, info = env.step(action)
                    over = terminated or truncated
                    infos[name].append(info)
                ends[name] = (terminated, truncated)
            made.append(
                Drive(
                    goal=episode.goal_xy,
                    field=free.distance_field(episode.goal_xy),
                    infos=infos,
                    ends=ends,
                )
            )
    return made


def reference(drive, name):
    """Measures of a finished drive from where the robot was: no code of the environment's."""
    poses = np.array([info["pose"][:2] for info in drive.infos[name]])
    taken = float(np.hypot(*np.diff(poses, axis=0).T).sum())
    shortest, left = (drive.field.distance(poses[i]) for i in (0, -1))
    terminated, truncated = drive.ends[name]
    if name == "igibson":
        success = bool(np.hypot(*(poses[-1] - drive.goal)) < 0.36)
        assert terminated == success
    else:
        success = terminated and left < 0.2
    assert terminated != truncated
    efficiency = shortest / max(shortest, taken)
    return {
        "success": success,
        "spl": success * efficiency,
        "soft_spl": max(0.0, 1 - left / shortest) * efficiency,
        "distance_to_goal": left,
        "path_length": taken,
        "geodesic_distance": shortest,
    }


@pytest.mark.parametrize("name", ["igibson", "habitat"])
def test_measures_are_those_of_the_definitions(drives, name):
    for drive in drives:
        for key, value in reference(drive, name).items():
            assert drive.infos[name][-1][key] == pytest.approx(value, abs=1e-9), key
    successes = sum(drive.infos[name][-1]["success"] for drive in drives)
    assert NUM / 10 < successes < NUM


def test_the_same_drive_differs_in_success_and_spl_alone(drives):
    num_compared = num_early = 0
    for drive in drives:
        igibson, habitat = drive.infos["igibson"], drive.infos["habitat"]
        stopped = drive.ends["habitat"][0]
        # The step of the stop stands still, which under the other protocol it does not.
        shared = min(len(igibson), len(habitat) - stopped)
        for ours, theirs in zip(igibson[:shared], habitat[:shared], strict=True):
            num_compared += 1
            different = {k for k in ours if not np.array_equal(ours[k], theirs[k])}
            assert different == (set() if not ours["success"] else {"success", "spl"})
        num_early += igibson[-1]["success"] and len(habitat) > len(igibson)
        if stopped:
            before, after = habitat[-2:]
            np.testing.assert_array_equal(before["pose"], after["pose"])
            assert before["path_length"] == after["path_length"]
    # Most of those who arrive within 0.36 m must drive on to stop within 0.2 m.
    assert num_compared > 10 * NUM
    assert num_early > NUM / 4


def test_stopping_too_far_away_is_a_failure_that_ends_the_episode(drives):
    ended = [d for d in drives if d.ends["habitat"][0] and not d.infos["habitat"][-1]["success"]]
    assert len(ended) > NUM / 10
    assert all(d.infos["habitat"][-1]["spl"] == 0.0 for d in ended)
    assert any(d.infos["habitat"][-1]["soft_spl"] > 0.3 for d in ended)
