import dataclasses

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env

from agent.config import EnvConfig
from agent.envs.foreign import ForeignEnv, adapt_env
from agent.envs.make import check_gives, make_env
from agent.envs.outcomes import EpisodeRecord
from agent.rollout import Collector, run_episode
from agent.systems.system import UNBOUNDED, Spaces, task_scale
from langwm_data.config import CameraConfig
from langwm_data.config_io import ConfigError, build_config

SMALL = CameraConfig(height=16, width=16)


class Lift(gymnasium.Env):
    """A height that the action moves; ends at the top. Everything it observes is made from the height."""

    def __init__(self, size=8, with_depth=False, low=(0.0,), high=(4.0,)):
        self.size, self.with_depth = size, with_depth
        self.action_space = spaces.Box(np.array(low, np.float32), np.array(high, np.float32))
        entries = {
            "rgb": spaces.Box(0, 255, (size, 2 * size, 3), np.uint8),
            "speed": spaces.Box(-2.0, 2.0, (1,), np.float32),
            "height": spaces.Box(-np.inf, np.inf, (2, 1), np.float32),
        }
        if with_depth:
            entries["depth"] = spaces.Box(0.0, 9.0, (size, 2 * size, 1), np.float32)
        self.observation_space = spaces.Dict(entries)
        self.actions = []

    def observe(self):
        frame = np.full((self.size, 2 * self.size, 3), min(255, int(10 * self.height)), np.uint8)
        frame[: self.size // 2] = 0
        seen = {"rgb": frame, "speed": np.array([0.5], np.float32)}
        seen["height"] = np.array([[self.height], [-self.height]], np.float32)
        if self.with_depth:
            seen["depth"] = np.full((self.size, 2 * self.size, 1), 1.5, np.float32)
        return seen

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.height = float(self.np_random.uniform(0, 1))
        return self.observe(), {}

    def step(self, action):
        assert self.action_space.contains(action)
        self.actions.append(action)
        self.height += float(action[0])
        return self.observe(), float(action[0]), self.height > 9, False, {"is_success": self.height > 9}


gymnasium.register("Tests/Lift-v0", entry_point=Lift, max_episode_steps=5)


def config_of(name, **fields):
    return EnvConfig(id=name, camera=SMALL, **fields)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_gymnasium_finds_nothing_wrong_with_an_adapted_env():
    check_env(make_env(config_of("Tests/Lift-v0", kwargs={"with_depth": True})), skip_render_check=True)


def test_every_number_but_the_frame_and_the_depth_is_the_task_in_the_order_of_names():
    env = make_env(config_of("Tests/Lift-v0", kwargs={"with_depth": True}))
    obs, _ = env.reset(seed=0)
    height = env.unwrapped.height
    np.testing.assert_allclose(obs["task"], [height, -height, 0.5], rtol=1e-6)
    assert obs["depth"].shape == (16, 16)
    assert (obs["depth"] == 1.5).all()


def test_frames_are_resized_to_the_camera_the_right_way_up():
    env = make_env(config_of("Tests/Lift-v0"))
    env.reset(seed=0)
    obs = env.step(np.ones(1, np.float32))[0]
    assert obs["rgb"].shape == (16, 16, 3)
    assert (obs["rgb"][:7] == 0).all()
    assert (obs["rgb"][9:] == int(10 * env.unwrapped.height)).all()


@pytest.mark.parametrize(("ours", "theirs"), [(-1, 2.0), (0, 3.0), (1, 4.0), (7, 4.0)])
def test_actions_from_minus_one_to_one_cover_the_bounds(ours, theirs):
    env = ForeignEnv(Lift(low=(2.0,)), size=(16, 16))
    env.reset(seed=0)
    env.step(np.array([ours], np.float32))
    assert env.unwrapped.actions[0] == pytest.approx(theirs)
    assert env.unwrapped.actions[0].dtype == np.float32


def test_a_picture_alone_is_enough_and_its_task_is_one_zero():
    class Picture(Lift):
        def __init__(self):
            super().__init__()
            self.observation_space = spaces.Box(0, 255, (8, 8, 1), np.uint8)

        def observe(self):
            return np.full((8, 8, 1), 3, np.uint8)

    obs, _ = ForeignEnv(Picture(), size=(8, 8)).reset(seed=0)
    assert (obs["rgb"] == 3).all()
    assert obs["rgb"].shape == (8, 8, 3)
    np.testing.assert_array_equal(obs["task"], [0.0])


def test_pixels_are_what_the_env_renders_in_place_of_its_vector():
    class Drawn(gymnasium.Env):
        observation_space = spaces.Box(-1, 1, (3,), np.float32)
        action_space = spaces.Box(-1, 1, (1,), np.float32)

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            return np.ones(3, np.float32), {}

        def render(self):
            return np.full((4, 4, 3), 77, np.uint8)

    env = ForeignEnv(Drawn(), size=(16, 16), has_pixels=True)
    obs, _ = env.reset(seed=0)
    assert (obs["rgb"] == 77).all()
    assert obs["task"].shape == (1,)
    Drawn.render = lambda self: None
    with pytest.raises(ConfigError, match=r"env\.pixels needs an environment whose render returns a picture"):
        env.reset(seed=0)


def test_what_agents_know_already_is_left_as_it_is(make_room):
    room = make_room()
    assert adapt_env(room, size=(16, 16)) is room
    assert adapt_env(room, size=(32, 32)).reset(seed=0)[0]["rgb"].shape == (32, 32, 3)


def test_an_episode_of_any_env_says_what_it_knows():
    up = lambda obs, state: (np.ones(1, np.float32), state)  # noqa: E731
    outcome = run_episode(make_env(config_of("Tests/Lift-v0")), up, seed=0)
    assert not isinstance(outcome, EpisodeRecord)
    assert outcome.is_terminated
    assert outcome.metrics() == {"env/return": 12.0, "env/success": 1.0, "env/length": 3.0}
    still = lambda obs, state: (-np.ones(1, np.float32), state)  # noqa: E731
    outcome = run_episode(make_env(config_of("Tests/Lift-v0")), still, seed=0)
    assert not outcome.is_terminated
    assert outcome.num_steps == 5


@pytest.mark.parametrize(("value", "is_terminal"), [(1.0, True), (-1.0, False)])
def test_a_time_limit_is_no_end_in_the_replay(value, is_terminal):
    collector = Collector(make_env(config_of("Tests/Lift-v0")), seed=0, with_depth=False, with_objects=False)
    act = lambda obs, state: (np.array([value], np.float32), state)  # noqa: E731
    done = None
    while done is None:
        done = collector.step(act)
    assert done.replay.is_terminal is is_terminal
    assert done.replay.depth_mm is None


def test_the_scale_of_the_task_follows_the_env_unless_it_is_given(tiny_config):
    found = Spaces.of(make_env(config_of("Tests/Lift-v0")))
    assert task_scale(tiny_config, found) == (UNBOUNDED, UNBOUNDED, 2.0)
    task = dataclasses.replace(tiny_config.world_model.task, scale=(1.0, 2.0, 3.0))
    given = dataclasses.replace(
        tiny_config, world_model=dataclasses.replace(tiny_config.world_model, task=task)
    )
    assert task_scale(given, found) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("name", "fields", "message"),
    [
        ("Nothing-v0", {}, r"env\.id 'Nothing-v0' cannot be made: NameNotFound"),
        ("nowhere:Nothing-v0", {}, r"env\.id 'nowhere:Nothing-v0' cannot be made: ModuleNotFoundError"),
        ("Tests/Lift-v0", {"kwargs": {"wings": 2}}, r"cannot be made: TypeError.*wings"),
        ("Pendulum-v1", {}, r"env 'Pendulum-v1' observes Box.*which has no frames; allowed: a picture"),
        ("CartPole-v1", {}, r"env 'CartPole-v1' observes Box.*which has no frames"),
        (
            "Tests/Lift-v0",
            {"kwargs": {"high": (np.inf,)}},
            r"has actions Box.*allowed: a Box of numbers with finite",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(name, fields, message):
    with pytest.raises(ConfigError, match=message) as refused:
        make_env(config_of(name, **fields))
    assert "\n" not in str(refused.value)


class Broken(Lift):
    """Lacks what one of its methods needs."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012

    def __init__(self, broken, render_mode=None):
        super().__init__()
        self.broken, self.render_mode = broken, render_mode

    def reset(self, *, seed=None, options=None):
        self.need("reset")
        return super().reset(seed=seed, options=options)

    def step(self, action):
        self.need("step")
        return super().step(action)

    def render(self):
        self.need("render")

    def need(self, name):
        if self.broken == name:
            raise gymnasium.error.DependencyNotInstalled("pygame is not installed,\nrun pip.")


gymnasium.register("Tests/Broken-v0", entry_point=Broken)


@pytest.mark.parametrize("broken", ["reset", "step", "render"])
def test_what_breaks_in_use_is_one_sentence(broken):
    kwargs = {"broken": broken}
    config = EnvConfig(id="Tests/Broken-v0", camera=SMALL, kwargs=kwargs, pixels=broken == "render")
    env = make_env(config)
    done = {"reset": "reset", "step": "stepped", "render": "rendered"}[broken]
    reason = "DependencyNotInstalled: pygame is not installed, run pip"
    with pytest.raises(ConfigError, match=rf"env.id 'Tests/Broken-v0' cannot be {done}: {reason}$"):
        run_episode(env, lambda obs, state: (np.ones(1), None), seed=0)


def test_errors_of_an_env_of_the_callers_are_the_callers():
    env = make_env(EnvConfig(camera=SMALL), Broken("reset"))
    with pytest.raises(gymnasium.error.DependencyNotInstalled):
        env.reset(seed=0)


def test_what_no_file_can_hold_is_no_word_about_an_env():
    message = r"'kwargs': value {'high': \[inf\]} is not allowed: all numbers should be finite"
    with pytest.raises(ConfigError, match=message):
        build_config(EnvConfig, {"id": "Tests/Lift-v0", "kwargs": {"high": [np.inf]}})


def test_words_about_an_env_need_an_env():
    with pytest.raises(ConfigError, match=r"env\.kwargs and env\.pixels are of another environment"):
        EnvConfig(pixels=True)


def test_systems_that_need_depth_or_labels_refuse_an_env_without():
    env = make_env(config_of("Tests/Lift-v0"))
    with pytest.raises(
        ConfigError, match=r"'langwm' is to be given depth in its observation and objects in its info"
    ):
        check_gives(env, "langwm", labels=True, depth=True)
    check_gives(env, "dreamerv2", labels=False, depth=False)
    with_depth = make_env(config_of("Tests/Lift-v0", kwargs={"with_depth": True}))
    check_gives(with_depth, "langwm", labels=False, depth=True)


def test_configs_of_environments_can_be_keys():
    one, other = (config_of("Tests/Lift-v0", kwargs={"size": size}) for size in (8, 9))
    assert len({one: 1, other: 2, config_of("Tests/Lift-v0", kwargs={"size": 8}): 3}) == 2
