import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.config import EnvConfig, WheelsConfig
from agent.envs.actions import action_space, entry_names, make_action, read_action, speed_limits
from langwm_data.config_io import ConfigError, build_config

KINDS = ("velocity", "wheel", "kinematic")
entries = st.floats(-1, 1, width=32)


def config(action="velocity", **changes):
    return EnvConfig(action=action, **changes)


def asked(config, *values):
    motion = read_action(config, np.array(values, np.float32))
    return motion.linear_m_s, motion.angular_rad_s


def test_velocity_is_in_units_of_the_greatest_speeds():
    assert asked(config(), 1, 0) == (0.5, 0.0)
    assert asked(config(), -0.5, 1) == (-0.25, pytest.approx(math.pi / 2))


def test_wheels_drive_turn_and_pivot_as_igibson_has_it():
    wheels = config("wheel")
    assert asked(wheels, 1, 1) == pytest.approx((0.525, 0.0))
    # Left forwards and right backwards turns to the right; on the spot at 4.6 rad/s.
    assert asked(wheels, 1, -1) == pytest.approx((0.0, -4.5652), abs=1e-4)
    # One wheel standing: the robot turns around it, its middle half as fast as the other wheel.
    linear, angular = asked(wheels, 0, 1)
    assert linear == pytest.approx(0.2625)
    assert linear / angular == pytest.approx(0.23 / 2)
    assert speed_limits(wheels) == pytest.approx((0.525, 4.5652), abs=1e-4)


def test_wheels_are_configurable():
    wheels = config("wheel", wheels=WheelsConfig(max_rad_s=10.0, radius_m=0.05, axle_m=0.5))
    assert asked(wheels, 1, 1) == pytest.approx((0.5, 0.0))
    assert asked(wheels, -1, 1) == pytest.approx((0.0, 2.0))


def test_kinematic_is_metres_and_radians_of_one_step():
    steps = config("kinematic", max_forward_m=0.25, max_turn_rad=math.radians(30))
    linear, angular = asked(steps, 1, 0.5)
    assert (linear * 0.1, angular * 0.1) == pytest.approx((0.25, math.radians(15)))
    assert read_action(steps, np.ones(2)).turns_first
    assert not read_action(config(), np.ones(2)).turns_first


def test_each_kind_can_go_as_far_in_a_step_by_default():
    assert speed_limits(config("kinematic")) == pytest.approx(speed_limits(config()))


@pytest.mark.parametrize("kind", KINDS)
def test_habitat_adds_an_entry_that_stops(kind):
    plain, stopping = config(kind), config(kind, protocol="habitat")
    assert action_space(plain).shape == (2,)
    assert action_space(stopping).shape == (3,)
    assert entry_names(stopping)[-1] == "stop"
    goes = read_action(stopping, np.array([1, 0.5, 0.5]))
    assert goes == read_action(plain, np.array([1, 0.5]))
    stops = read_action(stopping, np.array([1, 0.5, 0.51]))
    assert (stops.linear_m_s, stops.angular_rad_s, stops.is_stop) == (0, 0, True)
    late = dataclasses.replace(stopping, stop_above=0.9)
    assert not read_action(late, np.array([1, 0.5, 0.9])).is_stop


def test_a_uniform_action_stops_one_time_in_four():
    space = action_space(config(protocol="habitat"))
    space.seed(0)
    stops = [read_action(config(protocol="habitat"), space.sample()).is_stop for _ in range(2000)]
    assert np.mean(stops) == pytest.approx(0.25, abs=0.04)


@pytest.mark.parametrize("kind", KINDS)
@given(first=entries, second=entries, stop=st.booleans())
def test_an_action_can_be_made_for_every_motion(kind, first, second, stop):
    for protocol in ("igibson", "habitat"):
        settings = config(kind, protocol=protocol)
        values = [first, second, 1.0 if stop else -1.0][: 2 + (protocol == "habitat")]
        motion = read_action(settings, np.array(values))
        again = read_action(
            settings,
            make_action(
                settings,
                linear_m_s=motion.linear_m_s,
                angular_rad_s=motion.angular_rad_s,
                is_stop=motion.is_stop,
            ),
        )
        assert again.is_stop == motion.is_stop
        found = (again.linear_m_s, again.angular_rad_s)
        assert found == pytest.approx((motion.linear_m_s, motion.angular_rad_s), abs=1e-5)


def test_what_wheels_cannot_do_at_once_keeps_its_arc():
    wheels = config("wheel")
    motion = read_action(wheels, make_action(wheels, linear_m_s=0.525, angular_rad_s=2.0))
    assert motion.linear_m_s / motion.angular_rad_s == pytest.approx(0.525 / 2.0, rel=1e-5)
    assert motion.linear_m_s < 0.525


def test_entries_beyond_the_box_are_clipped():
    assert asked(config(), 7, -9) == (0.5, pytest.approx(-math.pi / 2))


@pytest.mark.parametrize("action", [np.zeros(2), np.zeros((1, 3)), np.array([0, 0, np.nan])])
def test_wrong_actions_are_refused(action):
    with pytest.raises(
        ValueError, match=r"not allowed; give 3 finite numbers: left wheel, right wheel, stop"
    ):
        read_action(config("wheel", protocol="habitat"), action)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"action": "tank"}, r"action.*tank.*velocity"),
        ({"protocol": "gibson"}, r"protocol.*gibson.*igibson"),
        ({"contacts": "feelers"}, r"contacts.*feelers.*physics"),
        ({"stop_above": 1.0}, r"stop_above.*1"),
        ({"max_turn_rad": 4.0}, r"max_turn_rad.*4"),
        ({"wheels": {"axle_m": 0.0}}, r"wheels\.axle_m.*0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        build_config(EnvConfig, values)
