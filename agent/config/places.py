"""Where the things lie that a run reads again later.

Owns how they are named: so that they are found from any working directory.
"""

import os
from collections.abc import Mapping
from typing import Any

PLACES = ("mae", "env.scenes.baked", "env.scenes.furniture", "env.scenes.igibson")
"""Fields of ``AgentConfig``."""


def absolute(place: str) -> str:
    """A path from the root; what is not there may be a name on the hub, and stays as it is."""
    return os.path.abspath(place) if os.path.exists(place) else place


def with_absolute_places(overrides: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """``overrides`` of an ``AgentConfig`` with paths from the root."""
    found = dict(overrides)
    for name, value in overrides.items():
        if isinstance(value, Mapping):
            found[name] = with_absolute_places(value, f"{prefix}{name}.")
        elif isinstance(value, str) and f"{prefix}{name}" in PLACES:
            found[name] = absolute(value)
    return found
