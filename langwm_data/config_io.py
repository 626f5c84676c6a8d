"""Strict configuration: presets, ``--set a.b=value``, validation.

Owns how a config is put together, checked, written and compared. What there is to configure stands
in each package's ``config.py``.
"""

import dataclasses
import difflib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar, dataclass_transform

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError

CONFIG_FILE = "config.yaml"

T = TypeVar("T")


class ConfigError(ValueError):
    """A request that is wrong: one sentence with the field, the value and what is allowed."""


@dataclass_transform(kw_only_default=True, frozen_default=True)
def config(cls: type[T]) -> type[T]:
    """Make ``cls`` a frozen, keyword-only dataclass that refuses unknown fields, NaN and infinity."""
    strict = ConfigDict(extra="forbid", allow_inf_nan=False)
    cls.__pydantic_config__ = strict  # pyright: ignore[reportAttributeAccessIssue]
    return dataclass(frozen=True, kw_only=True)(cls)


def preset_names(package: str, folder: str = "presets") -> list[str]:
    """Names of the presets that ``package`` ships in ``folder``."""
    files = (resources.files(package) / folder).iterdir()
    return sorted(p.name.removesuffix(".yaml") for p in files if p.name.endswith(".yaml"))


def load_preset(package: str, name: str, folder: str = "presets") -> dict[str, Any]:
    """The nested values of one preset.

    Raises:
        ConfigError: If ``package`` has no preset of that name.
    """
    known = preset_names(package, folder)
    if name not in known:
        raise ConfigError(f"--preset {name!r} is unknown; allowed: {', '.join(known)}")
    text = (resources.files(package) / folder / f"{name}.yaml").read_text("utf-8")
    return yaml.safe_load(text) or {}


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with the nested values of ``over`` put on top; neither is changed."""
    merged = dict(base)
    for key, value in over.items():
        if isinstance(value, Mapping) and isinstance(merged.get(key), Mapping):
            merged[key] = merge(merged[key], value)
        else:
            merged[key] = value
    return merged


def parse_assignment(text: str) -> dict[str, Any]:
    """``a.b=value`` as nested values; the value is read as YAML.

    Raises:
        ConfigError: If the text has no ``=`` or an empty part in its dotted name.
    """
    name, equals, raw = text.partition("=")
    parts = name.strip().split(".")
    if not equals or not all(parts):
        raise ConfigError(f"--set {text!r} is not of the form a.b=value")
    try:
        value: Any = yaml.safe_load(raw)
    except yaml.YAMLError as error:
        raise ConfigError(f"--set {text!r}: the value is not valid YAML") from error
    for part in reversed(parts):
        value = {part: value}
    return value


def build_config(cls: type[T], values: Mapping[str, Any]) -> T:
    """Validate nested ``values`` into the frozen dataclass ``cls``.

    Raises:
        ConfigError: Naming the first wrong field, its value and what is allowed.
    """
    try:
        return _adapter(cls).validate_python(dict(values))
    except ValidationError as error:
        raise ConfigError(_explain(cls, error)) from error


def load_config(
    cls: type[T],
    package: str,
    *,
    presets: Sequence[str] = (),
    assignments: Sequence[str] = (),
    overrides: Mapping[str, Any] | None = None,
) -> T:
    """Defaults of ``cls``, then presets in order, then ``a.b=value``, then ``overrides``."""
    values: dict[str, Any] = {}
    for name in presets:
        values = merge(values, load_preset(package, name))
    for text in assignments:
        values = merge(values, parse_assignment(text))
    return build_config(cls, merge(values, overrides or {}))


def config_to_dict(value: Any) -> dict[str, Any]:  # noqa: ANN401
    """A config as plain nested dicts and lists, as it is written to disk."""
    return _adapter(type(value)).dump_python(value, mode="json")


def config_to_yaml(value: Any) -> str:  # noqa: ANN401
    """A config as YAML text, fields in the order of the dataclass."""
    return yaml.safe_dump(config_to_dict(value), sort_keys=False)


def load_config_file(cls: type[T], path: Path) -> T:
    """Read back what ``config_to_yaml`` wrote.

    Raises:
        ConfigError: If the file is damaged, or holds fields or values that ``cls`` does not allow.
    """
    return build_config(cls, read_mapping(path))


def _is_same(a: object, b: object) -> bool:
    """Whether two values are equal, or two names of one file or folder: a relative and an absolute path."""
    if a != b and isinstance(a, str) and isinstance(b, str) and os.path.exists(a) and os.path.exists(b):
        return os.path.samefile(a, b)
    return a == b


def differing_fields(old: Mapping[str, Any], new: Mapping[str, Any], prefix: str = "") -> list[str]:
    """Dotted names and values of the fields in which two dumped configs differ."""
    lines = []
    for key in sorted({*old, *new}):
        a, b = old.get(key), new.get(key)
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            lines += differing_fields(a, b, f"{prefix}{key}.")
        elif not _is_same(a, b):
            lines.append(f"{prefix}{key} ({a!r} there, {b!r} asked for)")
    return lines


def read_mapping(path: Path) -> dict[str, Any]:
    """The nested values of a YAML file.

    Raises:
        ConfigError: If the file is damaged or holds something else.
    """
    try:
        values = yaml.safe_load(path.read_text("utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is damaged: it is not YAML") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path} does not hold a configuration")
    return values


@cache
def _adapter(cls: type) -> TypeAdapter[Any]:
    """Reads and writes ``cls``. Making one takes tens of milliseconds for a large config."""
    return TypeAdapter(cls)


def _explain(cls: type, error: ValidationError) -> str:
    first = error.errors()[0]
    if isinstance(cause := first.get("ctx", {}).get("error"), ConfigError):
        return str(cause)  # said by a config itself about fields that do not fit together
    names = [str(p) for p in first["loc"]]
    field = ".".join(names)
    if first["type"] == "unexpected_keyword_argument":
        known = _fields_at(cls, names[:-1])
        close = difflib.get_close_matches(names[-1], known, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        where = ".".join(names[:-1]) or "the top level"
        return f"field {field!r} is unknown{hint}; allowed at {where}: {', '.join(known)}"
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    return f"field {field!r}: value {first['input']!r} is not allowed: {message}"


def _fields_at(cls: Any, names: Sequence[str]) -> list[str]:  # noqa: ANN401
    for name in names:
        cls = next(f.type for f in dataclasses.fields(cls) if f.name == name)
    return [f.name for f in dataclasses.fields(cls)]
