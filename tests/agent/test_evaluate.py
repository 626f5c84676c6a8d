import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy import stats

from agent.config import EnvConfig
from agent.envs.episodes import Episode
from agent.evaluate import play, read_rows, summarise, write_rows
from agent.systems.controls import CONTROLS
from langwm_data.config_io import ConfigError


def make_episode(number):
    return Episode(
        scene="room",
        start_xy=(0.0, 0.0),
        start_yaw=0.0,
        goal_xy=(1.0, 0.0),
        palette_seed=number,
        geodesic_distance=1.0,
        tier=0,
    )


@pytest.fixture
def room(make_room):
    """The empty room, drawing the goal from the episode's palette seed."""

    class FixedRoom(make_room):
        def reset(self, *, seed=None, options=None):
            return super().reset(seed=options["episode"].palette_seed)

    return FixedRoom(max_steps=60)


def play_controls(room, count=6):
    episodes = [make_episode(i) for i in range(count)]
    return [
        row
        for name in CONTROLS
        for row in play(name, CONTROLS[name](EnvConfig()), room, episodes, split="test")
    ]


@pytest.fixture
def rows(room):
    return play_controls(room)


def test_every_system_plays_the_same_episodes(rows):
    assert len(rows) == 3 * 6
    distances = {}
    for row in rows:
        distances.setdefault(row["episode"], set()).add(row["geodesic_distance"])
    assert all(len(values) == 1 for values in distances.values())


def test_playing_again_gives_the_same_rows(rows, room):
    assert play_controls(room) == rows


def test_progress_counts_episodes(room):
    seen = []
    play(
        "random", CONTROLS["random"](EnvConfig()), room, [make_episode(0)] * 3, split="test", tick=seen.append
    )
    assert seen == [1, 2, 3]


def test_summary_agrees_with_the_rows(rows):
    score = next(s for s in summarise(rows).scores if s.system == "turn-to-goal" and s.tier is None)
    own = [row for row in rows if row["system"] == "turn-to-goal"]
    wins = sum(row["success"] for row in own)
    wilson = stats.binomtest(wins, len(own)).proportion_ci(method="wilson")
    assert score.num_episodes == 6
    assert (score.success.low, score.success.high) == pytest.approx((wilson.low, wilson.high))
    assert score.means["spl"].mean == pytest.approx(np.mean([row["spl"] for row in own]))
    assert score.means["spl"].low <= score.means["spl"].mean <= score.means["spl"].high


def test_tiers_are_scored_apart(rows):
    for row in rows[:3]:
        row["tier"] = 1
    tiers = {(s.system, s.tier): s.num_episodes for s in summarise(rows).scores}
    assert tiers["random", None] == 6
    assert tiers["random", 0] == 3
    assert tiers["random", 1] == 3


def test_files_hold_a_row_per_episode_and_the_scores(rows, tmp_path):
    write_rows(tmp_path, rows)
    table = pq.read_table(tmp_path / "episodes.parquet")
    expected = {"system", "split", "scene", "tier", "success", "spl", "soft_spl", "distance_to_goal"}
    expected |= {"length", "collisions", "path_length", "geodesic_distance", "return", "trajectory"}
    assert expected <= set(table.column_names)
    assert read_rows(tmp_path) == rows
    assert read_rows(tmp_path, ("spl", "nothing")) == [{"spl": row["spl"]} for row in rows]
    held = json.loads((tmp_path / "summary.json").read_text())
    best = next(s for s in held["scores"] if s["system"] == "turn-to-goal" and s["tier"] is None)
    assert set(best["success"]) == {"mean", "low", "high"}
    assert best["episodes"] == 6


def test_trajectories_begin_at_the_start_and_have_a_pose_per_step(rows):
    for row in rows:
        assert len(row["trajectory"]) == row["length"] + 1
        assert row["trajectory"].as_py()[0][:2] == [0, 0]


def test_table_names_every_system(rows):
    text = summarise(rows).as_text()
    assert [line.split()[0] for line in text.splitlines()] == ["system", *CONTROLS]
    assert "[" in text


def test_nothing_evaluated_yet_is_no_rows(tmp_path):
    assert read_rows(tmp_path) == []


def test_an_unknown_split_is_refused():
    from agent.evaluate import evaluate_agent

    with pytest.raises(ConfigError, match="--split 'attic' is unknown; allowed: train, test"):
        evaluate_agent(CONTROLS["random"](EnvConfig()), split="attic")


def test_a_folder_without_an_agent_is_refused(tmp_path):
    from agent.evaluate import evaluate_run

    with pytest.raises(ValueError, match="holds no trained agent"):
        evaluate_run(tmp_path)
