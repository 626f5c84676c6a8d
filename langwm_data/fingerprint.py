"""What the bytes of a dataset's shards depend on, in one checksum.

Owns which things these are. What they are on this machine stands in ``pipeline``, what they were where a
dataset was made in its manifest.
"""

import copy
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from langwm_data.scenes.splits import EVERYTHING

_PLACES = ("baked", "furniture", "igibson")
"""Of ``config.scenes``: they say where things lie, not what they are."""


def fingerprint_of(
    config: Mapping[str, Any],
    *,
    sources: Mapping[str, str],
    physics: str,
    renderer: str,
    generator: str,
    schema_version: int,
) -> str:
    """SHA-256 over everything that the bytes of the shards depend on.

    Args:
        config: A ``DatasetConfig`` as plain values.
        sources: SHA-256 of the files of others that scenes are made from.
        physics: What settled the scenes, with its version.
        renderer: What drew the frames, with its version.
        generator: Program and version.
        schema_version: Of the dataset.
    """
    values = copy.deepcopy(dict(config))
    scenes, splits = values.get("scenes"), values.get("splits")
    if isinstance(scenes, dict):
        for name in _PLACES:
            scenes.pop(name, None)
    if isinstance(splits, dict) and splits.get("holds_out") == list(EVERYTHING):
        del splits["holds_out"]  # as it was before there was a choice, so that older datasets keep theirs
    value = {
        "config": values,
        "sources": dict(sources),
        "physics": physics,
        "renderer": renderer,
        "generator": generator,
        "schema_version": schema_version,
    }
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
