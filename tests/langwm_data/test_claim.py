"""The claim on a folder: who may go on in it, what starting over removes, and what is refused."""

import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import field

import pytest
import yaml

from langwm_data.claim import Kind, check_output, claim_output
from langwm_data.config_io import ConfigError, config, config_to_yaml


@config
class Inner:
    depth: int = 3


@config
class Outer:
    steps: int = 10
    seed: int = 0
    inner: Inner = field(default_factory=Inner)


RUN = Kind(writes=("model", "metrics.jsonl"), may_differ=("steps",))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def run(tmp_path):
    """A folder in which a run was."""
    out = tmp_path / "run"
    claim_output(out, Outer(), RUN)
    (out / "model").mkdir()
    (out / "model/weights").write_text("old")
    (out / "metrics.jsonl").write_text("old")
    return out


def test_same_config_may_claim_again_and_another_is_refused_by_field(tmp_path):
    out = tmp_path / "run"
    claim_output(out, Outer(), RUN)
    claim_output(out, Outer(), RUN)
    with pytest.raises(ConfigError, match=r"inner\.depth \(3 there, 4 asked for\)"):
        claim_output(out, Outer(inner=Inner(depth=4)), RUN)
    assert yaml.safe_load((out / "config.yaml").read_text())["inner"]["depth"] == 3


def test_a_longer_run_may_claim_when_the_length_may_differ(tmp_path):
    claim_output(tmp_path / "run", Outer(steps=1), RUN)
    claim_output(tmp_path / "run", Outer(steps=2), RUN)
    assert yaml.safe_load((tmp_path / "run/config.yaml").read_text())["steps"] == 2


def test_of_jobs_that_claim_at_once_one_wins_and_the_others_are_told(tmp_path):
    def claim(seed):
        try:
            claim_output(tmp_path / "run", Outer(seed=seed), RUN)
        except ConfigError as error:
            assert "holds a run of another configuration: seed (" in str(error)  # noqa: PT017
            return None
        return seed

    for _ in range(20):
        with ThreadPoolExecutor(8) as pool:
            (won,) = {seed for seed in pool.map(claim, [1, 2, 3, 4] * 2) if seed is not None}
        assert yaml.safe_load((tmp_path / "run/config.yaml").read_text())["seed"] == won
        assert [p.name for p in (tmp_path / "run").iterdir()] == ["config.yaml"]
        shutil.rmtree(tmp_path / "run")


def test_a_claim_that_was_killed_half_way_keeps_nobody_out(tmp_path):
    (tmp_path / ".config.yaml.0123abcd.tmp").write_text("ste")
    claim_output(tmp_path, Outer(steps=2), RUN)
    assert yaml.safe_load((tmp_path / "config.yaml").read_text())["steps"] == 2


def test_a_file_and_a_foreign_folder_are_left_alone(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/cat.jpg").write_text("cat")
    with pytest.raises(ConfigError, match="is a file; give a folder"):
        claim_output(tmp_path / "file", Outer(), RUN, fresh=True)
    with pytest.raises(ConfigError, match=r"is not empty and holds no config\.yaml"):
        claim_output(tmp_path / "photos", Outer(), RUN, fresh=True)
    assert (tmp_path / "photos/cat.jpg").read_text() == "cat"


@pytest.mark.parametrize("out", ["file/run", "file/a/run"])
def test_a_folder_inside_a_file_is_refused(out, tmp_path):
    (tmp_path / "file").write_text("mine")
    message = r"--out '.*/run' lies in '.*/file', which is a file; give a folder"
    with pytest.raises(ConfigError, match=message):
        claim_output(tmp_path / out, Outer(), RUN)


def test_fresh_starts_over(run):
    (run / ".metrics.jsonl.0123abcd.tmp").write_text("of a run that was killed")
    claim_output(run, Outer(steps=3, seed=1), RUN, fresh=True)
    assert names(run) == ["config.yaml"]
    assert yaml.safe_load((run / "config.yaml").read_text())["seed"] == 1


def test_fresh_follows_no_link_out_of_the_folder(run, tmp_path):
    (run / "model").rename(tmp_path / "big-disk")
    (run / "model").symlink_to(tmp_path / "big-disk")
    claim_output(run, Outer(), RUN, fresh=True)
    assert names(run) == ["config.yaml"]
    assert names(tmp_path / "big-disk") == ["weights"]


def test_what_a_killed_fresh_start_left_may_be_started_again(run, monkeypatch):
    def killed(path):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", killed)
        with pytest.raises(KeyboardInterrupt):
            claim_output(run, Outer(), RUN, fresh=True)
    assert "config.yaml" in names(run)
    claim_output(run, Outer(), RUN, fresh=True)
    assert names(run) == ["config.yaml"]


@pytest.mark.parametrize("text", ["services: [web]\n", "{}\n", "seed: 1\n", "seed: 1\nsteps: 10\n"])
@pytest.mark.parametrize("fresh", [False, True])
def test_a_folder_whose_config_is_another_is_refused_in_a_short_sentence(text, fresh, tmp_path):
    (tmp_path / "config.yaml").write_text(text)
    (tmp_path / "thesis.tex").write_text("mine")
    message = (
        r"holds something else: its config\.yaml is not one of this command and version; give a new folder$"
    )
    with pytest.raises(ConfigError, match=message):
        claim_output(tmp_path, Outer(seed=1), RUN, fresh=fresh)
    assert names(tmp_path) == ["config.yaml", "thesis.tex"]


def test_fresh_removes_nothing_beside_what_the_command_does_not_write(run):
    (run / "thesis.tex").write_text("mine")
    message = (
        r"--fresh would remove '.*/run/thesis\.tex', which this command does not write; give a new folder"
    )
    with pytest.raises(ConfigError, match=message):
        claim_output(run, Outer(seed=1), RUN, fresh=True)
    assert names(run) == ["config.yaml", "metrics.jsonl", "model", "thesis.tex"]
    assert (run / "model/weights").read_text() == "old"


@pytest.mark.parametrize("inside", ["", "model", "model/weights"])
def test_fresh_removes_nothing_that_the_command_reads(inside, run, tmp_path):
    (tmp_path / "link").symlink_to(run)
    reads = (None, "bert-base-uncased", tmp_path / "elsewhere", tmp_path / "link" / inside)
    with pytest.raises(ConfigError, match=r"--fresh would remove '.*/link.*', which this command reads"):
        claim_output(run, Outer(seed=1), RUN, fresh=True, reads=reads)
    assert (run / "model/weights").read_text() == "old"
    claim_output(run, Outer(seed=1), RUN, fresh=True, reads=reads[:3])
    assert names(run) == ["config.yaml"]


def test_fresh_is_offered_only_where_it_would_be_accepted(run):
    with pytest.raises(ConfigError, match=r"same configuration, or --fresh to start over$"):
        claim_output(run, Outer(seed=1), RUN)
    with pytest.raises(ConfigError, match=r"use another folder or the same configuration$"):
        claim_output(run, Outer(seed=1), RUN, reads=[run / "model"])
    (run / "thesis.tex").write_text("mine")
    with pytest.raises(ConfigError, match=r"use another folder or the same configuration$"):
        claim_output(run, Outer(seed=1), RUN)


def test_a_check_changes_nothing(run, tmp_path):
    before = config_to_yaml(Outer())
    check_output(run, Outer(steps=3), RUN)
    check_output(run, Outer(seed=1), RUN, fresh=True)
    assert (run / "config.yaml").read_text() == before
    assert (run / "model/weights").read_text() == "old"
    check_output(tmp_path / "new", Outer(), RUN)
    assert not (tmp_path / "new").exists()


def test_a_damaged_configuration_is_refused_and_kept(run):
    (run / "config.yaml").write_text("a: [")
    with pytest.raises(ConfigError, match=r"config\.yaml is damaged: it is not YAML"):
        claim_output(run, Outer(), RUN, fresh=True)
    assert (run / "model/weights").read_text() == "old"
