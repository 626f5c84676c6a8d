"""A grid of the debug preset on three floors, from nothing to its page; what happens where cells fail."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml
from grid_folders import begin_grid, write_cell

from agent.benchmark import cells as cells_module
from agent.benchmark import run as run_module
from agent.benchmark.cells import episodes_on, one_sentence, run_cell, units_of
from agent.benchmark.grid import Cell, Request, base_config, cells_of, make_grid
from agent.benchmark.plan import plan_benchmark
from agent.benchmark.record import Record, Stopwatch, describe_machine, read_record, write_record
from agent.benchmark.run import check_grid, run_benchmark
from agent.scoring.rows import read_rows
from langwm_data.config_io import ConfigError
from langwm_data.scenes import homes
from langwm_data.scenes.splits import BUILDINGS
from pretrain.precision import has_bf16

FRAMES = [
    "env.camera.height=64",
    "env.camera.width=80",
    "finetune.model.height=64",
    "finetune.model.width=80",
]


@pytest.fixture(scope="module", autouse=True)
def three_floors():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(homes, "BUILDINGS", {name: BUILDINGS[name] for name in ("Hazel", "Rowan")})
        yield


def debug_grid(systems="langwm,random,oracle", seeds="0", assignments=()):
    request = Request(systems=systems, seeds=seeds)
    return make_grid(request, presets=["debug"], assignments=[*FRAMES, *assignments])


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out, calls = tmp_path_factory.mktemp("benchmark") / "out", []
    failed = run_benchmark(debug_grid(), out, progress=lambda *a: calls.append(a))
    return out, failed, calls


def test_every_cell_is_trained_and_scored(done):
    out, failed, calls = done
    assert failed == []
    for cell in cells_of(debug_grid()):
        record = read_record(out, cell)
        assert record.state == "done"
        assert record.scored == {"test": 1, "train": 1}
        rows = pq.read_table(cell.folder(out) / "eval/episodes.parquet").to_pylist()
        own = [row for row in rows if row["system"] == cell.system]
        assert sorted(row["scene"] for row in own) == ["Hazel_0", "Hazel_1", "Rowan_0"]
    learner = read_record(out, Cell("langwm", 0))
    assert learner.updates == 2
    assert learner.parameters > 1000
    assert min(learner.seconds[part] for part in ("train", "score")) > 0
    assert learner.machine["cores"] >= 1
    assert calls[0] == (0, 39)
    assert calls[-1] == (39, 39)
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)


def test_its_page_and_tables_are_there(done):
    out, _, _ = done
    text = (out / "tables.md").read_text()
    assert "| LanGWM [a] | 1 |" in text
    assert "*paper: LanGWM*" in text
    assert "### Minus LanGWM, train floors" in text
    assert "\\begin{tabular}" in (out / "table.tex").read_text()
    page = (out / "report.html").read_text()
    assert "3 of 3 cells are done, 0 failed." in page
    assert "data:image/svg+xml" in page


def test_the_same_command_finds_everything_done(done):
    out, _, _ = done
    before = {p: p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file() and out / "langwm" in p.parents}
    assert run_benchmark(debug_grid(), out) == []
    assert {p: p.stat().st_mtime_ns for p in before} == before


def test_cells_can_be_added_and_the_others_stay(done, monkeypatch):
    out, _, _ = done
    begun = []
    monkeypatch.setattr(cells_module, "_run", lambda grid, cell, *a: begun.append(cell))
    assert run_benchmark(debug_grid("straight-ahead,langwm", "0-1"), out) == []
    assert begun == [Cell("straight-ahead", 0), Cell("langwm", 1)]
    assert "5 of 5 cells are done" in (out / "report.html").read_text()
    for cell in begun:
        (out / cell.system / f"seed-{cell.seed}.json").unlink()


def test_episodes_can_be_added_and_those_played_stay(done, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(done[0], out)

    def rows(system):
        return {
            (row["split"], row["scene"], row["episode"]): row
            for row in read_rows(out / system / "seed-0/eval")
        }

    before, trained = rows("langwm"), (out / "langwm/seed-0/model/model.safetensors").stat().st_mtime_ns
    more = debug_grid(assignments=["eval_episodes=2"])
    assert "3 are done" not in plan_benchmark(more, out)
    assert "time    0.0 h" in plan_benchmark(more, out)
    assert run_benchmark(more, out) == []
    assert read_record(out, Cell("langwm", 0)).scored == {"test": 2, "train": 1}
    after = rows("langwm")
    assert after.keys() - before.keys() == {("test", "Rowan_0", 1)}
    assert {key: after[key] for key in before} == before
    assert len(rows("oracle")) == 4
    assert (out / "langwm/seed-0/model/model.safetensors").stat().st_mtime_ns == trained
    fewer = r"langwm/seed-0 of --out .* is scored on 2 episodes a test floor already; --episodes 1 must be as"
    with pytest.raises(ConfigError, match=fewer):
        run_benchmark(debug_grid("langwm"), out)
    assert read_record(out, Cell("langwm", 0)).scored == {"test": 2, "train": 1}


def test_another_grid_in_the_same_folder_is_refused(done):
    out, _, _ = done
    other = ["env.max_steps=11"]
    with pytest.raises(
        ConfigError, match=r"langwm/seed-0 of --out .* begun with another .* env\.max_steps \(10"
    ):
        run_benchmark(debug_grid(assignments=other), out)
    with pytest.raises(
        ConfigError, match=r"another configuration: overrides\.env\.max_steps \(None there, 11"
    ):
        run_benchmark(debug_grid("random", assignments=other), out)
    check_grid(debug_grid(assignments=other), out, fresh=True)
    assert read_record(out, Cell("random", 0)).state == "done"


def test_folders_of_others_are_refused_and_kept(done, tmp_path):
    out, _, _ = done
    with pytest.raises(ConfigError, match=r"holds something else: .* give a new folder"):
        run_benchmark(debug_grid(), out / "langwm/seed-0", fresh=True)
    (tmp_path / "photo.jpg").touch()
    with pytest.raises(ConfigError, match="is not empty and holds no"):
        run_benchmark(debug_grid("random"), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["photo.jpg"]


def test_what_cannot_be_trained_is_refused_before_anything_is_written(tmp_path):
    out = tmp_path / "out"
    grid = replace(debug_grid("random"), mae={"langwm": "runs/mae"})
    with pytest.raises(ConfigError, match="--mae names a run for langwm, which is not among the systems"):
        run_benchmark(grid, out)
    with pytest.raises(ConfigError, match="--workers 0 is not allowed"):
        run_benchmark(debug_grid(), out, workers=0)
    assert not out.exists()


def test_a_plan_refuses_what_the_run_refuses_in_the_same_words(done, tmp_path, tiny_mae):
    tiny_mae.save_pretrained(tmp_path / "mae/model")
    held = done[0] / "tables.md"
    frozen = debug_grid("langwm,mwm", assignments=["features=frozen"])
    for grid, out, message in (
        (replace(frozen, mae={"langwm": "/nope"}), "out", "'/nope' holds no pretrained"),
        (
            replace(frozen, mae={"langwm": str(tmp_path / "mae")}),
            "out",
            "but the MAE reads 16 x 16",
        ),
        (replace(frozen, systems=("mwm",)), "out", "give --mae mwm=RUN, or --set features=finetuned"),
        (debug_grid(assignments=["device=tpu"]), "out", "device 'tpu' cannot be used"),
        (debug_grid(), held, f"--out '{held}' is a file; give a folder"),
    ):
        said = []
        for ask in (plan_benchmark, run_benchmark):
            with pytest.raises(ConfigError, match=message) as refusal:
                ask(grid, tmp_path / out)
            said.append(str(refusal.value))
        assert said[0] == said[1]
    assert not (tmp_path / "out").exists()


def test_a_failed_cell_is_written_down_and_the_others_go_on(tmp_path, monkeypatch):
    def train(config, out, *, progress):
        if config.seed == 0:
            raise FloatingPointError("loss is\nnot a number at step 20")
        raise BrokenPipeError if config.seed == 9 else RuntimeError

    monkeypatch.setattr(cells_module, "train_agent", train)
    grid = debug_grid("langwm,random", "0-1")
    failed = run_benchmark(grid, tmp_path / "out")
    cause = "FloatingPointError: loss is not a number at step 20"
    assert failed == [f"langwm/seed-0: {cause}", "langwm/seed-1: RuntimeError"]
    record = read_record(tmp_path / "out", Cell("langwm", 0))
    assert (record.state, record.cause) == ("failed", cause)
    assert "in train" in record.details
    assert read_record(tmp_path / "out", Cell("random", 0)).state == "done"
    with pytest.raises(BrokenPipeError):
        run_cell(debug_grid("langwm", "9"), Cell("langwm", 9), tmp_path / "out", int)


def test_a_failed_cell_is_tried_again_and_an_interrupted_one_goes_on(tmp_path, monkeypatch):
    out, grid, asked = tmp_path / "out", debug_grid("langwm", "0-1"), []

    def train(config, folder, *, progress):
        asked.append(config.seed)
        progress(10, 30)
        raise KeyboardInterrupt if len(asked) == 2 else ValueError("no luck")

    monkeypatch.setattr(cells_module, "train_agent", train)
    with pytest.raises(KeyboardInterrupt):
        run_benchmark(grid, out)
    assert [read_record(out, Cell("langwm", seed)).state for seed in (0, 1)] == ["failed", "unfinished"]
    assert run_benchmark(grid, out) == ["langwm/seed-0: no luck", "langwm/seed-1: no luck"]
    assert asked == [0, 1, 0, 1]


def test_a_cell_whose_process_dies_has_failed(tmp_path, monkeypatch):
    class Pool:
        def __init__(self, *args, **kwargs):
            self.kwargs = kwargs

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def run(self, tasks, report, lost):
            assert self.kwargs["is_separate"]
            lost(tasks[0], "worker process worker-0 died (killed by SIGKILL)")

    monkeypatch.setattr(run_module, "WorkerPool", Pool)
    calls = []
    failed = run_benchmark(debug_grid("random"), tmp_path, workers=1, progress=lambda *a: calls.append(a))
    assert failed == ["random/seed-0: worker process worker-0 died (killed by SIGKILL)"]
    assert calls[-1] == (3, 3)


def block(out, grid):
    """Put files where cells want their folders, so that each fails at once."""
    for cell in cells_of(grid):
        cell.folder(out).parent.mkdir(parents=True, exist_ok=True)
        cell.folder(out).write_text("mine")


def test_cells_run_in_processes(tmp_path):
    grid, out = debug_grid("langwm", "0-1"), tmp_path / "out"
    run_module.claim_output(out, grid, run_module._KIND)
    block(out, grid)
    failed = run_benchmark(grid, out, workers=2)
    assert [text.partition(":")[0] for text in failed] == ["langwm/seed-0", "langwm/seed-1"]
    assert all("is a file; give a folder" in text for text in failed)
    assert read_record(out, Cell("langwm", 1)).machine["threads"] == 1
    assert "0 of 2 cells are done, 2 failed." in (out / "report.html").read_text()


def test_cells_run_on_ray(tmp_path, monkeypatch):
    ray = pytest.importorskip("ray")
    root = str(Path(__file__).parents[3])
    try:
        ray.init(num_cpus=2, logging_level="ERROR", runtime_env={"env_vars": {"PYTHONPATH": root}})
    except Exception as error:
        if "timed out during startup" not in str(error):
            raise
        pytest.skip("this machine is too busy to start Ray within its 30 s")
    monkeypatch.chdir(tmp_path)
    grid, out = debug_grid("langwm", "0-1"), Path("out")
    run_module.claim_output(out, grid, run_module._KIND)
    block(out, grid)
    try:
        failed = run_benchmark(grid, out, engine="ray")
    finally:
        ray.shutdown()
    assert len(failed) == 2
    assert all("is a file; give a folder" in text for text in failed)


def test_training_floors_are_scored_on_half_as_many_episodes_as_test_floors():
    config = replace(base_config(debug_grid()), eval_episodes=200)
    assert (episodes_on(config, "test"), episodes_on(config, "train")) == (200, 50)
    assert episodes_on(replace(config, eval_episodes=1), "train") == 1
    grid = debug_grid(assignments=["eval_episodes=200"])
    assert units_of(grid, Cell("random", 0)) == 300
    assert units_of(grid, Cell("langwm", 0)) == 330


def test_a_plan_counts_what_is_left(done, tmp_path):
    out, _, _ = done
    lines = plan_benchmark(debug_grid(seeds="0-2"), out, workers=2).splitlines()
    assert lines[0] == "cells   5: 3 are done, 2 are to be trained"
    assert lines[1] == "steps   60 of environments, 4 updates"
    assert lines[2] == "scoring 3 episodes a cell: 1 on each test floor and 1 on each train floor"
    assert lines[3].startswith("disk    1.6 MB")
    assert lines[4].endswith("h with 2 cells at a time")
    grid = begin_grid(tmp_path, "dreamerv2,random")
    assert "not known before a first cell is done" in plan_benchmark(grid, tmp_path)
    write_cell(tmp_path, grid, Cell("random", 0))
    write_cell(tmp_path, grid, Cell("dreamerv2", 0))
    assert plan_benchmark(grid, tmp_path).splitlines()[4] == "time    0.1 h with 1 cells at a time"


def test_time_adds_up_over_interruptions(tmp_path, monkeypatch):
    cell, clock = Cell("langwm", 0), [0.0]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])

    def stop():
        clock[0] = 5.0
        raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"), Stopwatch(tmp_path, cell).measure("train"):
        stop()
    watch = Stopwatch(tmp_path, cell)
    with watch.measure("train"):
        clock[0] = 25.0
        watch.tick()
        assert read_record(tmp_path, cell).seconds == {"train": 25.0}
        clock[0] = 26.0
        watch.tick()  # too soon to be saved again
        assert read_record(tmp_path, cell).seconds == {"train": 25.0}
    with watch.measure("score"):
        clock[0] = 36.0
    assert read_record(tmp_path, cell).seconds == {"train": 26.0, "score": 10.0}
    write_record(tmp_path, cell, Record())
    assert json.loads((tmp_path / "langwm/seed-0.json").read_text())["state"] == "unfinished"


def test_what_a_cell_ran_on_is_described():
    machine = describe_machine("cpu")
    assert machine["bf16"] == has_bf16("cpu")
    assert machine["processor"]
    assert machine["python"] == ".".join(map(str, sys.version_info[:3]))
    assert "gpu" not in machine


def test_causes_are_one_line():
    assert one_sentence(ValueError("a\n b")) == "a b"
    assert one_sentence(ValueError()) == "ValueError"
    assert one_sentence(KeyError("x")) == "KeyError: 'x'"


def test_the_grid_is_kept_as_it_was_asked_for(done):
    out, _, _ = done
    held = yaml.safe_load((out / "config.yaml").read_text())
    assert held["presets"] == ["debug"]
    assert held["overrides"]["env"]["camera"] == {"height": 64, "width": 80}
