import dataclasses
import math
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import agent  # noqa: F401  # registers the environment
from agent.config import EnvConfig, EpisodeRandomizeConfig
from agent.envs.episodes import Episode
from agent.envs.pointnav import PointNavEnv
from agent.rollout import Collector
from langwm_data.config import CameraConfig, RenderConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.splits import HELD_OUT_TEXTURE_IDS
from langwm_data.sim.bullet import import_pybullet
from langwm_data.sim.lights import Lights

AHEAD, BACK, LEFT = (np.array(a, np.float32) for a in ([1, 0], [-1, 0], [0, 1]))
SMALL = EnvConfig(
    camera=CameraConfig(height=24, width=30),
    render=RenderConfig(texture_px=16),
    distance_edges_m=(1.0, 2.0, 4.0),
)


def config(**changes):
    return dataclasses.replace(SMALL, **changes)


def episode(start, yaw, goal, **changes):
    values = {"scene": "Alder_0", "palette_seed": 1, "geodesic_distance": 1.0, "tier": 0}
    return Episode(start_xy=start, start_yaw=yaw, goal_xy=goal, **(values | changes))


@pytest.fixture(scope="module")
def empty_scene(small_scene):
    """Study (0..4 x 0..3) and hall (4.1..6.1 x 0..3) without furniture, door at x = 4.05, y = 1.0..1.9."""
    return dataclasses.replace(small_scene, objects=())


@pytest.fixture(scope="module")
def env(empty_scene):
    env = PointNavEnv(SMALL, scenes=[empty_scene])
    yield env
    env.close()


def play(env, start, yaw, goal, **changes):
    return env.reset(options={"episode": episode(start, yaw, goal, **changes)})


def test_gymnasium_accepts_it(small_scene):
    env = PointNavEnv(SMALL, scenes=[small_scene], render_mode="rgb_array")
    check_env(env, skip_render_check=False)
    env.close()


@pytest.mark.parametrize(
    ("goal", "yaw", "bearing"),
    [
        ((2.0, 2.5), 0.0, math.pi / 4),
        ((2.0, 0.5), 0.0, -math.pi / 4),
        ((2.0, 1.5), -math.pi / 2, math.pi / 2),
        ((0.5, 2.0), -3.0, 3 * math.pi / 4 + 3.0 - 2 * math.pi),
    ],
)
def test_a_goal_on_the_left_has_a_positive_bearing(env, goal, yaw, bearing):
    obs, _ = play(env, (1.0, 1.5), yaw, goal)
    distance = math.dist((1.0, 1.5), goal)
    np.testing.assert_allclose(obs["task"], [distance, bearing, 0, 0], atol=1e-5)


def test_five_centimetres_ahead_in_a_step(env):
    yaw = 0.7
    _, before = play(env, (1.5, 1.5), yaw, (3.0, 2.5))
    obs, _, _, _, after = env.step(AHEAD)
    for _ in range(9):
        obs, _, _, _, after = env.step(AHEAD)
    np.testing.assert_allclose(
        after["pose"] - before["pose"], [0.5 * math.cos(yaw), 0.5 * math.sin(yaw), 0], atol=1e-3
    )
    assert obs["task"][2] == pytest.approx(0.5, abs=1e-3)
    assert after["path_length"] == pytest.approx(0.5, abs=1e-3)


def test_reverse_is_allowed(env):
    _, before = play(env, (1.5, 1.5), 0.0, (3.0, 1.5))
    obs, reward, *_, after = env.step(BACK)
    np.testing.assert_allclose(after["pose"] - before["pose"], [-0.05, 0, 0], atol=1e-3)
    assert obs["task"][2] == pytest.approx(-0.5, abs=1e-3)
    assert reward == pytest.approx(-0.05, abs=0.01)


def test_nine_degrees_to_the_left_in_a_step(env):
    _, before = play(env, (1.5, 1.5), 0.0, (3.0, 1.5))
    obs, _, _, _, after = env.step(LEFT)
    np.testing.assert_allclose(after["pose"] - before["pose"], [0, 0, math.radians(9)], atol=1e-3)
    assert obs["task"][1] == pytest.approx(-math.radians(9), abs=1e-3)
    assert obs["task"][3] == pytest.approx(math.pi / 2, abs=1e-3)


def test_turning_left_moves_what_is_seen_to_the_right(env):
    obs, _ = play(env, (1.0, 1.5), 0.0, (3.0, 1.5))
    ahead = obs["depth"]
    obs, *_ = env.step(LEFT)
    # Facing +x the far wall is 3 m away at the door's edge; turned left, the near wall at y = 3 comes
    # in from the left.
    row = obs["depth"].shape[0] // 2
    assert obs["depth"][row, 0] < ahead[row, 0]


def test_actions_beyond_the_box_are_clipped(env):
    play(env, (1.5, 1.5), 0.0, (3.0, 1.5))
    *_, info = env.step(np.array([7.0, 0.0], np.float32))
    assert info["pose"][0] == pytest.approx(1.55, abs=1e-3)


def test_reward_is_the_progress_along_the_shortest_way(env):
    _, before = play(env, (1.0, 1.5), 0.0, (3.0, 1.5))
    total = 0.0
    for _ in range(10):
        _, reward, _, _, info = env.step(AHEAD)
        total += reward
    assert total == pytest.approx(0.5, abs=0.02)
    assert total == pytest.approx(before["distance_to_goal"] - info["distance_to_goal"])


def test_the_shortest_way_leads_through_the_door(env):
    _, info = play(env, (3.4, 0.4), 0.0, (4.7, 0.4))
    # Straight to a circle of the robot's radius around the post at (4.0, 1.0), along it until heading
    # for +x, 10 cm to the post at (4.1, 1.0), and the same in reverse: 2.11 m.
    radius, away = 0.176, math.dist((3.4, 0.4), (4.0, 1.0))
    turn = math.pi / 4 + math.asin(radius / away)
    by_hand = 2 * (math.sqrt(away**2 - radius**2) + radius * turn) + 0.1
    assert info["geodesic_distance"] == pytest.approx(by_hand, rel=0.12)


def test_where_no_way_is_known_the_last_distance_stays(env, monkeypatch):
    _, before = play(env, (1.0, 1.5), 0.0, (3.0, 1.5))
    monkeypatch.setattr(env, "_field", SimpleNamespace(distance=lambda xy: math.inf))
    _, reward, *_, info = env.step(AHEAD)
    assert info["distance_to_goal"] == before["distance_to_goal"]
    assert reward == 0.0


def test_contact_costs_a_tenth_per_step(env):
    play(env, (0.3, 1.5), math.pi, (3.0, 1.5))
    rewards, infos = [], []
    for _ in range(12):
        _, reward, _, _, info = env.step(AHEAD)
        rewards.append(reward)
        infos.append(info)
    assert infos[0]["collisions"] == 0
    assert infos[-1]["collisions"] >= 8
    assert infos[-1]["pose"][0] > 0.15
    assert rewards[-1] == pytest.approx(-0.1, abs=0.02)


def test_arriving_terminates_and_pays_ten(env):
    play(env, (1.0, 1.5), 0.0, (2.5, 1.5))
    terminated, steps = False, 0
    while not terminated:
        obs, reward, terminated, truncated, info = env.step(AHEAD)
        assert not truncated
        steps += 1
    assert steps == 23  # 1.5 m less 0.36 m in steps of 5 cm
    assert obs["task"][0] < 0.36
    assert reward == pytest.approx(10.05, abs=0.02)
    assert info["success"]
    assert info["spl"] == 1.0
    assert info["soft_spl"] == pytest.approx(1 - 0.35 / 1.5, abs=0.05)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(AHEAD)


def test_running_out_of_time_truncates(empty_scene):
    env = PointNavEnv(config(max_steps=3), scenes=[empty_scene])
    play(env, (1.0, 1.5), 0.0, (3.0, 1.5))
    flags = [env.step(LEFT)[2:4] for _ in range(3)]
    assert flags == [(False, False), (False, False), (False, True)]
    _, info = play(env, (1.0, 1.5), 0.0, (1.45, 1.5))
    assert not info["success"]
    env.step(LEFT * 0)
    env.step(LEFT * 0)
    _, _, terminated, truncated, info = env.step(AHEAD * 2)
    assert (terminated, truncated) == (info["success"], not info["success"])
    env.close()


def test_arriving_in_the_last_step_is_a_success(empty_scene):
    env = PointNavEnv(config(max_steps=2), scenes=[empty_scene])
    play(env, (1.0, 1.5), 0.0, (1.44, 1.5))
    env.step(AHEAD)
    _, _, terminated, truncated, _ = env.step(AHEAD)
    assert (terminated, truncated) == (True, False)
    env.close()


def roll(env, actions, **how):
    obs, info = env.reset(**how)
    trace = [obs["rgb"], obs["depth"], obs["task"], info["pose"]]
    for action in actions:
        obs, reward, terminated, truncated, info = env.step(action)
        trace += [obs["rgb"], obs["depth"], obs["task"], info["pose"], np.float64(reward)]
        if terminated or truncated:
            break
    return trace


def assert_same_trace(a, b):
    assert len(a) == len(b)
    for x, y in zip(a, b, strict=True):
        np.testing.assert_array_equal(x, y)


def test_same_seed_and_actions_same_bits_whatever_came_before(small_scene, empty_scene):
    other = dataclasses.replace(empty_scene, name="Alder_1", floor=1)
    actions = np.random.default_rng(0).uniform(-1, 1, (40, 2)).astype(np.float32)
    first = PointNavEnv(SMALL, scenes=[small_scene, other])
    expected = roll(first, actions, seed=12)
    roll(first, actions[::-1], seed=13)
    roll(first, actions[:5])
    assert_same_trace(roll(first, actions, seed=12), expected)
    second = PointNavEnv(SMALL, scenes=[small_scene, other])
    assert_same_trace(roll(second, actions, options={"episode": first.episode.to_dict()}), expected)
    first.close()
    second.close()


def test_collecting_in_it_goes_on_exactly_after_a_restart(small_scene):
    def policy(obs, state):
        return np.array([obs["rgb"].mean() / 128 - 1, obs["task"][1] / 4], np.float32), None

    def collect(collector, count):
        return [done for _ in range(count) if (done := collector.step(policy)) is not None]

    envs = [PointNavEnv(config(max_steps=20), scenes=[small_scene]) for _ in range(2)]
    first = Collector(envs[0], seed=3)
    collect(first, 25)
    (expected,) = collect(second := Collector(envs[1], seed=3, state=first.state_dict()), 15)
    (found,) = collect(first, 15)
    assert second.num_episodes == first.num_episodes == 2
    for name in ("rgb", "depth_mm", "task", "action", "reward"):
        np.testing.assert_array_equal(getattr(found.replay, name), getattr(expected.replay, name))
    for env in envs:
        env.close()


def test_floors_are_visited_in_turn_from_the_seed_on(empty_scene):
    names = ("Alder_0", "Alder_1", "Birch_0")
    env = PointNavEnv(SMALL, scenes=[dataclasses.replace(empty_scene, name=n) for n in names])
    visited = [env.reset(seed=4)[1]["scene"], *(env.reset()[1]["scene"] for _ in range(3))]
    assert visited == ["Alder_1", "Birch_0", "Alder_0", "Alder_1"]
    assert [env.reset(seed=s)[1]["scene"] for s in (6, 7, 8)] == list(names)
    env.close()


def test_every_episode_has_its_own_textures(env):
    env.reset(seed=1)
    first = env.palette
    env.reset()
    assert env.palette != first


def test_lights_stay_as_configured_unless_asked_for(env):
    bright = Lights.of(SMALL.render.lights)
    for seed in (1, 2):
        _, info = play(env, (1.0, 1.5), 0.0, (3.0, 1.5), palette_seed=seed)
        assert env.lights == bright
        np.testing.assert_array_equal(info["lights"], list(bright.describe().values()))


def test_every_episode_has_its_own_lights_and_replays_them(empty_scene):
    lit = PointNavEnv(config(randomize=EpisodeRandomizeConfig(lights="episode")), scenes=[empty_scene])
    seen = {}
    for seed in (1, 2, 1):
        obs, info = play(lit, (1.0, 1.5), 0.0, (3.0, 1.5), palette_seed=seed)
        again = seen.setdefault(seed, (lit.lights, obs["rgb"], info["lights"]))
        assert lit.lights == again[0]
        np.testing.assert_array_equal(obs["rgb"], again[1])
        np.testing.assert_array_equal(lit.step(AHEAD)[4]["lights"], again[2])
    lit.close()
    assert seen[1][0] != seen[2][0]
    assert not np.array_equal(seen[1][1], seen[2][1])


def test_drawn_lights_change_the_picture_and_nothing_else(env, empty_scene):
    lit = PointNavEnv(config(randomize=EpisodeRandomizeConfig(lights="episode")), scenes=[empty_scene])
    ours, theirs = (play(e, (1.0, 1.5), 0.0, (3.0, 1.5), palette_seed=3)[0] for e in (lit, env))
    lit.close()
    assert not np.array_equal(ours["rgb"], theirs["rgb"])
    np.testing.assert_array_equal(ours["depth"], theirs["depth"])
    np.testing.assert_array_equal(ours["task"], theirs["task"])
    assert lit.palette == env.palette


def test_lights_that_the_renderer_does_not_have_are_refused():
    with pytest.raises(ConfigError, match=r"env\.randomize\.lights episode needs env\.render\.backend auto"):
        config(render=RenderConfig(backend="tiny"), randomize=EpisodeRandomizeConfig(lights="episode"))


def test_test_episodes_show_held_out_textures_only(empty_scene):
    env = PointNavEnv(SMALL, split="test", scenes=[empty_scene])
    env.reset(seed=1)
    assert all(m.id in HELD_OUT_TEXTURE_IDS[m.category] for m in env.palette)
    env.close()


def test_info_has_the_same_keys_always(env):
    _, first = play(env, (1.0, 1.5), 0.0, (3.0, 1.5))
    *_, second = env.step(AHEAD)
    assert first.keys() == second.keys()
    assert not {"objects", "instance"} & first.keys()


def test_labels_name_eligible_objects_where_they_are_seen(small_scene):
    env = PointNavEnv(
        config(with_labels=True, camera=CameraConfig(height=48, width=60)), scenes=[small_scene]
    )
    obs, info = play(env, (2.4, 2.3), math.pi, (3.4, 2.3))
    seen = {o.category: o for o in info["objects"]}
    assert "dining_table" in seen
    assert not {"wall", "floor", "ceiling"} & seen.keys()
    table, mask = seen["dining_table"], info["instance"] == 30
    rows, columns = np.nonzero(mask)
    assert table.bbox_xyxy == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    assert table.center_x == pytest.approx(columns.mean() + 0.5)
    assert table.distance_m == pytest.approx(obs["depth"][mask].mean(), rel=1e-4)
    env.close()


def test_it_is_registered_and_can_be_vectorised(small_scene):
    envs = gymnasium.make_vec(
        "LangWM/PointNav-v0",
        num_envs=2,
        vectorization_mode="sync",
        config=config(with_labels=True, max_steps=2),
        scenes=[small_scene],
    )
    obs, info = envs.reset(seed=[0, 1])
    assert obs["rgb"].shape == (2, 24, 30, 3)
    assert info["pose"].shape == (2, 3)
    for _ in range(3):
        _, reward, _, truncated, _ = envs.step(np.zeros((2, 2), np.float32))
    assert reward.shape == truncated.shape == (2,)
    envs.close()


def test_render_gives_the_current_view(small_scene):
    env = gymnasium.make("LangWM/PointNav-v0", config=SMALL, scenes=[small_scene], render_mode="rgb_array")
    obs, _ = env.reset(seed=0)
    np.testing.assert_array_equal(env.render(), obs["rgb"])
    env.close()


def test_close_frees_every_physics_client(small_scene):
    bullet = import_pybullet()

    def connected():
        return {c for c in range(100) if bullet.isConnected(c)}

    before = connected()
    render = RenderConfig(backend="tiny", texture_px=16)
    env = PointNavEnv(dataclasses.replace(SMALL, render=render), scenes=[small_scene])
    env.reset(seed=0)
    assert connected() > before
    env.close()
    assert connected() == before
    env.close()


def test_wrong_actions_are_refused(env):
    play(env, (1.0, 1.5), 0.0, (3.0, 1.5))
    for action in (np.zeros(3), np.array([np.nan, 0.0])):
        with pytest.raises(ValueError, match="give 2 finite numbers: v, omega"):
            env.step(action)


def test_wrong_episodes_are_refused(env):
    with pytest.raises(ValueError, match="plays in scene 'Elm_9'; this environment has Alder_0"):
        play(env, (1.0, 1.5), 0.0, (3.0, 1.5), scene="Elm_9")
    with pytest.raises(ValueError, match="no way leads from its start to its goal"):
        play(env, (30.0, 1.5), 0.0, (1.0, 1.5))
    with pytest.raises(ValueError, match=r"goal \(30.00, 1.50\) is not free"):
        play(env, (1.0, 1.5), 0.0, (30.0, 1.5))
    with pytest.raises(ValueError, match=r"cannot stand at \(0.10, 1.50\)"):
        play(env, (0.1, 1.5), 0.0, (1.0, 1.5))
    with pytest.raises(ValueError, match="reset option 'colour' is unknown; allowed: 'episode'"):
        env.reset(options={"colour": 1})


def test_after_a_refused_reset_the_episode_before_goes_on_or_has_ended(env):
    goal = (3.0, 1.5)
    play(env, (1.0, 1.5), 0.0, goal)
    distance = env.step(np.zeros(2))[4]["distance_to_goal"]
    for start, aim in (((30.0, 1.5), goal), ((1.0, 1.5), (30.0, 1.5))):
        with pytest.raises(ValueError, match=r"no way leads|is not free"):
            play(env, start, 0.0, aim)
        assert env.episode.goal_xy == goal
        assert env.step(np.zeros(2))[4]["distance_to_goal"] == distance
    with pytest.raises(ValueError, match="reset option 'colour'"):
        env.reset(seed=8, options={"colour": 1})
    assert env.step(np.zeros(2))[4]["distance_to_goal"] == distance
    with pytest.raises(ValueError, match="cannot stand at"):
        play(env, (0.1, 1.5), 0.0, goal)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2))


def test_wrong_arguments_are_refused(empty_scene):
    cases = {
        "distance_edges_m begins at 0.3 m; it must lie beyond success_radius_m, 0.36 m": {
            "config": config(distance_edges_m=(0.3, 2.0))
        },
        "split 'val' is unknown; allowed: train, test": {"split": "val"},
        "at least one, of different names": {"scenes": [empty_scene, empty_scene]},
        "render_mode 'human' is unknown": {"render_mode": "human"},
    }
    for message, arguments in cases.items():
        with pytest.raises(ValueError, match=message):
            PointNavEnv(**({"config": SMALL, "scenes": [empty_scene]} | arguments))


def test_blindness_changes_pixels_and_nothing_else(env, empty_scene):
    blind = PointNavEnv(config(is_blind=True), scenes=[empty_scene])
    tracks = []
    for world in (env, blind):
        obs, _ = play(world, (0.6, 1.5), 0.3, (3.4, 1.0))
        track = [obs["task"]]
        for action in (AHEAD, LEFT, AHEAD, BACK):
            obs, reward, *_ = world.step(action)
            track.append(np.append(obs["task"], reward))
        tracks.append(np.concatenate(track))
    blind.close()
    assert np.array_equal(*tracks)
    assert not obs["rgb"].any()
    assert not obs["depth"].any()
