"""Made-up episodes for the replay buffer."""

import numpy as np
import torch

from agent.config import ReplayConfig
from agent.replay import Replay, ReplayEpisode
from pretrain.frames import FrameObject

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


def bare(episode, **changes):
    """The same episode as a system stores it that needs neither depth nor objects."""
    return ReplayEpisode(**(vars(episode) | {"depth_mm": None, "objects": None} | changes))


def add_bare(replay, lengths, **changes):
    for number, length in enumerate(lengths):
        replay.add(bare(make_episode(number, length), **changes))
    return replay
