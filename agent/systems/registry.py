"""The systems by name, and the configuration that makes each what it is."""

from collections.abc import Mapping, Sequence
from typing import Any

from agent.config import AgentConfig
from agent.systems import langwm
from agent.systems.system import System
from langwm_data.config_io import ConfigError, build_config, load_preset, merge

OVERLAYS = "presets/systems"

SYSTEMS: Mapping[str, System] = {"langwm": langwm.SYSTEM}


def find_system(name: str) -> System:
    """The system of that name.

    Raises:
        ConfigError: If there is none.
    """
    if name not in SYSTEMS:
        raise ConfigError(f"--system {name!r} is unknown; allowed: {', '.join(SYSTEMS)}")
    return SYSTEMS[name]


def load_agent_config(
    system: str, *, presets: Sequence[str] = (), overrides: Mapping[str, Any] | None = None
) -> AgentConfig:
    """Defaults, then presets in order, then what makes ``system`` what it is, then ``overrides``.

    Raises:
        ConfigError: If a name is unknown or a value is not allowed.
    """
    find_system(system)
    values: dict[str, Any] = {}
    for name in presets:
        values = merge(values, load_preset("agent", name))
    values = merge(values, load_preset("agent", system, OVERLAYS))
    return build_config(AgentConfig, merge(values, overrides or {}) | {"system": system})
