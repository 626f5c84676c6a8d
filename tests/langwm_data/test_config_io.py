"""Strict configuration: what is refused, and in which words."""

import dataclasses
from dataclasses import field

import pytest

from langwm_data import config_io
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError, build_config, config, differing_fields, load_config


@config
class Inner:
    rate: float = 0.5
    rates: tuple[float, ...] | None = None
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
        ({"inner": {"rate": float("inf")}}, r"'inner.rate': value inf .* should be a finite number"),
        ({"inner": {"rates": [1, float("nan")]}}, r"'inner.rates.1': value nan .* should be a finite number"),
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


@pytest.mark.parametrize(
    ("text", "message"), [(b"a: [", "not YAML"), (b"\xff", "not YAML"), (b"3", "does not hold")]
)
def test_a_damaged_configuration_is_refused(tmp_path, text, message):
    path = tmp_path / "config.yaml"
    path.write_bytes(text)
    with pytest.raises(ConfigError, match=message):
        config_io.load_config_file(Outer, path)
