"""Six ways to pretrain the autoencoder, trained alike and asked the same: does explicit grounding pay?

Object masks on or off times language on or off; Voltron's way (tokens hidden at random, the scene
described); MWM's (tokens hidden at random, colours filled in, no language). Each is a run in a folder of its
own, which goes on where it was stopped. Then all look at the same held-out frames: depth behind one hidden
object with captions that are right, missing and wrong, where depth and language are there; and what simple
readers find in frozen features, which all have, beside a random encoder and the raw frame.

python -m benchmarks.combinations --data DATA --out DIR [--steps 500] [--preset homes] [--frames 500]
    [--only grounded voltron] [--set a.b=v]
"""

import argparse
import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from langwm_data import atomic
from langwm_data.config_io import load_config, merge, parse_assignment
from langwm_data.scenes.spec import Split
from langwm_data.seeding import make_rng
from pretrain.config import PretrainConfig, ProbeConfig
from pretrain.language import FrozenText
from pretrain.probing.claims import DISTANCE, EMPTY, RIGHT
from pretrain.probing.compare import Comparison, compare_group, heed_distance
from pretrain.probing.features import (
    PIXELS,
    TOKENS,
    Encoder,
    choose_frames,
    encode_pixels,
    mae_encoder,
    random_encoder,
    see_frames,
)
from pretrain.probing.grounding import MEAN, OBJECT, measure_grounding
from pretrain.probing.run import RANDOM, RAW, TRAIN_SHARE
from pretrain.probing.scene import DepthPrior, ProbeScene, make_probe_scene
from pretrain.probing.scores import FeatureScore, score_features
from pretrain.probing.subject import Subject, open_subject
from pretrain.statistics import Interval
from pretrain.train import pretrain_mae


@dataclass(frozen=True, kw_only=True)
class Combination:
    """One way, as switches on top of a preset."""

    title: str
    switches: Sequence[str]

    @property
    def has_language(self) -> bool:
        return "objects.captions=none" not in self.switches


COMBINATIONS: Mapping[str, Combination] = {
    "grounded": Combination(title="object masks, language", switches=()),
    "masks": Combination(title="object masks", switches=("objects.captions=none",)),
    "language": Combination(title="language", switches=("objects.hides=false",)),
    "neither": Combination(title="neither", switches=("objects.hides=false", "objects.captions=none")),
    "voltron": Combination(
        title="scene's caption, as Voltron", switches=("objects.hides=false", "objects.captions=scene")
    ),
    "mwm": Combination(
        title="colours, as MWM",
        switches=("objects.hides=false", "objects.captions=none", "mae.target=rgb"),
    ),
}
TEXT = {RIGHT: "right", EMPTY: "empty", DISTANCE: "wrong distance"}


def config_of(name: str, options: argparse.Namespace) -> PretrainConfig:
    """The run of one combination: alike but for its switches."""
    overrides = {"steps": options.steps, "seed": options.seed}
    for text in COMBINATIONS[name].switches:
        overrides = merge(overrides, parse_assignment(text))
    return load_config(
        PretrainConfig, "pretrain", presets=[options.preset], assignments=options.set, overrides=overrides
    )


def measure_depth(
    subject: Subject, scene: ProbeScene, text: FrozenText, prior: DepthPrior
) -> dict[str, object]:
    """Errors behind the hidden object, and how far depth follows a wrong distance."""
    result = measure_grounding(subject.mae, text, scene, prior, seed=subject.config.seed)
    rng, everything = make_rng(subject.config.seed, "combinations"), np.ones(len(scene), dtype=np.bool_)
    group = compare_group("all", result.errors_in(OBJECT), everything, rng)
    assert group is not None
    heeded = heed_distance(scene.claims, result.depths, rng)
    return {"captions": group.captions, "saved": group.saved, "heeded": heeded}


def read_features(subjects: Mapping[str, Subject]) -> list[FeatureScore]:
    """All encoders beside each other, on the same frames."""
    first = next(iter(subjects.values()))
    seed, limit = first.config.seed, first.config.frames
    encoders: dict[str, Encoder] = {name: mae_encoder(s.mae) for name, s in subjects.items()}
    encoders |= {RANDOM: random_encoder(first.mae, seed), RAW: encode_pixels}
    seen = {}
    splits: tuple[Split, ...] = ("train", "test")
    for split in splits:
        frames = first.splits[split]
        num_frames = limit * (TRAIN_SHARE if split == "train" else 1)
        numbers = choose_frames(make_rng(seed, "features", split), frames.shards.frames, num_frames)
        seen[split] = see_frames(frames, numbers, encoders)
    return score_features(seen["train"], seen["test"], seed)


def probe_all(runs: Mapping[str, Path], options: argparse.Namespace) -> dict[str, object]:
    """What every run knows; all are told the same of the same frames."""
    subjects = {
        name: open_subject(
            ProbeConfig(run=str(run), data=str(options.data), frames=options.frames, seed=options.seed)
        )
        for name, run in runs.items()
    }
    first = next(iter(subjects.values()))
    text = FrozenText(first.mae.text)
    prior = DepthPrior.of(first.splits["train"], first.mae.config.max_depth_m)
    scene = make_probe_scene(
        first.splits["test"], text, first.objects, num_frames=options.frames, seed=options.seed
    )
    depth = {
        name: measure_depth(subject, scene, text, prior)
        for name, subject in subjects.items()
        if subject.mae.config.target == "depth"
    }
    return {"frames": len(scene), "depth": depth, "features": read_features(subjects)}


def as_markdown(found: Mapping[str, object], options: argparse.Namespace, runs: Mapping[str, Path]) -> str:
    """One table; a row for each run, for the random encoder and for the raw frame."""
    depth, scores = found["depth"], found["features"]
    assert isinstance(depth, dict)
    assert isinstance(scores, list)
    tasks = list(dict.fromkeys((s.task, s.score) for s in scores))
    heads = [*(f"{text}, m" for text in TEXT.values()), "saved, %", "heeded, %"]
    heads += [f"{task} ({score})" for task, score in tasks]
    lines = [f"| | {' | '.join(heads)} |", f"|---|{'---|' * len(heads)}"]
    for name in (*runs, RANDOM, RAW):
        cells = depth_cells(name, depth.get(name)) + [score_cell(name, task, scores) for task, _ in tasks]
        title = COMBINATIONS[name].title if name in COMBINATIONS else name
        lines.append(f"| {title} | {' | '.join(cells)} |")
    chance = ["", "", "", "", "", *(f"{next(s for s in scores if s.task == t).chance:.3f}" for t, _ in tasks)]
    if depth:
        chance[1] = error_text(next(iter(depth.values()))["captions"][MEAN])
    lines.append(f"| without looking | {' | '.join(chance)} |")
    return "\n".join(
        [
            f"Preset `{options.preset}`, {options.steps} steps, seed {options.seed},"
            f" {found['frames']} held-out frames; 95 % intervals.",
            "Depth: mean absolute error inside the hidden object; saved: share of the error with an empty"
            " caption that the right one takes off; heeded: share of a wrong distance that the predicted"
            f" depth follows. Features: linear reading of the {TOKENS}.",
            "",
            *lines,
            "",
        ]
    )


def depth_cells(name: str, held: Mapping[str, object] | None) -> list[str]:
    """Of a row; what a run cannot be asked is left empty."""
    if held is None:
        return [""] * (len(TEXT) + 2)
    captions = held["captions"]
    assert isinstance(captions, Mapping)
    told = COMBINATIONS[name].has_language
    errors = [error_text(captions[c]) if told or c == EMPTY else "" for c in TEXT]
    return errors + [interval_text(held[what], 0, 100.0) if told else "" for what in ("saved", "heeded")]


def score_cell(name: str, task: str, scores: Sequence[FeatureScore]) -> str:
    """What is read linearly from the mean of tokens, or from pixels."""
    kind = PIXELS if name == RAW else TOKENS
    held = next(
        s for s in scores if (s.encoder, s.features, s.task, s.reader) == (name, kind, task, "linear")
    )
    return interval_text(Interval(held.value, held.low, held.high), 3)


def error_text(comparison: Comparison) -> str:
    return interval_text(comparison.error_m, 3)


def interval_text(interval: object, digits: int, scale: float = 1.0) -> str:
    assert isinstance(interval, Interval)
    return interval.as_text(digits, scale)


def as_json(found: Mapping[str, object]) -> str:
    """Everything that was measured, also the readings that have no place in the table."""
    return json.dumps(found, default=dataclasses.asdict, indent=1, sort_keys=True)


def parse_arguments() -> argparse.Namespace:
    """Flags of the program."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--preset", default="homes")
    parser.add_argument("--frames", type=int, default=500, help="held-out frames")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=list(COMBINATIONS), default=list(COMBINATIONS))
    parser.add_argument("--set", action="append", default=[], metavar="a.b=v")
    return parser.parse_args()


def main() -> None:
    """Train what is not trained yet, ask all, write the table."""
    options = parse_arguments()
    runs = {name: options.out / name for name in options.only}
    for name, run in runs.items():
        print(f"{name}: {COMBINATIONS[name].title}", flush=True)
        pretrain_mae(config_of(name, options), options.data, run)
    found = probe_all(runs, options)
    atomic.write_text(options.out / "combinations.json", as_json(found) + "\n")
    table = as_markdown(found, options, runs)
    atomic.write_text(options.out / "combinations.md", table)
    print(table)


if __name__ == "__main__":
    main()
