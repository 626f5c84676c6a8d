"""The page of a probe: self-contained HTML. Owns tables and which pictures are shown."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool

from langwm_data.png import image_address
from pretrain.config import ProbeConfig
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.page import render_page
from pretrain.probing.attention import WordAttention, attend_to_words, cells_inside
from pretrain.probing.claims import CAPTIONS, RIGHT
from pretrain.probing.compare import MIN_CATEGORY_ROWS
from pretrain.probing.figures import attention_figure, distance_figure, region_figure, score_figure
from pretrain.probing.findings import Grounding, findings
from pretrain.probing.grounding import REGIONS, predict_with_captions
from pretrain.probing.panels import panel_images, shown_rows
from pretrain.probing.scores import FeatureScore
from pretrain.probing.wording import REGION_TITLES, TITLES, comparison_row, group_row, range_text
from pretrain.statistics import Interval

REPORT_FILE = "report.html"
PANELS = 6
ATTENTION_FRAMES = 3
_PLOTTED = REGIONS[1:]
"""Regions that have a plot; the box is the sum of the first two."""


def render_report(
    config: ProbeConfig, grounding: dict[str, Any] | None, scores: Sequence[FeatureScore]
) -> str:
    """The page as text.

    Args:
        config: What was asked for.
        grounding: From ``draw_grounding``; ``None`` for a model of colours.
        scores: What features know.
    """
    return render_page(
        "pretrain.probing",
        "probe.html.j2",
        config=config,
        grounding=grounding,
        score_figure=score_figure(scores) if scores else None,
        tasks=_task_tables(scores),
    )


def draw_grounding(
    mae: LanguageGroundedMAE, text: FrozenText, grounding: Grounding, seed: int
) -> dict[str, Any]:
    """Tables, plots and pictures of what language does, as the template wants them."""
    numbers = grounding.numbers
    regions = {name: numbers.regions[name] for name in _PLOTTED}
    compared = [name for name in CAPTIONS if name != RIGHT]
    return {
        "about": numbers.about,
        "num_frames": numbers.num_frames,
        "mask_percent": f"{100 * mae.config.mask_ratio:.0f}",
        "findings": findings(numbers),
        "region_figure": region_figure(regions),
        "regions": [
            {"title": REGION_TITLES[r], "rows": [comparison_row(n, c) for n, c in numbers.regions[r].items()]}
            for r in REGIONS
            if numbers.regions[r]
        ],
        "caption_titles": list(TITLES.values()),
        "distance_figure": distance_figure(numbers.by_distance, compared),
        "tables": [
            {"title": title, "rows": [group_row(group) for group in groups]}
            for title, groups in (
                ("By distance of the hidden object", numbers.by_distance),
                (f"By category, if hidden in {MIN_CATEGORY_ROWS} frames or more", numbers.by_category),
                ("Seen and unseen", numbers.subsets),
            )
        ],
        "panels": _panels(mae, text, grounding, seed),
        "attention": _attention(mae, text, grounding),
    }


def _panels(
    mae: LanguageGroundedMAE, text: FrozenText, grounding: Grounding, seed: int
) -> list[dict[str, Any]]:
    scene, panels = grounding.result.scene, []
    for row in shown_rows(scene.batch, PANELS):
        told = scene.claims[row]
        depth_of = predict_with_captions(mae, text, scene, seed, rows=slice(row, row + 1))
        depths = {name: depth[0] for name, depth in depth_of.items() if name in told}
        images = panel_images(scene.batch, row, depths, mae.config.max_depth_m)
        shown = scene.objects[row]
        panels.append(
            {
                "key": scene.keys[row],
                "what": f"{shown.noun}, {shown.distance_m:.1f} m",
                "captions": [{"name": TITLES[n], "text": c.text} for n, c in told.items() if c.text],
                "images": [
                    {"name": TITLES.get(name, name), "image": image_address(image)}
                    for name, image in images.items()
                ],
            }
        )
    return panels


def _attention(mae: LanguageGroundedMAE, text: FrozenText, grounding: Grounding) -> list[dict[str, Any]]:
    """Frames shown above, told the truth."""
    batch, found = grounding.result.scene.batch, []
    for row in shown_rows(grounding.result.scene.batch, ATTENTION_FRAMES):
        one = batch.rows(slice(row, row + 1))
        (attention,) = attend_to_words(mae, one.rgb, one.is_hidden, one.text)
        rgb, is_hidden = one.rgb[0].numpy(), one.is_hidden[0].numpy()
        picture = attention_figure(rgb, is_hidden, text.words(one.captions[0]), attention)
        shares = _word_shares(attention, cells_inside(is_hidden, mae.config.grid))
        found.append({"caption": one.captions[0], "picture": picture, "shares": shares})
    return found


def _word_shares(
    attention: WordAttention, is_inside: Bool[np.ndarray, "rows columns"]
) -> list[dict[str, str]]:
    """Of each layer, what words have of the attention of cells in the box, of other cells, and of CLS."""
    columns = {
        "inside": attention.share(is_inside),
        "outside": attention.share(~is_inside),
        "cls": attention.cls.sum(axis=1),
    }
    return [
        {"layer": str(layer + 1)} | {name: _percent(float(held[layer])) for name, held in columns.items()}
        for layer in range(len(attention.cls))
    ]


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if np.isfinite(share) else "nothing"


def _task_tables(scores: Sequence[FeatureScore]) -> list[dict[str, Any]]:
    tables = []
    for task in dict.fromkeys(s.task for s in scores):
        held = [s for s in scores if s.task == task]
        rows = [
            {
                "encoder": s.encoder,
                "features": s.features,
                "reader": s.reader,
                "value": f"{s.value:.3f}",
                "range": range_text(Interval(s.value, s.low, s.high), 3),
                "knob": f"{s.knob:g}",
            }
            for s in held
        ]
        first = held[0]
        note = (
            f"{first.score}; without looking {first.chance:.3f}; {first.num_train} training and"
            f" {first.num_test} test rows in {first.num_groups} independent groups"
        )
        tables.append({"title": task, "note": note, "rows": rows})
    return tables
