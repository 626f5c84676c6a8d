"""Drives against the agent's physics, and against the arithmetic of their own actions."""

import math

import numpy as np
import pytest

from agent.config import EnvConfig
from langwm_data.config import RobotConfig
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.sim.world import World
from langwm_data.trajectories import (
    MAX_ANGULAR_RAD_S,
    MAX_LINEAR_M_S,
    STEP_S,
    Pose,
    drive,
    simulate_trajectory,
)

CLEARANCE_M = 0.25


@pytest.fixture(scope="module")
def trajectories(small_scene):
    """Two drives, each long enough for several goals."""
    robot = RobotConfig(radius_m=CLEARANCE_M + 0.05 / math.sqrt(2))
    space = FreeSpace.from_scene(small_scene, robot=robot)
    return [simulate_trajectory(np.random.default_rng(seed), space, 150) for seed in range(2)]


def test_an_action_means_what_it_means_to_the_agent():
    config = EnvConfig()
    assert (config.max_linear_m_s, config.max_angular_rad_s, config.step_s) == (
        MAX_LINEAR_M_S,
        MAX_ANGULAR_RAD_S,
        STEP_S,
    )


def test_the_physics_of_the_agent_goes_the_same_way_and_touches_nothing(small_scene, trajectories):
    world = World(small_scene, RobotConfig())
    for poses in trajectories:
        world.reset(poses[0].xy, poses[0].yaw_rad)
        for pose in poses[1:]:
            v, omega = pose.action
            state = world.step(v * MAX_LINEAR_M_S, omega * MAX_ANGULAR_RAD_S, STEP_S)
            assert not state.is_collision
            assert math.dist(state.xy, pose.xy) < 1e-3
            assert abs(math.remainder(state.yaw - pose.yaw_rad, 2 * math.pi)) < 1e-9
    world.close()


def test_no_pose_is_nearer_to_an_obstacle_than_asked(small_scene, trajectories):
    space = FreeSpace.from_scene(small_scene, robot=RobotConfig())
    assert min(space.clearance(pose.xy) for poses in trajectories for pose in poses) >= CLEARANCE_M


def test_actions_are_within_their_limits_smooth_and_lead_somewhere(trajectories):
    for poses in trajectories:
        actions = np.array([pose.action for pose in poses])
        assert actions[0].tolist() == [0, 0]
        assert (actions[:, 0] >= 0).all()
        assert np.abs(actions).max() <= 1
        assert np.abs(np.diff(actions[:, 1])).max() <= 0.25 + 1e-9
        assert np.diff(actions[:, 0]).max() <= 0.2 + 1e-9
        assert actions[:, 0].mean() > 0.3


def test_half_a_turn_is_half_a_circle():
    # 20 steps at full turning speed are pi radians; at full speed the circle has radius v / omega.
    pose = Pose(xy=(0.0, 0.0), yaw_rad=0.0)
    for _ in range(20):
        pose = drive(pose, (1.0, 1.0))
    assert pose.xy == pytest.approx((0, 2 * MAX_LINEAR_M_S / MAX_ANGULAR_RAD_S), abs=1e-12)
    assert abs(pose.yaw_rad) == pytest.approx(math.pi)


def test_a_positive_omega_turns_left():
    assert drive(Pose(xy=(0.0, 0.0), yaw_rad=0.0), (0.0, 1.0)) == Pose(
        xy=(0.0, 0.0), yaw_rad=math.radians(9), action=(0.0, 1.0)
    )


def test_a_shorter_drive_is_the_beginning_of_a_longer_one(small_scene, trajectories):
    space = FreeSpace.from_scene(small_scene, robot=RobotConfig(radius_m=CLEARANCE_M + 0.05 / math.sqrt(2)))
    assert simulate_trajectory(np.random.default_rng(0), space, 30) == trajectories[0][:30]
