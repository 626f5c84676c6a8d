"""Any engine, any number of workers, any ranges in any order: the same bytes."""

import hashlib
import importlib.util
import os
import signal
import sys
from pathlib import Path

import pytest

from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError, build_config, config_to_yaml
from langwm_data.engines import RayPool, check_engine
from langwm_data.pipeline import FINGERPRINT_FILE, render_range
from langwm_data.shards.manifest import MANIFEST_FILE

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 4,
        "camera": {"height": 24, "width": 30},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.0},
        "shards": {"samples_per_shard": 1},
    },
)
"""Four shards of one frame, one floor."""
HAS_RAY = importlib.util.find_spec("ray") is not None
needs_ray = pytest.mark.skipif(not HAS_RAY, reason="ray is not installed")


def contents(folder):
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    return contents(render_dataset(CONFIG, tmp_path_factory.mktemp("one") / "dataset"))


def test_ranges_in_any_order_give_the_same_bytes(expected, tmp_path):
    out, complete = tmp_path / "ranges", []
    for shards in (range(3, 4), range(0, 1), range(1, 99)):
        calls = []
        complete.append(render_range(CONFIG, out, shards, progress=lambda *a, calls=calls: calls.append(a)))
        frames = len(range(4)[shards.start : shards.stop])
        assert calls == [(n, frames) for n in range(calls[0][0], frames + 1)]
    assert complete == [False, False, True]
    assert contents(out) == expected


def test_a_call_without_a_range_completes_what_ranges_began(expected, tmp_path):
    render_range(CONFIG, tmp_path / "out", range(1, 3))
    calls = []
    render_dataset(CONFIG, tmp_path / "out", progress=lambda *a: calls.append(a))
    assert calls[0] == (2, 4)
    assert contents(tmp_path / "out") == expected


def test_a_range_of_a_finished_dataset_has_nothing_to_do(expected, tmp_path):
    out = render_dataset(CONFIG, tmp_path / "out")
    (out / FINGERPRINT_FILE).parent.mkdir()  # as when a job is killed just after the manifest
    assert render_range(CONFIG, out, range(1))
    assert contents(out) == expected
    assert not (out / FINGERPRINT_FILE).parent.exists()


def test_a_range_discards_nothing_that_another_program_made(tmp_path):
    out = tmp_path / "out"
    render_range(CONFIG, out, range(1))
    (out / FINGERPRINT_FILE).write_text("another version")
    before = contents(out)
    with pytest.raises(ConfigError, match="holds work of another version or renderer, which --shards does"):
        render_range(CONFIG, out, range(1, 2))
    (out / FINGERPRINT_FILE).unlink()
    with pytest.raises(ConfigError, match="use another folder, or start over with --fresh and without"):
        render_range(CONFIG, out, range(1, 2))
    del before[str(FINGERPRINT_FILE)]
    assert contents(out) == before


def test_the_slower_of_two_ranges_that_made_the_same_shards_finds_all_done(expected, tmp_path, monkeypatch):
    out = tmp_path / "out"

    def overtaken(config, output):
        monkeypatch.undo()
        render_dataset(config, output.folder)
        raise FileNotFoundError("rows of a shard")

    monkeypatch.setattr("langwm_data.pipeline._finish_if_last", overtaken)
    assert render_range(CONFIG, out, range(4))
    assert contents(out) == expected


def test_ranges_that_begin_at_once_do_not_take_each_other_for_strangers(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / ".config.yaml.12ab.tmp").write_text(config_to_yaml(CONFIG)[:99])
    assert not render_range(CONFIG, out, range(1))


def test_a_folder_of_somebody_else_is_refused_at_once(tmp_path):
    (tmp_path / "photo.jpg").touch()
    with pytest.raises(ConfigError, match=r"is not empty and holds no config\.yaml; give a new folder"):
        render_range(CONFIG, tmp_path, range(1))


@pytest.mark.parametrize(
    ("engine", "workers", "message"),
    [
        ("spark", None, "--engine 'spark' is unknown; allowed: local, ray"),
        ("local", 0, "--workers 0 is not allowed; allowed: 1 or more"),
        ("ray", 2, "--workers 2 is for --engine local; ray uses every core of its cluster"),
    ],
)
def test_wrong_engines_are_refused(engine, workers, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        render_dataset(CONFIG, tmp_path / "out", engine=engine, workers=workers)
    assert not (tmp_path / "out").exists()


def test_ray_that_is_missing_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match=r"--engine ray needs the package ray: pip install 'langwm\[ray\]'"):
        check_engine("ray", None)


@pytest.fixture(scope="module")
def cluster():
    """Ray on two of this machine's cores; processes find this project."""
    ray = pytest.importorskip("ray")
    root = str(Path(__file__).parents[2])
    try:
        ray.init(num_cpus=2, logging_level="ERROR", runtime_env={"env_vars": {"PYTHONPATH": root}})
    except Exception as error:
        if "timed out during startup" not in str(error):
            raise
        pytest.skip("this machine is too busy to start Ray within its 30 s")
    yield
    ray.shutdown()


@needs_ray
def test_ray_gives_the_same_bytes(cluster, expected, tmp_path):
    calls = []
    render_dataset(CONFIG, tmp_path / "ray", engine="ray", progress=lambda *a: calls.append(a))
    assert calls == [(n, 4) for n in range(5)]
    assert contents(tmp_path / "ray") == expected


@needs_ray
def test_a_cluster_that_cannot_be_joined_is_one_sentence(monkeypatch):
    def refuse(**_):
        raise RuntimeError("no node at 10.0.0.1")

    monkeypatch.setattr("ray.is_initialized", lambda: False)
    monkeypatch.setattr("ray.init", refuse)
    with (
        pytest.raises(ConnectionError, match=r"cannot be joined: no node at 10\.0\.0\.1"),
        RayPool(int, tasks_per_worker=1),
    ):
        pass


def make_fragile(folder):
    """A worker that is killed the first time, and fails at the task "wrong"."""

    class Fragile:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def __call__(self, task, report):
            if task == "wrong":
                raise ConfigError("a wrong request")
            mark = folder / "died"
            if task == "die always" or not mark.exists():
                mark.touch()
                os.kill(os.getpid(), signal.SIGKILL)
            report(task)

    return Fragile()


class Fragile:
    """Picklable by value: Ray's processes do not import tests."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self):
        return make_fragile(self.folder)


@needs_ray
def test_a_task_whose_process_is_lost_is_done_again(cluster, tmp_path):
    reported = []
    with RayPool(Fragile(tmp_path), tasks_per_worker=2) as pool:
        pool.run([3, 4, 5], reported.append)
    assert sorted(reported) == [3, 4, 5]
    assert (tmp_path / "died").exists()


@needs_ray
def test_what_a_ray_task_raises_arrives_as_it_was_raised(cluster, tmp_path):
    (tmp_path / "died").touch()
    with (
        pytest.raises(ConfigError, match="a wrong request"),
        RayPool(Fragile(tmp_path), tasks_per_worker=9) as pool,
    ):
        pool.run([1, "wrong"], int)


@needs_ray
def test_a_task_that_is_lost_every_time_is_reported(cluster, tmp_path):
    message = "the Ray cluster lost die always 4 times .WorkerCrashedError.; what was finished is kept"
    with (
        pytest.raises(ChildProcessError, match=message),
        RayPool(Fragile(tmp_path), tasks_per_worker=9) as pool,
    ):
        pool.run(["die always"], int)


@needs_ray
def test_where_somebody_hears_of_lost_tasks_ray_does_the_others(cluster, tmp_path):
    (tmp_path / "died").touch()
    reported, lost = [], []
    with RayPool(Fragile(tmp_path), tasks_per_worker=1) as pool:
        pool.run(["die always", 2], reported.append, lambda *a: lost.append(a))
    assert reported == [2]
    assert [task for task, _ in lost] == ["die always"]
    assert "the Ray cluster lost die always 4 times" in lost[0][1]


def test_a_dataset_of_ranges_has_no_manifest_before_the_last_one(tmp_path):
    render_range(CONFIG, tmp_path / "out", range(3))
    assert not (tmp_path / "out" / MANIFEST_FILE).exists()
