"""Read a caption back into the slots that it was filled from: the inverse of ``labels.captions``.

Owns the grammar of the seven templates. It is written against the sentences, not against the code that
makes them, so a caption that parses to the truth is true.
"""

import re
from dataclasses import dataclass
from functools import lru_cache

from langwm_data.labels.captions import DIRECTIONS, TEMPLATES

_DISTANCE = r"half a meter|1 meter|(?:[2-9]|[1-9]\d{1,3}) meters|(?:0\.[1-9]|[1-9]\d{0,3}\.\d) meters"
"""Whole metres (0 is half a meter, 1 is singular) or one decimal of at least 0.1."""

NOUN = r"[a-z0-9][a-z0-9 ':/-]{0,58}[a-z0-9]"
"""What a thing may be called: a few words without commas and stops, which end it in the templates."""
_DIRECTION_NAMES = tuple(dict.fromkeys(name for names in DIRECTIONS.values() for name in names))


@dataclass(frozen=True, kw_only=True)
class ParsedCaption:
    """What a caption says."""

    phrase: str
    """The noun, such as ``dining table``."""
    direction: str
    distance: str
    """As it is said: ``3 meters``."""
    template: int
    """1 to 7, as the paper counts them."""
    rules: tuple[int, ...]
    """The direction rules that can have answered so: ``left`` may come from either, ``outer left``
    from the second only."""


@lru_cache(maxsize=1 << 14)
def parse_caption(text: str) -> ParsedCaption:
    """Read one caption.

    Raises:
        ValueError: If the text is none of the seven templates filled with a noun, direction and distance.
    """
    for number, pattern in enumerate(_PATTERNS, start=1):
        if match := pattern.fullmatch(text):
            where = match["direction"]
            return ParsedCaption(
                phrase=match["object"],
                direction=where,
                distance=match["distance"],
                template=number,
                rules=tuple(rule for rule, names in DIRECTIONS.items() if where in names),
            )
    raise ValueError(f"caption {text[:200]!r} follows none of the {len(TEMPLATES)} templates")


def said_metres(distance: str) -> float:
    """The number behind a distance in words: ``half a meter`` is 0.5.

    Raises:
        ValueError: If this is not how a caption says a distance.
    """
    if not re.fullmatch(_DISTANCE, distance):
        raise ValueError(f"distance {distance[:200]!r} is not of the form '3 meters' or '3.2 meters'")
    return 0.5 if distance == "half a meter" else float(distance.split()[0])


def _pattern(template: str) -> re.Pattern[str]:
    """A template as a pattern that matches the whole of a caption and nothing else."""
    slots = {
        "object": NOUN,
        "direction": "|".join(map(re.escape, _DIRECTION_NAMES)),
        "distance": _DISTANCE,
    }
    parts = re.split(r"\{(\w+)\}", template)
    return re.compile(
        "".join(f"(?P<{p}>{slots[p]})" if i % 2 else re.escape(p) for i, p in enumerate(parts)), re.ASCII
    )


_PATTERNS = tuple(map(_pattern, TEMPLATES))
