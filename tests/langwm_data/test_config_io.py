"""Strict configuration: what is refused, and in which words."""

import dataclasses
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import field

import pytest
import yaml

from langwm_data import config_io
from langwm_data.config import DatasetConfig
from langwm_data.config_io import (
    ConfigError,
    build_config,
    claim_output,
    config,
    differing_fields,
    load_config,
)


@config
class Inner:
    rate: float = 0.5
    depth: int = 3


@config
class Outer:
    steps: int = 10
    inner: Inner = field(default_factory=Inner)


def test_configs_are_frozen_and_keyword_only():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Outer().steps = 3  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(TypeError):
        Outer(3)  # pyright: ignore[reportCallIssue]


def test_later_presets_win_and_assignments_win_over_presets(monkeypatch):
    presets = {"small": {"steps": 1, "inner": {"depth": 1}}, "fast": {"inner": {"depth": 2}}}
    monkeypatch.setattr(config_io, "load_preset", lambda package, name: presets[name])
    built = load_config(Outer, "pkg", presets=["small", "fast"], assignments=["inner.rate=1e-5"])
    assert built == Outer(steps=1, inner=Inner(rate=1e-5, depth=2))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"inner": {"dept": 3}}, r"'inner.dept' is unknown \(did you mean 'depth'\?\); allowed at inner:"),
        (
            {"stepz": 3},
            r"'stepz' is unknown \(did you mean 'steps'\?\); allowed at the top level: steps, inner",
        ),
        ({"steps": "many"}, r"field 'steps': value 'many' is not allowed: input should be a valid integer"),
        ({"inner": 3}, r"field 'inner': value 3 is not allowed"),
    ],
)
def test_wrong_fields_are_named_with_value_and_what_is_allowed(values, message):
    with pytest.raises(ConfigError, match=message):
        build_config(Outer, values)


def test_limits_of_real_config_are_checked():
    with pytest.raises(ConfigError, match=r"'splits.test_fraction': value 1.5 .* less than or equal to 1"):
        build_config(DatasetConfig, {"splits": {"test_fraction": 1.5}})


@pytest.mark.parametrize("text", ["steps", "=3", "a..b=3"])
def test_malformed_assignment_is_refused(text):
    with pytest.raises(ConfigError, match=r"not of the form a\.b=value"):
        config_io.parse_assignment(text)


def test_assignment_with_broken_yaml_is_refused():
    with pytest.raises(ConfigError, match="not valid YAML"):
        config_io.parse_assignment("a=[1,")


def test_unknown_preset_names_the_known_ones():
    with pytest.raises(ConfigError, match=r"'huge' is unknown; allowed: .*tiny"):
        config_io.load_preset("langwm_data", "huge")


def test_config_survives_the_file(tmp_path):
    value = Outer(inner=Inner(rate=1e-6))
    (tmp_path / "c.yaml").write_text(config_io.config_to_yaml(value))
    assert config_io.load_config_file(Outer, tmp_path / "c.yaml") == value


def test_two_names_of_one_place_are_the_same(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    (tmp_path / "other").mkdir()
    here = {"env": {"baked": str(tmp_path / "data")}}
    assert differing_fields({"env": {"baked": "data"}}, here) == []
    for there in ("other", "nowhere", None):
        (line,) = differing_fields({"env": {"baked": there}}, here)
        assert line.startswith(f"env.baked ({there!r} there, '/")


def test_same_config_may_claim_again_and_another_is_refused_by_field(tmp_path):
    out = tmp_path / "run"
    claim_output(out, Outer())
    claim_output(out, Outer())
    with pytest.raises(ConfigError, match=r"inner\.depth \(3 there, 4 asked for\)"):
        claim_output(out, Outer(inner=Inner(depth=4)))
    assert yaml.safe_load((out / "config.yaml").read_text())["inner"]["depth"] == 3


def test_a_longer_run_may_claim_when_the_length_may_differ(tmp_path):
    claim_output(tmp_path / "run", Outer(steps=1))
    claim_output(tmp_path / "run", Outer(steps=2), may_differ=("steps",))
    assert yaml.safe_load((tmp_path / "run/config.yaml").read_text())["steps"] == 2


def test_of_jobs_that_claim_at_once_one_wins_and_the_others_are_told(tmp_path):
    def claim(steps):
        try:
            claim_output(tmp_path / "run", Outer(steps=steps))
        except ConfigError as error:
            assert "holds a run of another configuration: steps (" in str(error)  # noqa: PT017
            return None
        return steps

    for _ in range(20):
        with ThreadPoolExecutor(8) as pool:
            (won,) = {steps for steps in pool.map(claim, [1, 2, 3, 4] * 2) if steps is not None}
        assert yaml.safe_load((tmp_path / "run/config.yaml").read_text())["steps"] == won
        assert [p.name for p in (tmp_path / "run").iterdir()] == ["config.yaml"]
        shutil.rmtree(tmp_path / "run")


def test_a_claim_that_was_killed_half_way_keeps_nobody_out(tmp_path):
    (tmp_path / ".config.yaml.0123abcd.tmp").write_text("ste")
    claim_output(tmp_path, Outer(steps=2))
    assert yaml.safe_load((tmp_path / "config.yaml").read_text())["steps"] == 2


def test_a_file_and_a_foreign_folder_are_left_alone(tmp_path):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/cat.jpg").write_text("cat")
    with pytest.raises(ConfigError, match="is a file; give a folder"):
        claim_output(tmp_path / "file", Outer(), fresh=True)
    with pytest.raises(ConfigError, match=r"is not empty and holds no config\.yaml"):
        claim_output(tmp_path / "photos", Outer(), fresh=True)
    assert (tmp_path / "photos/cat.jpg").read_text() == "cat"


def test_fresh_starts_over(tmp_path):
    claim_output(tmp_path / "run", Outer())
    (tmp_path / "run/old").write_text("")
    claim_output(tmp_path / "run", Outer(steps=3), fresh=True)
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == ["config.yaml"]


def test_fresh_does_not_remove_what_another_program_left(tmp_path):
    for text in ("services: [web]\n", "{}\n"):
        (tmp_path / "config.yaml").write_text(text)
        (tmp_path / "thesis.tex").write_text("mine")
        with pytest.raises(
            ConfigError, match=r"config\.yaml is not of this command; remove the folder yourself"
        ):
            claim_output(tmp_path, Outer(), fresh=True)
    assert (tmp_path / "thesis.tex").read_text() == "mine"


@pytest.mark.parametrize(
    ("text", "message"), [(b"a: [", "not YAML"), (b"\xff", "not YAML"), (b"3", "does not hold")]
)
def test_a_damaged_configuration_is_refused(tmp_path, text, message):
    path = tmp_path / "config.yaml"
    path.write_bytes(text)
    with pytest.raises(ConfigError, match=message):
        claim_output(tmp_path, Outer())
    with pytest.raises(ConfigError, match=message):
        config_io.load_config_file(Outer, path)
