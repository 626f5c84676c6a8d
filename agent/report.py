"""The report of a demo: one self-contained HTML page, rebuilt from what the stages left on disk.

Owns words, tables and which pictures are shown. Numbers are read, never computed differently here.
"""

import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from agent.evaluate import EVAL_FOLDER, Row, Score, read_rows, summarise
from agent.figures import Curve, curve_figure, map_figure
from agent.scoring.footage import walk_of
from langwm_data import atomic
from langwm_data.png import image_address
from langwm_data.scenes.navigation import floor_plan
from langwm_data.scenes.spec import SceneSpec
from langwm_data.seeding import make_rng
from langwm_data.shards.dataset import ShardDataset
from langwm_data.shards.gallery import draw_depth, draw_instances
from langwm_data.shards.sample import Sample
from langwm_data.shards.summary import summarise as summarise_dataset
from pretrain.metrics import read_metrics
from pretrain.model_file import load_model_file
from pretrain.page import render_page
from pretrain.probing.claims import DISTANCE, EMPTY, RIGHT
from pretrain.probing.compare import compare
from pretrain.probing.grounding import BOX
from pretrain.probing.wording import TITLES, change_text, comparison_row, range_text

REPORT_FILE = "report.html"
AGENT_ROW = "langwm"
"""The system that a demo trains."""
DATA, MAE, PROBE, AGENT = "data", "mae", "probe", "agent"
"""Folders of the stages in a demo's folder."""
PROBE_FILE = "probe.parquet"
PANELS_FILE = "panels.json"
FRAMES_SHOWN = 6
WALKS_PER_MAP = 4
MAPS = 3
DEPTH_SCALE_M = 8.0
MAE_CURVES = {
    "depth loss": (("training", "mae/depth_loss"),),
    "held-out depth error in hidden boxes, m": (
        ("with captions", "valid/hidden_depth_error_m"),
        ("without", "valid/hidden_depth_error_m_no_caption"),
    ),
}
AGENT_CURVES = {
    "image tokens from the state": (("training", "wm/token_loss"),),
    "task observation": (("training", "wm/task_loss"),),
    "KL, nats": (("training", "wm/kl"),),
    "reward": (("training", "wm/reward_loss"),),
    "return of training episodes": (("mean of 10", "env/return"),),
    "success of training episodes": (("mean of 10", "env/success"),),
}
SMOOTHED = {"env/return": 10, "env/success": 10}
"""Episodes that a point of a noisy curve averages over."""


def write_report(out: Path, stages: Sequence[tuple[str, str, str]], seconds: Mapping[str, float]) -> Path:
    """Write ``out/report.html`` from what the stages left in their folders in ``out``.

    Args:
        out: Folder of a finished demo.
        stages: Key in ``seconds``, title and outcome of each part, in order.
        seconds: Time spent on each part.
    """
    grounding = _grounding(out / PROBE, out / MAE)
    navigation = _navigation(out / AGENT, out / DATA)
    costs = [
        {"part": title, "seconds": f"{seconds.get(key, 0.0):.0f}", "outcome": outcome}
        for key, title, outcome in stages
    ]
    costs.append({"part": "together", "seconds": f"{sum(seconds.values()):.0f}", "outcome": ""})
    page = render_page(
        "agent",
        "report.html.j2",
        subtitle="Everything below came out of one command on this machine; every number is read from the"
        " files beside this page.",
        findings=[grounding["finding"], navigation["finding"]],
        dataset=_dataset(out / DATA),
        grounding=grounding,
        curves=_curves(out),
        navigation=navigation,
        costs=costs,
        machine=f"{os.cpu_count()} CPU cores, {platform.machine()}, Python {platform.python_version()}",
    )
    atomic.write_text(out / REPORT_FILE, page)
    return out / REPORT_FILE


def _dataset(data: Path) -> dict[str, Any]:
    dataset, summary = ShardDataset(data), summarise_dataset(data)
    frames = " and ".join(f"{n} of {split} floors" for split, n in summary.frames.items())
    sentence = (
        f"{sum(summary.frames.values())} frames ({frames}) with {sum(summary.categories.values())} visible"
        f" objects in {len(summary.categories)} categories and {summary.captions} captions,"
        f" {summary.bytes_total / 1e6:.0f} MB. Left to right: colour, instances, depth"
        f" (dark is near, bright is {DEPTH_SCALE_M:.0f} m)."
    )
    numbers = np.linspace(0, len(dataset) - 1, 8 * FRAMES_SHOWN).round().astype(int)
    samples = [dataset[n] for n in np.unique(numbers).tolist()]
    shown = sorted(samples, key=lambda s: -_num_captions(s))[:FRAMES_SHOWN]
    return {"sentence": sentence, "frames": [_frame(s) for s in sorted(shown, key=lambda s: s.key)]}


def _num_captions(sample: Sample) -> int:
    return sum(bool(o["captions"]) for o in sample.meta["objects"])


def _frame(sample: Sample) -> dict[str, str]:
    strip = np.hstack([sample.rgb, draw_instances(sample), draw_depth(sample.depth, DEPTH_SCALE_M)])
    captions = [o["captions"][0]["text"] for o in sample.meta["objects"] if o["captions"]]
    return {
        "image": image_address(strip.astype(np.uint8)),
        "alt": f"{sample.key}: colour, instances, depth",
        "caption": f"{sample.key}. " + " ".join(captions[:3]),
    }


def _grounding(probe: Path, mae: Path) -> dict[str, Any]:
    mask_ratio = load_model_file(mae)[0].mask_ratio
    errors = _errors(pq.read_table(probe / PROBE_FILE))
    found = compare(errors, make_rng(0, "report", "grounding"))
    empty, far = found[EMPTY].more_m, found[DISTANCE].more_m
    assert empty is not None
    assert far is not None
    finding = (
        f"Language: with the right caption the depth error inside a hidden box is"
        f" {found[RIGHT].error_m.mean:.2f} m; an empty caption {change_text(empty)}, one with a wrong"
        f" distance {change_text(far)}."
    )
    return {
        "finding": finding,
        "sentence": f"On {len(errors[RIGHT])} frames of floors and textures never trained on, one object is"
        f" hidden behind a box, and {100 * mask_ratio:.0f} % of the image tokens are dropped. The autoencoder"
        " predicts depth from what is left and from a caption; only the caption differs between the rows"
        " with captions.",
        "rows": [comparison_row(name, comparison) for name, comparison in found.items()],
        "note": "Mean absolute error over the box; intervals are 95 % bootstraps over frames, differences"
        " paired by frame. A caption is contradicted in one of its three slots: the distance by 3 m, left and"
        " right, or the noun.",
        "panels": _panels(probe),
    }


def _errors(table: pa.Table) -> dict[str, NDArray[np.float64]]:
    """Errors in the box by caption, frames in one order; not a number where a caption is missing."""
    by_caption: dict[str, dict[str, float]] = {}
    names = ("caption", "key", f"error_{BOX}_m")
    for caption, key, error in zip(*(table[name].to_pylist() for name in names), strict=True):
        by_caption.setdefault(caption, {})[key] = np.nan if error is None else error
    keys = by_caption[RIGHT]
    return {name: np.array([held.get(key, np.nan) for key in keys]) for name, held in by_caption.items()}


def _panels(probe: Path) -> list[dict[str, Any]]:
    panels = json.loads((probe / PANELS_FILE).read_text("utf-8"))
    return [
        {
            "text": " ".join(
                f"{TITLES[name].capitalize()}: “{text}”" for name, text in panel["captions"].items()
            ),
            "images": [
                {"name": TITLES.get(name, name), "image": _png(probe / file)}
                for name, file in panel["images"].items()
            ],
        }
        for panel in panels
    ]


def _png(path: Path) -> str:
    bgr = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ValueError(f"{path} is missing or is not a picture")
    return image_address(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8))


def _curves(out: Path) -> list[dict[str, str]]:
    mae = _curve_figure(read_metrics(out / MAE), MAE_CURVES, "gradient steps")
    agent = _curve_figure(read_metrics(out / AGENT), AGENT_CURVES, "environment steps")
    return [
        {"alt": "losses of the autoencoder over gradient steps", "image": mae},
        {"alt": "losses and returns of the agent over environment steps", "image": agent},
    ]


def _curve_figure(
    rows: Sequence[Mapping[str, Any]], panels: Mapping[str, Sequence[tuple[str, str]]], x_label: str
) -> str:
    found = {title: [_curve(rows, name, key) for name, key in lines] for title, lines in panels.items()}
    return curve_figure(found, x_label)


def _curve(rows: Sequence[Mapping[str, Any]], name: str, key: str) -> Curve:
    points = [(row["step"], row[key]) for row in rows if row.get(key) is not None]
    steps, values = ([p[i] for p in points] for i in (0, 1))
    width = SMOOTHED.get(key, 1)
    if width > 1 and len(values) > width:
        values = np.convolve(values, np.ones(width) / width, mode="valid").tolist()
        steps = steps[width - 1 :]
    return Curve(name=name, steps=steps, values=values)


def _navigation(run: Path, data: Path) -> dict[str, Any]:
    rows = read_rows(run / EVAL_FOLDER)
    scores = [s for s in summarise(rows).scores if s.is_overall]
    tables = [
        {
            "title": f"{split.capitalize()} floors"
            + (", textures never trained on" if split == "test" else ""),
            "rows": [_score_row(s) for s in scores if s.split == split],
        }
        for split in ("test", "train")
    ]
    return {
        "finding": _navigation_finding(scores),
        "sentence": "The same fixed episodes for every system. The agent has learned for a few minutes only;"
        " turn-to-goal reads the goal's bearing and is blind to obstacles.",
        "tables": tables,
        "maps": _maps(rows, data),
        "note": "SR: success rate. SPL: success weighted by path length. SoftSPL: progress in place of"
        " success. Blue paths arrived, red ones did not; the ring around a goal is the success radius.",
    }


def _navigation_finding(scores: Sequence[Score]) -> str:
    of = {(s.system, s.split): s for s in scores}
    splits = [split for split in ("test", "train") if (AGENT_ROW, split) in of]

    def rate(system: str, split: str) -> str:
        return f"{100 * of[system, split].success.mean:.0f} %"

    def left(system: str, split: str) -> str:
        return f"{of[system, split].means['distance_to_goal'].mean:.2f} m"

    arrives = [
        f"{rate(AGENT_ROW, s)} on {s} floors (random {rate('random', s)},"
        f" turn-to-goal {rate('turn-to-goal', s)})"
        for s in splits
    ]
    remains = [f"{left(AGENT_ROW, s)} (random {left('random', s)})" for s in splits]
    return (
        f"Navigation: the agent arrives in {' and '.join(arrives)};"
        f" what is left to the goal at the end is {' and '.join(remains)}."
    )


def _score_row(score: Score) -> dict[str, Any]:
    means = score.means
    return {
        "system": score.system,
        "is_ours": score.system == AGENT_ROW,
        "episodes": score.num_episodes,
        "success": f"{100 * score.success.mean:.1f}",
        "success_interval": range_text(score.success, 1, 100.0),
        "spl": f"{means['spl'].mean:.3f}",
        "spl_interval": range_text(means["spl"], 3),
        "soft_spl": f"{means['soft_spl'].mean:.3f}",
        "distance": f"{means['distance_to_goal'].mean:.2f}",
        "collisions": f"{100 * means['collisions'].mean / max(means['length'].mean, 1):.0f}",
    }


def _maps(rows: Sequence[Row], data: Path) -> list[dict[str, str]]:
    ours = [row for row in rows if row["system"] == AGENT_ROW and row["split"] == "test"]
    maps = []
    for name in sorted({row["scene"] for row in ours})[:MAPS]:
        scene = SceneSpec.from_json((data / "scenes" / f"{name}.json").read_bytes())
        walks = [walk_of(row) for row in ours if row["scene"] == name][:WALKS_PER_MAP]
        maps.append(
            {
                "image": map_figure(floor_plan(scene), walks),
                "alt": f"floor plan of {name} with paths",
                "caption": f"{name}: first {len(walks)} test episodes of the agent",
            }
        )
    return maps
