import itertools

import numpy as np
import pytest
import torch
from made_up_episodes import SIZE, add_bare, assert_same_batch, bare, make_episode, make_replay, rng

from agent.config import ReplayConfig
from agent.replay import Replay, ReplayEpisode
from agent.replay.files import OBJECT_BYTES, step_bytes
from pretrain.frames import FrameObject


def test_what_goes_in_comes_out(tmp_path):
    replay = make_replay(tmp_path, [12])
    batch = replay.sample(rng(), 3, 12)
    episode = make_episode(0, 12)
    assert batch.rgb.dtype == torch.uint8
    for row in range(3):
        np.testing.assert_array_equal(batch.rgb[row].numpy(), episode.rgb)
        np.testing.assert_array_equal(batch.action[row].numpy(), episode.action)
        np.testing.assert_array_equal(batch.task[row].numpy(), episode.task)
        assert batch.objects[row] == episode.objects
    assert batch.depth[0, 5, 0, 0].item() == pytest.approx(0.005)


def test_steps_of_a_chunk_belong_together(tmp_path):
    replay = make_replay(tmp_path, [40, 30])
    batch = replay.sample(rng(), 20, 8)
    for row in range(20):
        code = batch.reward[row].numpy().astype(int)
        np.testing.assert_array_equal(np.diff(code), 1)
        np.testing.assert_allclose(batch.depth[row, :, 0, 0], code / 1000, rtol=1e-6)
        assert [len(o) for o in batch.objects[row]] == [c % 100 % 3 for c in code]
        assert all(
            o.distance_m == c % 100 + 0.1 for c, f in zip(code, batch.objects[row], strict=True) for o in f
        )


def test_only_true_starts_and_row_starts_are_first(tmp_path):
    batch = make_replay(tmp_path, [30]).sample(rng(), 50, 10)
    assert batch.is_first[:, 0].all()
    assert not batch.is_first[:, 1:].any()


def test_short_episodes_are_kept_and_joined(tmp_path):
    batch = make_replay(tmp_path, [3, 4]).sample(rng(), 30, 9)
    assert batch.reward.shape == (30, 9)
    for row in range(30):
        step = batch.reward[row].numpy().astype(int) % 100
        np.testing.assert_array_equal(batch.is_first[row].numpy(), step == 0)
        ends = np.flatnonzero(batch.is_last[row].numpy())
        assert all(t + 1 == 9 or batch.is_first[row, t + 1] for t in ends)


def test_an_episode_of_one_step_can_be_drawn(tmp_path):
    batch = make_replay(tmp_path, [1]).sample(rng(), 2, 3)
    assert batch.is_first.all()
    assert batch.is_last.all()


def test_a_timeout_is_last_and_not_terminal(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    replay.add(make_episode(0, 5, is_terminal=False))
    batch = replay.sample(rng(), 4, 5)
    assert batch.is_last[:, -1].all()
    assert not batch.is_last[:, :-1].any()
    assert not batch.is_terminal.any()


def test_a_success_is_terminal_at_its_end_alone(tmp_path):
    batch = make_replay(tmp_path, [5]).sample(rng(), 1, 5)
    assert batch.is_terminal[0].tolist() == [False] * 4 + [True]


def test_episodes_are_drawn_uniformly_whatever_their_length(tmp_path):
    batch = make_replay(tmp_path, [5, 50], prioritize_ends=False).sample(rng(), 1000, 5)
    share = (batch.reward[:, 0] < 100).float().mean().item()
    assert share == pytest.approx(0.5, abs=0.05)


def test_starts_are_uniform_without_priority(tmp_path):
    batch = make_replay(tmp_path, [14], prioritize_ends=False).sample(rng(), 2000, 5)
    counts = np.bincount(batch.reward[:, 0].numpy().astype(int), minlength=10)
    assert len(counts) == 10
    assert counts.min() > 140
    assert counts.max() < 260


def test_priority_draws_the_end_as_often_as_the_chunk_is_long(tmp_path):
    batch = make_replay(tmp_path, [14], prioritize_ends=True).sample(rng(), 3000, 5)
    share = (batch.reward[:, 0] == 9).float().mean().item()
    assert share == pytest.approx(6 / 15, abs=0.03)


def test_same_seed_same_batch(tmp_path):
    replay = make_replay(tmp_path, [9, 3, 20])
    assert_same_batch(replay.sample(rng(1), 4, 6), replay.sample(rng(1), 4, 6))


def test_the_oldest_leave_when_full(tmp_path):
    replay = make_replay(tmp_path, [6, 6, 6], capacity_steps=13)
    assert (replay.num_episodes, replay.num_steps) == (2, 12)
    assert replay.sample(rng(), 50, 6).reward.min() == 100


def test_an_episode_longer_than_the_capacity_stays_alone(tmp_path):
    replay = make_replay(tmp_path, [6, 20], capacity_steps=10)
    assert (replay.num_episodes, replay.num_steps) == (1, 20)


def test_evicted_files_stay_until_the_checkpoint_is_complete(tmp_path):
    replay = Replay(ReplayConfig(capacity_steps=12), tmp_path)
    for number in range(2):
        replay.add(make_episode(number, 6))
    checkpoint = replay.state_dict()
    expected = replay.sample(rng(2), 5, 4)
    replay.add(make_episode(2, 6))
    resumed = Replay(ReplayConfig(capacity_steps=12), tmp_path, checkpoint)
    assert_same_batch(resumed.sample(rng(2), 5, 4), expected)
    resumed.add(make_episode(2, 6))
    resumed.delete_evicted()
    assert len(list(tmp_path.iterdir())) == 2


def test_resuming_drops_what_came_after_the_checkpoint(tmp_path):
    replay = make_replay(tmp_path, [6, 6])
    checkpoint = replay.state_dict()
    replay.add(make_episode(2, 6))
    (tmp_path / ".episode-00000003.safetensors.ab12.tmp").write_bytes(b"half")
    resumed = Replay(ReplayConfig(), tmp_path, checkpoint)
    assert resumed.num_episodes == 2
    assert resumed.state_dict() == checkpoint
    assert len(list(tmp_path.iterdir())) == 2


def test_without_a_state_the_buffer_starts_empty(tmp_path):
    make_replay(tmp_path, [6])
    assert Replay(ReplayConfig(), tmp_path).num_episodes == 0
    assert not list(tmp_path.iterdir())


def test_objects_keep_every_digit(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    seen = FrameObject(category="sofa", bbox_xyxy=(1 / 3, 0.0, 2.0, 0.7), center_x=0.1 + 0.2, distance_m=1e-9)
    replay.add(ReplayEpisode(**(vars(make_episode(0, 2)) | {"objects": [[seen], []]})))
    assert replay.sample(rng(), 1, 2).objects == [[[seen], []]]


def test_no_objects_at_all_is_fine(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    values = vars(make_episode(0, 4)) | {"objects": [()] * 4}
    replay.add(ReplayEpisode(**values))
    batch = replay.sample(rng(), 2, 3)
    assert not list(itertools.chain.from_iterable(itertools.chain.from_iterable(batch.objects)))


def test_frames_for_the_autoencoder_come_row_by_row(tmp_path):
    batch = make_replay(tmp_path, [9]).sample(rng(), 2, 4)
    frames = batch.frames()
    assert len(frames) == 8
    np.testing.assert_array_equal(frames.rgb[5], batch.rgb[1, 1])
    np.testing.assert_array_equal(frames.depth[5], batch.depth[1, 1])
    assert frames.objects[5] == batch.objects[1][1]
    assert frames.reward[5] == batch.reward[1, 1]
    assert frames.has_reward.all()


def test_moving_a_batch_keeps_its_objects(tmp_path):
    batch = make_replay(tmp_path, [5]).sample(rng(), 1, 5)
    moved = batch.to("cpu")
    assert_same_batch(batch, moved)


def test_an_empty_buffer_says_so(tmp_path):
    with pytest.raises(ValueError, match="replay buffer is empty; collect at least one whole episode"):
        Replay(ReplayConfig(), tmp_path).sample(rng(), 1, 5)


@pytest.mark.parametrize("damage", [lambda p: p.unlink(), lambda p: p.write_bytes(b"not safetensors")])
def test_a_lost_or_damaged_episode_is_named(tmp_path, damage):
    replay = make_replay(tmp_path, [6, 6])
    damage(tmp_path / "episode-00000001.safetensors")
    with pytest.raises(ValueError, match=r"episode-00000001.safetensors .* missing or damaged .* --fresh"):
        Replay(ReplayConfig(), tmp_path, replay.state_dict())


def coverage(replay, length, draws=4000):
    """How often each step of a buffer's only episode is part of a chunk."""
    code = replay.sample(rng(5), draws, length).reward.numpy().astype(int)
    return np.bincount(code.ravel(), minlength=code.max() + 1) / draws


def test_what_is_not_stored_is_not_there(tmp_path):
    replay = add_bare(Replay(ReplayConfig(), tmp_path), [9, 3])
    batch = replay.sample(rng(), 4, 5)
    assert batch.depth is None
    assert batch.objects is None
    assert batch.to("cpu").depth is None
    assert batch.rgb.shape == (4, 5, *SIZE, 3)


def test_what_is_not_stored_costs_no_disk(tmp_path):
    episode = make_episode(0, 100)
    for name, stored in (("all", episode), ("bare", bare(episode))):
        Replay(ReplayConfig(), tmp_path / name).add(stored)
    sizes = {p.name: next(p.iterdir()).stat().st_size for p in tmp_path.iterdir()}
    num_objects = sum(map(len, episode.objects))
    saved = 100 * SIZE[0] * SIZE[1] * 2 + OBJECT_BYTES * num_objects + 8 * 101
    assert sizes["all"] - sizes["bare"] == pytest.approx(saved, abs=1000)
    stated = 100 * step_bytes(*SIZE, numbers=6, with_depth=False, with_objects=False)
    assert sizes["bare"] == pytest.approx(stated, abs=1000)


def test_the_stated_sizes_of_the_paper():
    assert step_bytes(128, 160, 6, with_depth=False, with_objects=False) == 61_468
    assert step_bytes(128, 160, 6, with_depth=True, with_objects=True) == 103_108
    assert step_bytes(128, 160, 6, with_depth=False, with_objects=False, features=512) == 62_492


def test_features_come_back_with_their_steps(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    for number, length in enumerate([12, 3]):
        code = 100 * number + np.arange(length)
        features = {
            "tokens": np.tile(code[:, None, None], (1, 2, 5)).astype(np.float16),
            "score": (code / 8).astype(np.float16),
        }
        replay.add(bare(make_episode(number, length), features=features))
    batch = Replay(ReplayConfig(), tmp_path, replay.state_dict()).sample(rng(), 10, 7)
    assert batch.features["tokens"].shape == (10, 7, 2, 5)
    assert batch.features["tokens"].dtype == torch.float16
    assert torch.equal(batch.features["tokens"][..., 1, 3].float(), batch.reward)
    assert torch.equal(batch.to("cpu").features["score"].float() * 8, batch.reward)


def test_an_episode_with_other_columns_is_our_mistake(tmp_path):
    replay = make_replay(tmp_path, [5])
    with pytest.raises(AssertionError, match="all episodes have the same columns"):
        replay.add(bare(make_episode(1, 5)))


def test_every_step_is_covered_as_the_starts_say(tmp_path):
    total, length = 20, 6
    replay = add_bare(Replay(ReplayConfig(prioritize_ends=False), tmp_path), [total])
    starts = np.arange(total - length + 1)
    expected = [np.mean((starts <= t) & (t < starts + length)) for t in range(total)]
    np.testing.assert_allclose(coverage(replay, length), expected, atol=0.035)


def test_endings_are_drawn_at_least_as_often_as_what_lies_in_the_middle(tmp_path):
    total, length = 20, 6
    replay = add_bare(Replay(ReplayConfig(prioritize_ends=True), tmp_path), [total])
    starts = np.minimum(np.arange(total + 1), total - length)
    expected = np.array([np.mean((starts <= t) & (t < starts + length)) for t in range(total)])
    found = coverage(replay, length)
    np.testing.assert_allclose(found, expected, atol=0.035)
    middle = found[length : total - length]
    assert found[-1] > 0.9 * middle.max()
    assert found[-1] < 1.4 * middle.max()


def test_successes_do_not_drown_among_timeouts(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    for number in range(20):
        is_success = number % 5 == 0
        replay.add(make_episode(number, 8 if is_success else 60, is_terminal=is_success))
    batch = replay.sample(rng(), 2000, 10)
    ends_with_success = batch.is_terminal.any(1).float().mean().item()
    assert ends_with_success == pytest.approx(0.2, abs=0.03)
    assert not (batch.is_terminal & ~batch.is_last).any()


def test_a_transition_is_one_step_with_the_frames_before_it(tmp_path):
    replay = add_bare(Replay(ReplayConfig(), tmp_path), [12, 2, 30])
    batch = replay.transitions(rng(), 300, 3)
    assert batch.rgb.shape == (300, 4, *SIZE, 3)
    assert batch.rgb.dtype == torch.uint8
    arrived = batch.reward.long()
    assert torch.equal(batch.task[:, 1, 0].long(), arrived)
    assert torch.equal(batch.task[:, 0, 0].long(), arrived - 1)
    assert torch.allclose(batch.action[:, 0] * 7, batch.reward)
    back = torch.tensor([3, 2, 1, 0])
    expected = (arrived[:, None] % 100 - back).clamp(min=0)
    assert torch.equal(batch.rgb[..., 0, 0, 0].long(), expected)
    assert torch.equal(batch.rgb[..., -1, -1, -1].long(), expected)


def test_a_transition_stacks_no_frames_of_another_episode(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    for number in range(3):
        frames = np.full((4, *SIZE, 3), number, np.uint8)
        replay.add(bare(make_episode(number, 4), rgb=frames))
    batch = replay.transitions(rng(), 100, 5)
    assert torch.equal(batch.rgb[..., 0, 0, 0].long(), (batch.reward.long() // 100)[:, None].expand(-1, 6))


def test_transitions_are_drawn_uniformly(tmp_path):
    replay = add_bare(Replay(ReplayConfig(), tmp_path), [2, 11, 1, 5])
    code = replay.transitions(rng(), 15_000, 1).reward.numpy().astype(int)
    found, counts = np.unique(code, return_counts=True)
    assert found.tolist() == [1, *range(101, 111), *range(301, 305)]
    assert counts.min() > 850
    assert counts.max() < 1150


def test_a_transition_is_terminal_where_the_goal_was_reached_and_not_where_time_ran_out(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    replay.add(bare(make_episode(0, 6), is_terminal=True))
    replay.add(bare(make_episode(1, 6), is_terminal=False))
    batch = replay.transitions(rng(), 200, 2)
    assert torch.equal(batch.is_terminal, batch.reward == 5)
    assert (batch.reward == 105).any()


def test_transitions_follow_what_enters_and_leaves(tmp_path):
    replay = add_bare(Replay(ReplayConfig(capacity_steps=12), tmp_path), [6, 6])
    replay.transitions(rng(), 1, 1)
    replay.add(bare(make_episode(2, 6)))
    codes = replay.transitions(rng(), 500, 1).reward.unique().tolist()
    assert codes == [*range(101, 106), *range(201, 206)]


def test_same_seed_same_transitions_also_after_a_restart(tmp_path):
    replay = add_bare(Replay(ReplayConfig(), tmp_path), [9, 3, 20])
    resumed = Replay(ReplayConfig(), tmp_path, replay.state_dict())
    first, again = (r.transitions(rng(1), 20, 3) for r in (replay, resumed))
    for name, tensor in vars(first).items():
        assert torch.equal(tensor, getattr(again, name)), name


def test_no_transition_in_an_empty_buffer_or_one_of_resets(tmp_path):
    replay = Replay(ReplayConfig(), tmp_path)
    for _ in range(2):
        with pytest.raises(ValueError, match="replay buffer is empty"):
            replay.transitions(rng(), 1, 3)
        add_bare(replay, [1])
