import errno
import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from full_disk import largest_file
from made_up_episodes import assert_same_batch, make_episode, make_replay, rng
from safetensors.numpy import load_file, save_file

from agent.config import ReplayConfig
from agent.replay import Replay, check_disk
from langwm_data.config_io import ConfigError


def test_files_are_ordinary_safetensors(tmp_path):
    make_replay(tmp_path, [7])
    held = load_file(next(tmp_path.iterdir()))
    episode = make_episode(0, 7)
    for name in ("rgb", "depth_mm", "task", "action", "reward"):
        np.testing.assert_array_equal(held[name], getattr(episode, name))
    assert held["object_distance_m"].tolist() == [o.distance_m for f in episode.objects for o in f]


def test_files_of_safetensors_can_be_read(tmp_path):
    replay = make_replay(tmp_path, [7])
    path, expected = next(tmp_path.iterdir()), replay.sample(rng(), 3, 5)
    about = {"schema_version": 3, "is_terminal": True, "names": [["chair", ""], ["table", ""]]}
    save_file(load_file(path), path, metadata={"replay": json.dumps(about)})
    resumed = Replay(ReplayConfig(), tmp_path, replay.state_dict())
    assert_same_batch(resumed.sample(rng(), 3, 5), expected)


def test_drawing_keeps_no_file_open(tmp_path):
    replay = make_replay(tmp_path, [7] * 5)
    before = len(os.listdir("/proc/self/fd"))
    replay.sample(rng(), 20, 5)
    replay.transitions(rng(), 20, 3)
    assert len(os.listdir("/proc/self/fd")) == before


def test_a_full_disk_leaves_the_buffer_as_it_was(tmp_path, monkeypatch):
    replay = make_replay(tmp_path, [6, 6])
    held, expected = replay.state_dict(), replay.sample(rng(3), 4, 4)

    def refuse(fd):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", refuse)
        with pytest.raises(OSError, match=r"No space left on device.*episode-00000002.safetensors"):
            replay.add(make_episode(2, 6))
    assert replay.state_dict() == held
    assert len(list(tmp_path.iterdir())) == 2
    assert_same_batch(replay.sample(rng(3), 4, 4), expected)
    replay.add(make_episode(2, 6))
    assert replay.num_episodes == 3


def test_what_the_system_refuses_to_write_leaves_the_buffer_as_it_was(tmp_path):
    replay = make_replay(tmp_path, [6])
    with largest_file(3000), pytest.raises(OSError, match=r"File too large.*episode-00000001.safetensors"):
        replay.add(make_episode(1, 90))
    assert (replay.num_episodes, len(list(tmp_path.iterdir()))) == (1, 1)


def damage_shape(path):
    length = int.from_bytes(path.read_bytes()[:8], "little")
    header = json.loads(path.read_bytes()[8 : 8 + length])
    header["rgb"]["shape"][0] = 10**9
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + path.read_bytes()[8 + length :])


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda p: p.write_bytes(b"\xff" * 64), "does not begin with a header"),
        (lambda p: p.write_bytes(p.read_bytes()[:-100]), "does not fit"),
        (damage_shape, "column rgb does not fit"),
        (
            lambda p: p.write_bytes(p.read_bytes().replace(b'version\\": 3', b'version\\": 2')),
            "version 2; known: 3",
        ),
        (lambda p: p.write_bytes((10).to_bytes(8, "little") + b"[" * 10 + p.read_bytes()), "Expecting value"),
    ],
)
def test_what_is_wrong_with_a_damaged_episode(tmp_path, damage, why):
    replay = make_replay(tmp_path, [6])
    damage(tmp_path / "episode-00000000.safetensors")
    with pytest.raises(ValueError, match=f"missing or damaged .*{why}"):
        Replay(ReplayConfig(), tmp_path, replay.state_dict())


def test_an_episode_that_shrinks_while_it_is_used_is_named(tmp_path):
    replay = make_replay(tmp_path, [6])
    path = tmp_path / "episode-00000000.safetensors"
    path.write_bytes(path.read_bytes()[:1200])
    with pytest.raises(ValueError, match=r"episode-00000000.safetensors .*it ends too early"):
        replay.sample(rng(), 1, 6)


def test_a_buffer_that_will_not_fit_is_refused(tmp_path):
    check_disk(tmp_path / "run" / "replay", steps=10, bytes_a_step=100)
    with pytest.raises(
        ConfigError, match=r"replay.capacity_steps: 300000 steps of 999999999 bytes take 300000.0 GB"
    ):
        check_disk(tmp_path / "run" / "replay", steps=300_000, bytes_a_step=999_999_999)
    assert not (tmp_path / "run").exists()


def test_what_a_resumed_buffer_holds_is_room(tmp_path, monkeypatch):
    make_replay(tmp_path, [50])
    held = sum(p.stat().st_size for p in Path(tmp_path).iterdir())
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=10))
    check_disk(tmp_path, steps=1, bytes_a_step=held + 10)
    with pytest.raises(ConfigError, match="has room for"):
        check_disk(tmp_path, steps=1, bytes_a_step=held + 11)
