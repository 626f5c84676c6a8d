"""The command line: wrong requests are one sentence and exit code 2, and nothing is touched."""

import errno
import subprocess
import sys
from pathlib import Path

import pytest

import cli


def refuse(capsys, *arguments: str) -> str:
    """Run a wrong request; its one line on stderr."""
    code = cli.run(list(arguments))
    out, err = capsys.readouterr()
    assert code == 2, err
    assert out == ""
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("langwm: ")
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render-dataset"], "Missing option '--out'"),
        (["render-datset", "--out", "x"], "No such command 'render-datset'"),
        (["render-dataset", "--out", "x", "--workers", "two"], "Invalid value for '--workers'"),
        (
            ["render-dataset", "--out", "x", "--engine", "spark"],
            "--engine 'spark' is unknown; allowed: local",
        ),
        (["render-dataset", "--out", "x", "--shards", "3-1"], "--shards '3-1' is not of the form 0-99 or 7"),
        (["render-dataset", "--out", "x", "--shards", "0-1", "--fresh"], "discard what other ranges make"),
        (["render-dataset", "--out", "x", "--preset", "huge"], "--preset 'huge' is unknown; allowed: debug"),
        (["render-dataset", "--out", "x", "--set", "camera.heigth=64"], "did you mean 'height'?"),
        (["render-dataset", "--out", "x", "--set", "camera.height=tall"], "'camera.height': value 'tall'"),
        (["render-dataset", "--out", "x", "--set", "frames"], "is not of the form a.b=value"),
        (
            ["render-dataset", "--out", "x", "--set", "camera.far_m=.inf"],
            "inf is not allowed: input should be",
        ),
        (["render-dataset", "--out", "x", "--frames", "0"], "'frames': value 0 is not allowed"),
        (["inspect", "nowhere"], "nowhere"),
        (["inspect", "nowhere", "key", "--plots", "x"], "--gallery and --plots are of the whole dataset"),
        (["inspect", "nowhere", "--out", "x.png"], "--out is for one frame or --rerun"),
        (["pretrain-mae", "--data", "nowhere", "--out", "x", "--preset", "debug"], "nowhere"),
        (["probe-mae", "--data", "nowhere", "--out", "x"], "Missing argument"),
        (["probe-mae", "nowhere", "--data", "nowhere", "--out", "x"], "'nowhere' holds no pretrained"),
        (["probe-mae", "nowhere", "--data", "x", "--out", "x", "--frames", "0"], "'frames': value 0 is not"),
        (
            ["probe-mae", "nowhere", "--data", "x", "--out", "x", "--split", "val"],
            "'split': value 'val'",
        ),
        (["train-agent", "--out", "x", "--preset", "debug", "--system", "hal"], "'hal'"),
        (
            ["train-agent", "--out", "x", "--set", "env.reward.progress=.nan"],
            "field 'env.reward.progress': value nan is not allowed: input should be a finite number",
        ),
        (["train-agent", "--out", "x", "--preset", "debug", "--mae", "nowhere"], "nowhere"),
        (
            ["train-agent", "--out", "x", "--system", "curl", "--set", "env.id=Nothing-v0"],
            "env.id 'Nothing-v0' cannot be made: NameNotFound",
        ),
        (
            ["train-agent", "--out", "x", "--system", "curl", "--set", "env.id=Pendulum-v1"],
            "which has no frames; allowed: a picture",
        ),
        (
            ["train-agent", "--out", "x", "--plan", "--set", "env.pixels=true"],
            "env.kwargs and env.pixels are of another environment",
        ),
        (
            ["train-agent", "--out", "x", "--system", "dreamerv2", "--mae", "nowhere"],
            "mae 'nowhere' means nothing to system 'dreamerv2'",
        ),
        (
            ["train-agent", "--out", "x", "--system", "curl", "--set", "features=frozen"],
            "features 'frozen' means nothing to system 'curl'",
        ),
        (
            ["train-agent", "--out", "x", "--system", "curl", "--set", "system=rad"],
            "--set system=rad is not allowed; give --system rad",
        ),
        (["evaluate-agent", "nowhere"], "nowhere"),
        (["benchmark", "--out", "x", "--systems", "langwm,hal"], "--systems: 'hal' is unknown; allowed: "),
        (["benchmark", "--out", "x", "--seeds", "4-0"], "--seeds '4-0' is not of the form 0-4, 7 or 0-2,5"),
        (["benchmark", "--out", "x", "--engine", "spark"], "--engine 'spark' is unknown; allowed: local"),
        (["benchmark", "--out", "x", "--workers", "0"], "--workers 0 is not allowed; allowed: 1 or more"),
        (["benchmark", "--out", "x", "--set", "seed=3"], "--set seed=3 is not for a grid; give --seeds"),
        (["benchmark", "--out", "x", "--mae", "hal=x"], "--mae 'hal=x' is not of the form RUN or SYSTEM=RUN"),
        (["benchmark", "--out", "x", "--against", "hal"], "--against 'hal' is unknown; allowed: "),
        (["benchmark", "--out", "x", "--tables"], "'x' holds no grid"),
        (["demo", "--preset", "huge"], "--preset 'huge' is unknown"),
    ],
)
def test_wrong_requests_are_one_sentence(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in refuse(capsys, *arguments)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command",
    [
        ["render-dataset", "--preset", "debug"],
        ["train-agent", "--preset", "debug", "--features", "finetuned"],
        ["benchmark", "--preset", "debug", "--systems", "random"],
        ["demo", "--preset", "debug"],
    ],
)
def test_a_file_where_a_folder_should_be_is_kept(command, capsys, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "is a file" in refuse(capsys, *command, "--out", str(tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "mine"


def test_a_plan_of_training_does_nothing(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--set", "env.is_blind=true", "--set", "env.camera.height=16", "--set", "env.camera.width=16"]
    assert (
        cli.run(["train-agent", "--out", "x", "--preset", "debug", "--system", "dreamerv2", "--plan", *small])
        == 0
    )
    assert "steps   30 of the environment" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_the_way_to_score_a_run_is_one_that_works(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("agent.train.train_agent", lambda config, out, **_: out)
    out = str(tmp_path / "x")
    for name, way in (
        ("Any-v0", f"with: langwm evaluate-agent {out}"),
        (
            "here:Any-v0",
            f"from Python: agent.scoring.anywhere.evaluate_anywhere('{out}', env=gymnasium.make(",
        ),
    ):
        assert cli.run(["train-agent", "--out", out, "--set", f"env.id={name}"]) == 0
        assert f"agent at {out}; score it {way}" in capsys.readouterr().out


def test_an_environment_that_cannot_be_used_is_one_sentence(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "pygame", None)
    asked = ["train-agent", "--out", "x", "--system", "curl", "--preset", "debug"]
    assert cli.run([*asked, "--set", "env.id=Pendulum-v1", "--set", "env.pixels=true"]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("langwm: ")]
    assert "env.id 'Pendulum-v1' cannot be re" in line
    assert "DependencyNotInstalled: pygame is not installed" in line


def test_a_run_names_what_it_reads_from_the_root(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    configs = []
    monkeypatch.setattr("agent.train.train_agent", lambda config, out, **_: configs.append(config) or out)
    by_set = ["--set", "env.scenes.baked=data", "--set", "mae=some/hub"]
    for words in (["--data", "data", "--mae", "data"], by_set):
        assert cli.run(["train-agent", "--out", "x", *words]) == 0
    assert {config.env.scenes.baked for config in configs} == {str(tmp_path / "data")}
    assert [config.mae for config in configs] == [str(tmp_path / "data"), "some/hub"]


def test_a_plan_says_what_it_will_take_and_does_nothing(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--frames", "3", "--set", "camera.height=24", "--set", "camera.width=30"]
    assert cli.run(["render-dataset", "--out", "x", "--plan", "--shards", "0", *small]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "frames  3 in 1 shards, of 1 floors"
    assert not list(tmp_path.iterdir())


def test_a_benchmark_with_failed_cells_ends_with_1_and_their_names(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("agent.benchmark.run.run_benchmark", lambda *a, **k: ["langwm/seed-0: no luck"])
    assert cli.run(["benchmark", "--out", str(tmp_path / "x")]) == 1
    out, err = capsys.readouterr()
    assert out.startswith("report at ")
    assert err == "langwm: 1 cells failed; the same command tries them again: langwm/seed-0: no luck\n"
    monkeypatch.setattr("agent.benchmark.run.run_benchmark", lambda *a, **k: [])
    assert cli.run(["benchmark", "--out", str(tmp_path / "x")]) == 0


def test_a_plan_of_a_benchmark_does_nothing(capsys, tmp_path):
    arguments = ["benchmark", "--out", str(tmp_path / "x"), "--systems", "random", "--plan"]
    assert cli.run([*arguments, "--preset", "debug", "--seeds", "0-4"]) == 0
    assert capsys.readouterr().out.startswith("cells   1: 0 are done, 0 are to be trained")
    assert not list(tmp_path.iterdir())


def test_assignments_win_over_flags_and_flags_over_presets():
    from langwm_data.config import DatasetConfig

    config = cli._load(DatasetConfig, "langwm_data", ["debug"], ["frames=7"], {"frames": 5, "seed": 3})
    assert (config.frames, config.seed) == (7, 3)


def test_a_full_disk_is_one_sentence_and_exit_code_1(capsys, monkeypatch, tmp_path):
    def full(*args, **kwargs):
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "train-000000.tar"))

    monkeypatch.setattr("langwm_data.pipeline.render_dataset", full)
    assert cli.run(["render-dataset", "--out", str(tmp_path / "d"), "--preset", "debug"]) == 1
    err = capsys.readouterr().err.strip()
    assert "No space left on device" in err
    assert "train-000000.tar" in err
    assert len(err.splitlines()) == 1


def test_a_file_that_cannot_take_its_place_is_called_by_its_own_name(capsys, monkeypatch, tmp_path):
    def occupied(*args, **kwargs):
        (tmp_path / ".x.tmp").write_text("")
        (tmp_path / "x").mkdir()
        (tmp_path / ".x.tmp").replace(tmp_path / "x")

    monkeypatch.setattr("langwm_data.pipeline.render_dataset", occupied)
    assert cli.run(["render-dataset", "--out", str(tmp_path / "d"), "--preset", "debug"]) == 1
    assert capsys.readouterr().err.strip().endswith(f"Is a directory at {str(tmp_path / 'x')!r}")


@pytest.mark.parametrize("flag", ["--gallery", "--plots", "--out"])
def test_a_folder_for_a_file_and_a_file_for_a_folder_are_refused(flag, capsys, tmp_path):
    (tmp_path / "file").write_text("mine")
    wrong = tmp_path / "file" if flag == "--plots" else tmp_path
    assert f"Invalid value for '{flag}'" in refuse(capsys, "inspect", str(tmp_path), "key", flag, str(wrong))
    assert (tmp_path / "file").read_text() == "mine"


def test_mistakes_of_ours_keep_their_traceback(monkeypatch, tmp_path):
    def broken(*args, **kwargs):
        return int("not a number")

    monkeypatch.setattr("langwm_data.pipeline.render_dataset", broken)
    with pytest.raises(ValueError, match="invalid literal"):
        cli.run(["render-dataset", "--out", str(tmp_path / "d"), "--preset", "debug"])


def test_help_imports_no_heavy_package():
    code = "import sys, cli; cli.run(['--help']); assert not {'torch', 'pybullet', 'cv2'} & set(sys.modules)"
    root = Path(cli.__file__).parent
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=root, check=False)
    assert done.returncode == 0, done.stderr
    assert "render-dataset" in done.stdout


def test_a_level_of_logging_that_there_is_not_is_refused(monkeypatch, capsys):
    monkeypatch.setenv("LANGWM_LOG", "loud")
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    heard = capsys.readouterr().err
    assert heard.startswith("langwm: LANGWM_LOG 'loud' is no level; allowed: CRITICAL, ")
    assert len(heard.splitlines()) == 1


def test_plain_progress_says_rate_and_remaining_time(capsys):
    progress = cli._PlainProgress("frames")
    for done in (0, 50, 100):
        progress(done, 100)
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[0].startswith("0/100 frames")
    assert lines[-1].startswith("100/100 frames")
    assert len(lines) == 2


def test_doctor_says_what_homes_use_of_catalogues(tmp_path, capsys):
    assert cli.run(["doctor", "--furniture", str(tmp_path)]) == 2
    assert "langwm: " in capsys.readouterr().err


def test_inspect_without_the_viewer_prints_nothing_first(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert cli.run(["inspect", "anywhere", "--rerun"]) == 2
    heard = capsys.readouterr()
    assert heard.out == ""
    assert "--rerun needs the Rerun SDK" in heard.err


def test_a_probe_takes_several_datasets_the_first_of_which_has_both_splits(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(
        "pretrain.probing.run.probe_mae", lambda config, out, **more: asked.append(config) or out / "page"
    )
    words = ["probe-mae", "RUN", "--data", "A", "--data", "B", "--data", "C", "--out", str(tmp_path)]
    assert cli.run(words) == 0
    assert (asked[0].data, asked[0].others) == ("A", ("B", "C"))
    assert cli.run(["probe-mae", "RUN", "--data", "A", "--out", str(tmp_path)]) == 0
    assert (asked[1].data, asked[1].others) == ("A", ())
    assert cli.run(["probe-mae", "RUN", "--out", str(tmp_path)]) == 2


def test_an_interrupt_is_said_in_a_sentence(monkeypatch, capsys):
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("agent.doctor.diagnose", interrupted)
    assert cli.run(["doctor"]) == 130
    assert capsys.readouterr().err.strip() == "langwm: interrupted; the same command goes on from here"
