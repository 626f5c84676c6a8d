"""Files are there whole or not at all; seeds depend on names."""

import errno

import numpy as np
import pytest

from langwm_data import atomic
from langwm_data.seeding import derive_seed, make_rng


def test_a_failed_write_keeps_the_old_file_and_leaves_nothing_behind(tmp_path):
    path = tmp_path / "a" / "file.txt"
    atomic.write_text(path, "old")

    def fail() -> None:
        with atomic.atomic_path(path) as temporary:
            temporary.write_text("half")
            raise OSError(errno.ENOSPC, "no space")

    with pytest.raises(OSError, match="no space"):
        fail()
    assert path.read_text() == "old"
    assert [p.name for p in path.parent.iterdir()] == ["file.txt"]


def test_a_file_is_created_once(tmp_path):
    assert atomic.create_text(tmp_path / "a/x", "first")
    assert not atomic.create_text(tmp_path / "a/x", "second")
    assert (tmp_path / "a/x").read_text() == "first"
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["x"]


def test_a_file_is_created_where_there_are_no_hard_links(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EPERM, "no hard links here")

    monkeypatch.setattr("os.link", refuse)
    assert atomic.create_text(tmp_path / "x", "text")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("x", "text")]


def test_json_refuses_nan_before_touching_the_file(tmp_path):
    with pytest.raises(ValueError, match="Out of range"):
        atomic.write_json(tmp_path / "x.json", {"a": float("nan")})
    assert not list(tmp_path.iterdir())


def test_generators_depend_on_seed_and_names_only():
    assert make_rng(1, "frames", 2).integers(1 << 30) == make_rng(1, "frames", 2).integers(1 << 30)
    seeds = {derive_seed(s, *n) for s in (0, 1) for n in [("a", 1), ("a", "1"), ("a1",), (), ("a", 1, 0)]}
    assert len(seeds) == 10
    draws = np.array([make_rng(0, "i", i).random() for i in range(2000)])
    assert abs(draws.mean() - 0.5) < 0.03
