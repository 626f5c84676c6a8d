from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.config import DatasetConfig, ShardsConfig, SplitsConfig, ViewsConfig
from langwm_data.config_io import ConfigError
from langwm_data.plan import (
    SPLITS,
    num_frames,
    parse_shards,
    plan_frame,
    plan_shards,
    scenes_needed,
    scenes_of,
    tasks_in_range,
)
from langwm_data.scenes.homes import scene_names


def make_config(frames=300, fraction=0.1, per_palette=7, per_shard=50, seed=0):
    return DatasetConfig(
        frames=frames,
        seed=seed,
        splits=SplitsConfig(test_fraction=fraction),
        cameras=ViewsConfig(frames_per_palette=per_palette),
        shards=ShardsConfig(samples_per_shard=per_shard),
    )


def all_frames(config):
    return [plan_frame(config, t.split, n) for t in plan_shards(config) for n in range(t.start, t.stop)]


@settings(max_examples=40)
@given(
    config=st.builds(
        make_config,
        st.integers(1, 400),
        st.floats(0, 1),
        st.integers(1, 60),
        st.integers(1, 120),
        st.integers(0, 9),
    )
)
def test_every_frame_is_planned_once_and_shards_are_full_but_the_last(config):
    frames = all_frames(config)
    assert len(frames) == len({f.key for f in frames}) == config.frames
    for split in SPLITS:
        sizes = [t.stop - t.start for t in plan_shards(config) if t.split == split]
        assert sum(sizes) == num_frames(config, split)
        assert all(size == config.shards.samples_per_shard for size in sizes[:-1])
    assert {f.scene for f in frames} == set(scenes_needed(config))


def test_a_tenth_of_the_frames_is_for_testing():
    counts = Counter(f.split for f in all_frames(make_config(frames=300)))
    assert counts == {"train": 270, "test": 30}


def test_frames_show_floors_of_their_own_split():
    for frame in all_frames(make_config()):
        assert frame.scene in scene_names(frame.split)


def test_a_block_shares_its_floor_and_every_floor_gets_its_turn():
    config = make_config(frames=2 * 12 * 7, fraction=0.0)
    scenes = [f.scene for f in all_frames(config)]
    blocks = [scenes[i : i + 7] for i in range(0, len(scenes), 7)]
    assert all(len(set(block)) == 1 for block in blocks)
    order = [block[0] for block in blocks]
    assert sorted(order[:12]) == sorted(order[12:]) == sorted(scene_names("train"))
    assert order[:12] != order[12:]
    assert order != [f.scene for f in all_frames(make_config(frames=2 * 12 * 7, fraction=0.0, seed=1))][::7]


def test_a_shard_needs_the_floors_of_its_frames():
    config = make_config(frames=100, fraction=0.3, per_palette=7, per_shard=10)
    for task in plan_shards(config):
        shown = {plan_frame(config, task.split, number).scene for number in range(task.start, task.stop)}
        assert scenes_of(config, [task]) == sorted(shown)


def test_ranges_name_shards_over_all_splits():
    config = make_config(frames=300, fraction=0.1, per_shard=50)
    assert parse_shards("0-99") == range(100)
    assert parse_shards("7") == range(7, 8)
    assert tasks_in_range(config, range(100)) == plan_shards(config)
    assert [(t.split, t.number) for t in tasks_in_range(config, parse_shards("5-6"))] == [
        ("train", 5),
        ("test", 0),
    ]


@pytest.mark.parametrize("text", ["", "a", "3-1", "-1", "1-", "1-2-3", "1,2"])
def test_ranges_of_another_form_are_refused(text):
    with pytest.raises(ConfigError, match=f"--shards '{text}' is not of the form 0-99 or 7"):
        parse_shards(text)


def test_a_range_past_the_last_shard_is_refused():
    with pytest.raises(ConfigError, match="--shards 7-9 names no shard; the dataset has 0 to 6"):
        tasks_in_range(make_config(frames=300, fraction=0.1, per_shard=50), range(7, 10))
