"""The systems by name, and the configuration that makes each what it is."""

from collections.abc import Mapping, Sequence
from typing import Any, get_args

from agent.config import AgentConfig, SystemName
from agent.systems import dreamerv2, grounding_dino, langwm, oracle_boxes, own_encoder, sac
from agent.systems.features import Encoder
from agent.systems.system import System
from langwm_data.config_io import ConfigError, build_config, load_preset, merge

OVERLAYS = "presets/systems"

SYSTEMS: Mapping[str, System] = {
    "langwm": langwm.SYSTEM,
    "langwm-empty-language": langwm.EMPTY_LANGUAGE,
    "langwm-no-mask-empty-language": langwm.NO_MASK_EMPTY_LANGUAGE,
    "langwm-no-mask": langwm.NO_MASK,
    "mwm": langwm.MWM,
    "dreamerv2": dreamerv2.DREAMERV2,
    "dreamerv2-da": dreamerv2.DREAMERV2_DA,
    "dreamerv2-grounding-dino": grounding_dino.SYSTEM,
    "dreamerv2-oracle-boxes": oracle_boxes.SYSTEM,
    "curl": sac.SYSTEM,
    "rad": sac.SYSTEM,
}
"""Those that need nothing but a name; ``own_encoder.NAME`` needs an encoder as well."""


def find_system(name: str, encoder: Encoder | None = None) -> System:
    """The system of that name, seeing through ``encoder`` if it is the one that is given one.

    Raises:
        ConfigError: If there is none, or it needs an encoder that is not there, or the other way round.
    """
    _check_name(name)
    if (name == own_encoder.NAME) != (encoder is not None):
        raise ConfigError(
            f"system {name!r} {'needs' if encoder is None else 'takes no'} encoder=...; {own_encoder.NAME!r}"
            " is given one in Python: train_agent(config, out, encoder=...),"
            " Agent.from_pretrained(run, encoder=...)"
        )
    return SYSTEMS[name] if encoder is None else own_encoder.make_system(encoder)


def load_agent_config(
    system: str, *, presets: Sequence[str] = (), overrides: Mapping[str, Any] | None = None
) -> AgentConfig:
    """Defaults, then presets in order, then what makes ``system`` what it is, then ``overrides``.

    Raises:
        ConfigError: If a name is unknown or a value is not allowed.
    """
    _check_name(system)
    values: dict[str, Any] = {}
    for name in presets:
        values = merge(values, load_preset("agent", name))
    values = merge(values, load_preset("agent", system, OVERLAYS))
    return build_config(AgentConfig, merge(values, overrides or {}) | {"system": system})


def check_means_something(system: str, given: Mapping[str, Any]) -> None:
    """Refuse settings that somebody gave to one system though it reads none of them; presets may hold them.

    Args:
        system: The one that is asked for.
        given: Flags and assignments, in the names of ``AgentConfig``.

    Raises:
        ConfigError: If the system is unknown or named among the settings as well, or an autoencoder is given
            to a system that reads none.
    """
    _check_name(system)
    if "system" in given:
        raise ConfigError(f"--set system={given['system']} is not allowed; give --system {given['system']}")
    if system in readers_of_mae() or system == own_encoder.NAME:
        return
    for name in ("mae", "features"):
        if given.get(name) is not None:
            raise ConfigError(
                f"{name} {given[name]!r} means nothing to system {system!r}, which reads no autoencoder;"
                f" leave it out; allowed for: {', '.join(readers_of_mae())}"
            )


def readers_of_mae() -> tuple[str, ...]:
    """Systems that see through a pretrained autoencoder."""
    return tuple(name for name, system in SYSTEMS.items() if system.reads_mae)


def _check_name(name: str) -> None:
    if name not in get_args(SystemName):
        raise ConfigError(f"--system {name!r} is unknown; allowed: {', '.join(SYSTEMS)}")
