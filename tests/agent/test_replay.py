import itertools

import numpy as np
import pytest
import torch

from agent.config import ReplayConfig
from agent.replay import Replay, ReplayEpisode
from pretrain.batch import FrameObject

SIZE = (4, 6)


def make_episode(number, length, *, is_terminal=True):
    """Every value says which episode and which step it is from."""
    steps = np.arange(length)
    code = 100 * number + steps
    objects = [
        [
            FrameObject(
                category=("chair", "table")[i % 2],
                bbox_xyxy=(float(i), 1.0, i + 2.0, 3.5),
                center_x=i + 0.3,
                distance_m=t + 0.1,
            )
            for i in range(t % 3)
        ]
        for t in steps.tolist()
    ]
    return ReplayEpisode(
        rgb=np.broadcast_to(steps.astype(np.uint8)[:, None, None, None], (length, *SIZE, 3)).copy(),
        depth_mm=np.broadcast_to(code.astype(np.uint16)[:, None, None], (length, *SIZE)).copy(),
        task=np.tile(code[:, None], (1, 4)).astype(np.float32),
        action=np.tile(code[:, None] / 7, (1, 2)).astype(np.float32),
        reward=code.astype(np.float32),
        objects=objects,
        is_terminal=is_terminal,
    )


def make_replay(folder, lengths, **config):
    replay = Replay(ReplayConfig(**config), folder)
    for number, length in enumerate(lengths):
        replay.add(make_episode(number, length))
    return replay


def rng(seed=0):
    return np.random.default_rng(seed)


def assert_same_batch(a, b):
    for name in ("rgb", "depth", "task", "action", "reward", "is_first", "is_last", "is_terminal"):
        assert torch.equal(getattr(a, name), getattr(b, name)), name
    assert a.objects == b.objects


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
