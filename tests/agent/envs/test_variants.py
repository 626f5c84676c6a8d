"""Every kind of action, protocol and contact in one environment, beside programs that are not ours."""

import dataclasses
import importlib.util
import math
import subprocess
import sys
from itertools import product

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from agent.config import EnvConfig
from agent.envs.actions import make_action
from agent.envs.episodes import Episode, fixed_episodes
from agent.envs.pointnav import PointNavEnv
from langwm_data.config import CameraConfig, RenderConfig
from langwm_data.shards.scenes import write_scene

SMALL = EnvConfig(
    camera=CameraConfig(height=24, width=30),
    render=RenderConfig(texture_px=16),
    distance_edges_m=(1.0, 2.0, 4.0),
)
ACTIONS, PROTOCOLS = ("velocity", "wheel", "kinematic"), ("igibson", "habitat")


def make_env(scene, **changes):
    return PointNavEnv(dataclasses.replace(SMALL, **changes), scenes=[scene])


def place(start, yaw, goal):
    return Episode(
        scene="Alder_0",
        start_xy=start,
        start_yaw=yaw,
        goal_xy=goal,
        palette_seed=1,
        geodesic_distance=1.0,
        tier=0,
    )


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    ("action", "protocol", "contacts", "pose"),
    [(a, p, c, c == "map") for a, p, c in product(ACTIONS, PROTOCOLS, ("physics", "map"))],
)
def test_gymnasium_accepts_every_variant(small_scene, action, protocol, contacts, pose):
    env = make_env(small_scene, action=action, protocol=protocol, contacts=contacts, with_start_pose=pose)
    check_env(env, skip_render_check=True)
    assert env.action_space.shape == (2 + (protocol == "habitat"),)
    assert env.observation_space["task"].shape == (4 + 3 * pose,)
    env.close()


def drive_to_goal(env, info):
    """Turn until the goal is ahead, then drive; stop within 0.15 m."""
    config, is_over, steps = env.config, False, 0
    while not is_over:
        (x, y, yaw), (gx, gy) = info["pose"], info["goal"]
        bearing = math.remainder(math.atan2(gy - y, gx - x) - yaw, 2 * math.pi)
        action = make_action(
            config,
            linear_m_s=0.4 if abs(bearing) < 0.3 else 0.0,
            angular_rad_s=min(max(5 * bearing, -1.5), 1.5),
            is_stop=math.dist((x, y), (gx, gy)) < 0.15,
        )
        _, _, terminated, truncated, info = env.step(action)
        is_over, steps = terminated or truncated, steps + 1
    return info, steps


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("contacts", ["physics", "map"])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_the_goal_is_reached_in_every_variant(small_scene, action, contacts, protocol):
    env = make_env(small_scene, action=action, contacts=contacts, protocol=protocol, is_blind=True)
    _, info = env.reset(options={"episode": place((1.0, 1.5), 2.0, (3.0, 1.2))})
    info, steps = drive_to_goal(env, info)
    env.close()
    assert info["success"]
    assert info["spl"] > 0.98
    assert 45 < steps < 80


def test_the_start_frame_is_that_of_the_start(small_scene):
    env = make_env(small_scene, with_start_pose=True, is_blind=True)
    obs, _ = env.reset(options={"episode": place((1.0, 1.5), math.pi / 2, (3.0, 1.5))})
    np.testing.assert_allclose(obs["task"][4:], 0, atol=1e-7)
    for _ in range(4):
        obs, *_ = env.step(np.array([1.0, 0.0]))
    np.testing.assert_allclose(obs["task"][4:], [0.2, 0, 0], atol=1e-6)
    for _ in range(10):
        obs, *_ = env.step(np.array([0.0, 1.0]))
    obs, _, _, _, info = env.step(np.array([1.0, 0.0]))
    # Facing the other wall now: what lies to the left of the start lies at lower x.
    np.testing.assert_allclose(obs["task"][4:], [0.2, 0.05, math.pi / 2], atol=1e-6)
    np.testing.assert_allclose(info["pose"][:2], [0.95, 1.7], atol=1e-6)
    env.close()


def test_speeds_that_an_action_cannot_exceed_bound_the_task_entry(small_scene):
    for action in ACTIONS:
        env = make_env(small_scene, action=action, is_blind=True)
        space = env.observation_space["task"]
        for entries in product((-1.0, 1.0), repeat=2):
            obs, _ = env.reset(seed=1)
            obs, *_ = env.step(np.array(entries))
            assert space.contains(obs["task"])
        env.close()


def test_a_stop_pays_only_at_the_goal(small_scene):
    env = make_env(small_scene, protocol="habitat", is_blind=True)
    stop = np.array([1.0, 0.0, 1.0])
    for start, goal, reward in (((1.0, 1.5), (1.0, 1.31), 10.0), ((1.0, 1.5), (1.0, 1.29), 0.0)):
        env.reset(options={"episode": place(start, 0.0, goal)})
        _, got, terminated, truncated, info = env.step(stop)
        assert (got, terminated, truncated) == (reward, True, False)
        assert info["success"] == (reward > 0)
        assert info["path_length"] == 0.0
    env.close()


def test_goals_within_the_radius_of_the_protocol_are_refused(small_scene):
    near = dataclasses.replace(SMALL, distance_edges_m=(0.3, 2.0))
    PointNavEnv(dataclasses.replace(near, protocol="habitat"), scenes=[small_scene]).close()
    with pytest.raises(ValueError, match=r"begins at 0\.2 m; it must lie beyond stop_radius_m, 0\.2 m"):
        make_env(small_scene, protocol="habitat", distance_edges_m=(0.2, 2.0))


def test_fixed_episodes_do_not_depend_on_contacts_action_or_protocol(small_scene):
    episodes = fixed_episodes(SMALL, "test", 4, [small_scene])
    for changes in ({"contacts": "map"}, {"action": "wheel"}, {"protocol": "habitat"}):
        assert fixed_episodes(dataclasses.replace(SMALL, **changes), "test", 4, [small_scene]) == episodes


_WITHOUT_PYBULLET = """
import sys
sys.modules["pybullet"] = None
from pathlib import Path
import numpy as np
from agent.config import EnvConfig
from agent.envs.pointnav import PointNavEnv
from langwm_data.config_io import build_config
from langwm_data.shards.scenes import read_scene
for contacts in ("map", "physics"):
    values = {"contacts": contacts, "render": {"texture_px": 16}, "distance_edges_m": [1.0, 4.0]}
    env = PointNavEnv(build_config(EnvConfig, values), scenes=[read_scene(Path(sys.argv[1]), "Alder_0")])
    try:
        obs, _ = env.reset(seed=0)
        for _ in range(20):
            obs, *_ = env.step(np.array([1.0, 0.3]))
        print(bool(obs["rgb"].any()), sys.modules["pybullet"])
    except ValueError as error:
        print(error)
"""


def test_the_map_and_scenes_at_rest_need_no_pybullet(small_scene, tmp_path):
    write_scene(tmp_path, small_scene)
    told = subprocess.run(
        [sys.executable, "-c", _WITHOUT_PYBULLET, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    ).stdout.splitlines()
    assert told[0] == "True None"
    assert "this needs the package pybullet" in told[1]


@pytest.mark.skipif(
    importlib.util.find_spec("stable_baselines3") is None, reason="needs the package stable-baselines3"
)
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_foreign_learner_trains_on_it(small_scene, algorithm):
    from benchmarks.foreign import train

    # Its network for pictures takes none smaller than 36 pixels.
    env = make_env(small_scene, max_steps=40, camera=CameraConfig(height=40, width=48))
    returns = train(algorithm, env, steps=300, seed=0)
    env.close()
    assert len(returns) >= 300 // 40
    assert np.isfinite(returns).all()
