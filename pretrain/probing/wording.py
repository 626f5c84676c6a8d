"""Words and numbers of the probe as reports show them."""

from collections.abc import Mapping
from types import MappingProxyType

from pretrain.probing.claims import CATEGORY, DIRECTION, DISTANCE, EMPTY, OTHER, RIGHT
from pretrain.probing.compare import Comparison, Group
from pretrain.probing.grounding import BOX, ELSEWHERE, MARGIN, MEAN, OBJECT, PIXEL_MEAN
from pretrain.statistics import Interval

TITLES: Mapping[str, str] = MappingProxyType(
    {
        RIGHT: "right caption",
        EMPTY: "empty caption",
        OTHER: "another object's caption",
        DISTANCE: "wrong distance",
        DIRECTION: "wrong direction",
        CATEGORY: "wrong category",
        MEAN: "mean depth",
        PIXEL_MEAN: "mean at each pixel",
    }
)
REGION_TITLES: Mapping[str, str] = MappingProxyType(
    {
        OBJECT: "inside the hidden object",
        MARGIN: "in its margin: the rest of the box",
        BOX: "in the whole box",
        ELSEWHERE: "elsewhere",
    }
)


def range_text(interval: Interval, digits: int, scale: float = 1.0) -> str:
    """``0.12 to 0.34``."""
    return f"{scale * interval.low:.{digits}f} to {scale * interval.high:.{digits}f}"


def change_text(difference: Interval) -> str:
    """What a caption does to the error, metres, as the end of a sentence."""
    if difference.low <= 0 <= difference.high:
        return f"makes no difference that can be told ({difference.mean:+.2f} m, {range_text(difference, 2)})"
    verb = "adds" if difference.mean > 0 else "takes off"
    return f"{verb} {abs(difference.mean):.2f} m ({range_text(difference, 2)})"


def comparison_row(name: str, comparison: Comparison) -> dict[str, str | bool]:
    """A row of a table: the error with a caption, and how much more it is than with the right one."""
    more = comparison.more_m
    return {
        "name": TITLES[name],
        "is_ours": name == RIGHT,
        "num_frames": str(comparison.num_frames),
        "error": f"{comparison.error_m.mean:.3f}",
        "interval": range_text(comparison.error_m, 3),
        "difference": f"{more.mean:+.3f}" if more else "",
        "difference_interval": range_text(more, 3) if more else "",
    }


def group_row(group: Group) -> dict[str, object]:
    """A row of a table of groups: what the right caption saves, its error, and the differences from it."""
    cells = [_cell(group.captions.get(name)) for name in TITLES]
    saved = {"value": f"{100 * group.saved.mean:.0f} %", "range": f"{range_text(group.saved, 0, 100.0)} %"}
    return {"name": group.name, "num_frames": group.num_frames, "saved": saved, "cells": cells}


def _cell(held: Comparison | None) -> dict[str, object]:
    if held is None:
        return {"value": "", "range": "", "is_clear": False}
    if held.more_m is None:
        return {"value": f"{held.error_m.mean:.2f}", "range": range_text(held.error_m, 2), "is_clear": False}
    more = held.more_m
    is_clear = not more.low <= 0 <= more.high
    return {"value": f"{more.mean:+.2f}", "range": range_text(more, 2), "is_clear": is_clear}
