"""What a check says: which file, which sample, what is wrong."""

from dataclasses import dataclass
from typing import Any

WRONG_CHECKSUM = "its SHA-256 is not that of the manifest"

_SHOWN = 80
"""Characters of foreign text in a sentence."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that is wrong with a dataset."""

    where: str
    """File, relative to the dataset."""
    key: str = ""
    """Name of the sample; empty where the whole file is meant."""
    what: str

    def __str__(self) -> str:
        """``train/train-000000.tar Alder_0-000007: what is wrong``."""
        return f"{self.where}{' ' * bool(self.key)}{self.key}: {self.what}"


def foreign(value: Any) -> str:  # noqa: ANN401
    """A foreign value inside a sentence: short, on one line, and without control characters."""
    text = ascii(value[: _SHOWN + 1] if isinstance(value, str | bytes) else value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
