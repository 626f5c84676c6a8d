import contextlib
import dataclasses

import numpy as np
import pytest

from agent.envs.pointnav import PointNavEnv
from agent.systems.oracle_boxes import KINDS, NUM_PLACES, describe_objects, wrap_env
from agent.systems.registry import load_agent_config
from langwm_data.config_io import ConfigError
from pretrain.frames import FrameObject

WIDTH = NUM_PLACES + len(KINDS)


def make_object(category, distance_m, box=(8.0, 4.0, 16.0, 20.0)):
    return FrameObject(category=category, bbox_xyxy=box, center_x=12.0, distance_m=distance_m)


def describe(*objects, num_objects=3):
    vector = describe_objects(objects, num_objects, height=40, width=80)
    assert vector.dtype == np.float32
    return vector.reshape(num_objects, WIDTH)


def test_the_nearest_come_first_and_the_farthest_are_left_out():
    things = [make_object("chair", d) for d in (4.0, 1.0, 3.0, 2.0)]
    np.testing.assert_allclose(describe(*things)[:, 5], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(describe(*things), describe(*things[::-1]))


def test_layout_of_an_object():
    row = describe(make_object("bed", 2.5))[0]
    np.testing.assert_allclose(row[:NUM_PLACES], [1, 0.1, 0.1, 0.2, 0.5, 0.25])
    assert np.flatnonzero(row[NUM_PLACES:]).tolist() == [KINDS.index("bed")]
    assert not describe(make_object("bed", 2.5))[1:].any()


def test_what_lies_beyond_the_horizon_lies_on_it_and_unknown_kinds_have_none():
    row = describe(make_object("spaceship", 20.0))[0]
    assert row[5] == 1
    assert not row[NUM_PLACES:].any()


def test_nothing_in_sight_is_all_zeros():
    assert not describe().any()


def test_the_environment_shows_the_vector(tiny_config, make_room):
    env = wrap_env(tiny_config, make_room())
    obs, _ = env.reset(seed=0)
    rows = obs["features"].reshape(2, WIDTH)
    np.testing.assert_allclose(rows[0, :6], [1, 2 / 16, 2 / 16, 9 / 16, 9 / 16, 0.2], atol=1e-3)
    assert rows[0, NUM_PLACES + KINDS.index("chair")] == 1
    assert not rows[1].any()


def test_an_environment_without_labels_is_refused(tiny_config, make_room):
    room = make_room()
    room.describe = lambda is_success: {}
    config = dataclasses.replace(tiny_config, system="dreamerv2-oracle-boxes")
    with pytest.raises(
        ConfigError, match=r"'dreamerv2-oracle-boxes' needs info\['objects'\] .*with_labels=true"
    ):
        wrap_env(config, room).reset(seed=0)


def test_homes_without_labels_are_refused_before_an_episode_begins():
    config = load_agent_config(
        "dreamerv2-oracle-boxes", presets=["debug"], overrides={"env": {"with_labels": False}}
    )
    with (
        contextlib.closing(PointNavEnv(config.env)) as env,
        pytest.raises(ConfigError, match="with_labels=true"),
    ):
        wrap_env(config, env)
