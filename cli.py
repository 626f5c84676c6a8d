"""The command line: parse, load the configuration, call one function.

Owns flags, progress and exit codes: 0 success, 1 the work failed, 2 the request was wrong. A wrong
request is one sentence on stderr. Heavy packages are imported inside the commands, so that ``--help``
answers at once.
"""

import contextlib
import errno
import logging
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from langwm_data.config_io import load_config, merge, parse_assignment

if TYPE_CHECKING:
    from langwm_data.shards.verify import VerifyReport

app = typer.Typer(
    name="langwm",
    help="LanGWM: render captioned homes, pretrain a language-grounded encoder, train an agent on it.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

Preset = Annotated[list[str], typer.Option("--preset", help="Named settings; repeatable, later wins.")]
Set = Annotated[list[str], typer.Option("--set", metavar="a.b=v", help="One setting; repeatable.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of everything random in this command.")]
Fresh = Annotated[bool, typer.Option("--fresh", help="Throw away what an earlier run left in --out.")]
Out = Annotated[Path, typer.Option("--out", help="Folder to write; the same command goes on in it.")]
Steps = Annotated[int | None, typer.Option("--steps", help="How long to train.")]

T = TypeVar("T")

# Typer carries its own click in newer releases and imports the package in older ones.
_UsageError: type[Exception] = next(
    base for base in typer.BadParameter.__mro__ if base.__name__ == "ClickException"
)


@app.command("render-dataset")
def render_dataset_command(
    out: Annotated[
        str, typer.Option("--out", help="Folder or URL to write; the same command goes on in it.")
    ],
    frames: Annotated[int | None, typer.Option("--frames", help="All frames, training and test.")] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Processes; 1 if not given.")
    ] = None,
    engine: Annotated[str, typer.Option("--engine", help="local, or ray: all of a Ray cluster.")] = "local",
    shards: Annotated[
        str | None,
        typer.Option("--shards", metavar="A-B", help="Only these; others may run elsewhere at once."),
    ] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Say what it will take, and do nothing.")] = False,
    preset: Preset = [],  # noqa: B006
    assignments: Set = [],  # noqa: B006
    seed: Seed = None,
    fresh: Fresh = False,
) -> None:
    """Render scenes, label every frame, write sharded datasets."""
    from langwm_data.config import DatasetConfig
    from langwm_data.engines import check_engine
    from langwm_data.pipeline import render_dataset, render_range
    from langwm_data.plan import parse_shards
    from langwm_data.remote import is_url

    config = _load(DatasetConfig, "langwm_data", preset, assignments, {"frames": frames, "seed": seed})
    chosen = None if shards is None else parse_shards(shards)
    if fresh and chosen is not None:
        raise typer.BadParameter("--fresh would discard what other ranges make; give it without --shards")
    method = check_engine(engine, workers)
    if plan:
        from langwm_data.estimate import estimate

        typer.echo(estimate(config, workers=workers or 1, shards=chosen).as_text())
        return
    is_complete = True
    with _progress("frames") as progress:
        if chosen is None:
            render_dataset(config, out, workers=workers, engine=method, fresh=fresh, progress=progress)
        else:
            is_complete = render_range(config, out, chosen, workers=workers, engine=method, progress=progress)
    if not is_complete:
        typer.echo(f"shards {shards} are at {out}; the dataset is complete when the others are")
    elif is_url(out):
        typer.echo(f"dataset at {out}")
    else:
        typer.echo(f"dataset at {out}; look at it with: langwm inspect {out} --gallery gallery.html")


@app.command("inspect")
def inspect_command(
    data: Annotated[Path, typer.Argument(help="Dataset folder.")],
    key: Annotated[str | None, typer.Argument(help="Name of one frame; without it, the dataset.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", dir_okay=False, help="PNG of the frame, or .rrd with --rerun.")
    ] = None,
    gallery: Annotated[
        Path | None, typer.Option("--gallery", dir_okay=False, help="Write an HTML page of frames.")
    ] = None,
    plots: Annotated[
        Path | None, typer.Option("--plots", file_okay=False, help="Folder for histograms as PNG.")
    ] = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Show frames in the Rerun viewer.")] = False,
    count: Annotated[int, typer.Option("--count", min=1, help="Frames on the page or in the viewer.")] = 24,
) -> None:
    """Print what is in a dataset or in one frame of it; show frames with masks, depth and captions."""
    if key is not None and (gallery is not None or plots is not None):
        raise typer.BadParameter("--gallery and --plots are of the whole dataset; give them without a key")
    if out is not None and key is None and not rerun:
        raise typer.BadParameter("--out is for one frame or --rerun; give a key, --gallery or --plots")
    if rerun:
        from langwm_data.shards.rerun_view import import_rerun

        import_rerun()  # refused before anything is printed or written
    if key is not None:
        _inspect_frame(data, key, None if rerun else out)
    else:
        _inspect_dataset(data, gallery, plots, count)
    if rerun:
        from langwm_data.shards.dataset import ShardDataset
        from langwm_data.shards.gallery import spread
        from langwm_data.shards.rerun_view import show_frames

        dataset = ShardDataset(data)
        show_frames((dataset[which] for which in ([key] if key else spread(dataset, count))), out)


@app.command("export-coco")
def export_coco_command(
    data: Annotated[Path, typer.Argument(help="Dataset folder.")],
    out: Out,
    fresh: Fresh = False,
) -> None:
    """Write a dataset as COCO files: instances, panoptic segments, captions, images."""
    from langwm_data.shards.coco import export_coco

    with _progress("frames") as progress:
        path = export_coco(data, out, fresh=fresh, progress=progress)
    typer.echo(f"COCO files at {path}")


@app.command("verify")
def verify_command(
    data: Annotated[Path, typer.Argument(help="Dataset folder.")],
    ood: Annotated[bool, typer.Option("--ood", help="Prove instead that nothing held out leaked.")] = False,
    repair: Annotated[bool, typer.Option("--repair", help="Make what is damaged again.")] = False,
    rerender: Annotated[int, typer.Option("--rerender", min=0, help="Draw so many frames again.")] = 0,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes.")] = 1,
) -> None:
    """Look at every byte of a dataset; name the shard and key of whatever is wrong."""
    if ood and (repair or rerender):
        raise typer.BadParameter("--ood is a proof of its own; give it without --repair and --rerender")
    if ood:
        from langwm_data.shards.ood import verify_ood

        with _progress("frames") as progress:
            report = verify_ood(data, workers=workers, progress=progress)
    else:
        report = _verify(data, repair=repair, rerender=rerender, workers=workers)
    typer.echo(report.as_text())
    if not report.is_sound:
        raise typer.Exit(1)


@app.command("pretrain-mae")
def pretrain_mae_command(
    data: Annotated[Path, typer.Option("--data", help="Dataset from render-dataset.")],
    out: Out,
    steps: Steps = None,
    preset: Preset = [],  # noqa: B006
    assignments: Set = [],  # noqa: B006
    seed: Seed = None,
    fresh: Fresh = False,
) -> None:
    """Pretrain the masked autoencoder that fills in masked objects' depth from a caption."""
    from pretrain.config import PretrainConfig
    from pretrain.train import pretrain_mae

    config = _load(PretrainConfig, "pretrain", preset, assignments, {"steps": steps, "seed": seed})
    with _progress("steps") as progress:
        path = pretrain_mae(config, data, out, fresh=fresh, progress=progress)
    typer.echo(f"encoder at {path}")


@app.command("probe-mae")
def probe_mae_command(
    run: Annotated[Path, typer.Argument(help="Run of pretrain-mae, or its model.")],
    data: Annotated[
        list[Path],
        typer.Option("--data", help="Dataset; more, with less held out, to part what is unseen. Repeatable."),
    ],
    out: Out,
    frames: Annotated[int | None, typer.Option("--frames", help="Frames of each split, at most.")] = None,
    split: Annotated[str, typer.Option("--split", help="test or train: what the tables are about.")] = "test",
    beside: Annotated[
        Path | None, typer.Option("--beside", help="Another run, whose features are read as well.")
    ] = None,
    device: Annotated[str, typer.Option("--device", help="As PyTorch names it.")] = "cpu",
    seed: Seed = None,
    fresh: Fresh = False,
) -> None:
    """Measure what language does in an autoencoder and what its features know."""
    from langwm_data.config_io import build_config
    from pretrain.config import ProbeConfig
    from pretrain.probing.run import probe_mae

    first, *others = map(str, data)
    flags = {"run": str(run), "data": first, "others": others, "frames": frames, "split": split}
    flags |= {"beside": None if beside is None else str(beside), "device": device, "seed": seed}
    config = build_config(ProbeConfig, {name: value for name, value in flags.items() if value is not None})
    with _progress("frames") as progress:
        page = probe_mae(config, out, fresh=fresh, progress=progress)
    typer.echo(f"report at {page}")


@app.command("train-agent")
def train_agent_command(
    out: Out,
    system: Annotated[str, typer.Option("--system", help="Which agent.")] = "langwm",
    mae: Annotated[Path | None, typer.Option("--mae", help="Run of pretrain-mae.")] = None,
    data: Annotated[
        Path | None, typer.Option("--data", help="Dataset whose baked scenes are read, not made again.")
    ] = None,
    features: Annotated[str | None, typer.Option("--features", help="frozen or finetuned.")] = None,
    steps: Steps = None,
    plan: Annotated[bool, typer.Option("--plan", help="Say what it will take, and do nothing.")] = False,
    preset: Preset = [],  # noqa: B006
    assignments: Set = [],  # noqa: B006
    seed: Seed = None,
    fresh: Fresh = False,
) -> None:
    """Train an agent for PointGoal navigation, or for any environment (--set env.id=NAME)."""
    from agent.config.places import with_absolute_places
    from agent.systems.registry import check_means_something, load_agent_config
    from agent.train import train_agent

    flags: dict[str, Any] = {"mae": None if mae is None else str(mae), "features": features}
    flags |= {"steps": steps, "seed": seed}
    flags["env"] = None if data is None else {"scenes": {"baked": str(data)}}
    overrides = with_absolute_places(_overrides(flags, assignments))
    check_means_something(system, overrides)
    config = load_agent_config(system, presets=preset, overrides=overrides)
    if plan:
        from agent.plan import plan_training

        typer.echo(plan_training(config).as_text())
        return
    with _progress("environment steps") as progress:
        path = train_agent(config, out, fresh=fresh, progress=progress)
    if ":" in (config.env.id or ""):  # evaluate-agent imports no module that a run names
        way = f"from Python: agent.scoring.anywhere.evaluate_anywhere({str(path)!r}, env=gymnasium.make(...))"
    else:
        way = f"with: langwm evaluate-agent {path}"
    typer.echo(f"agent at {path}; score it {way}")


@app.command("evaluate-agent")
def evaluate_agent_command(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Runs of train-agent.")],
    split: Annotated[str, typer.Option("--split", help="train or test floors.")] = "test",
    episodes: Annotated[int | None, typer.Option("--episodes", min=1, help="Episodes on each floor.")] = None,
    episodes_file: Annotated[
        Path | None, typer.Option("--episodes-file", help="Play these: eval/episodes-SPLIT.json of any run.")
    ] = None,
    workers: Annotated[int, typer.Option("--workers", min=1, help="Processes; the rows are the same.")] = 1,
    videos: Annotated[
        int, typer.Option("--video", min=0, help="Episodes of each run to film, with maps of all floors.")
    ] = 0,
    device: Annotated[
        str, typer.Option("--device", help="Where agents compute, as PyTorch names it.")
    ] = "cpu",
    data: Annotated[
        Path | None, typer.Option("--data", help="Where the dataset of train-agent --data lies now.")
    ] = None,
) -> None:
    """Score agents on the same fixed episodes, beside random, straight-ahead, turn-to-goal and an oracle."""
    from agent.evaluate import EVAL_FOLDER, Plan, evaluate_runs

    if len(runs) == 1 and (split, episodes_file, workers, videos, data) == ("test", None, 1, 0, None):
        from agent.scoring.anywhere import evaluate_anywhere, is_elsewhere

        if is_elsewhere(runs[0]):
            with _progress("episodes") as progress:
                typer.echo(
                    evaluate_anywhere(runs[0], episodes=episodes, device=device, progress=progress).as_text()
                )
            typer.echo(f"rows at {runs[0] / EVAL_FOLDER}")
            return
    plan = Plan(
        split=split,
        episodes_per_scene=episodes,
        episodes_file=episodes_file,
        workers=workers,
        videos=videos,
        device=device,
        data=data,
    )
    with _progress("episodes") as progress:
        summary = evaluate_runs(runs, plan, progress=progress)
    typer.echo(summary.as_text())
    for run in runs:
        typer.echo(f"rows at {run / EVAL_FOLDER}")


@app.command("benchmark")
def benchmark_command(
    out: Out,
    systems: Annotated[
        str | None, typer.Option("--systems", metavar="a,b,c", help="All that need no download if not given.")
    ] = None,
    seeds: Annotated[str, typer.Option("--seeds", metavar="0-4", help="Of every learner.")] = "0",
    steps: Steps = None,
    engine: Annotated[str, typer.Option("--engine", help="local, or ray: one task for each cell.")] = "local",
    workers: Annotated[
        int | None,
        typer.Option("--workers", help="Cells at a time, in processes; one by one in this one if not given."),
    ] = None,
    mae: Annotated[
        list[str], typer.Option("--mae", metavar="[SYSTEM=]RUN", help="Run of pretrain-mae; repeatable.")
    ] = [],  # noqa: B006
    data: Annotated[Path | None, typer.Option("--data", help="Dataset whose baked scenes are read.")] = None,
    against: Annotated[
        str, typer.Option("--against", help="System that others are compared with.")
    ] = "langwm",
    episodes: Annotated[
        int | None, typer.Option("--episodes", min=1, help="On each test floor; may grow another time.")
    ] = None,
    plan: Annotated[bool, typer.Option("--plan", help="Say what it will take, and do nothing.")] = False,
    tables: Annotated[bool, typer.Option("--tables", help="Only write the tables anew.")] = False,
    preset: Preset = [],  # noqa: B006
    assignments: Set = [],  # noqa: B006
    fresh: Fresh = False,
) -> None:
    """Train and score systems x seeds; write the paper's Table 1 with curves, intervals and costs."""
    from agent.benchmark.grid import Request, make_grid
    from agent.benchmark.plan import plan_benchmark
    from agent.benchmark.report import write_reports
    from agent.benchmark.run import run_benchmark
    from langwm_data.engines import check_engine

    if tables:
        typer.echo(f"report at {write_reports(out, against)}")
        return
    flags: dict[str, Any] = {} if steps is None else {"steps": steps}
    if episodes is not None:
        flags["eval_episodes"] = episodes
    if data is not None:
        flags["env"] = {"scenes": {"baked": str(data)}}
    request = Request(systems=systems, seeds=seeds, mae=mae, against=against)
    grid = make_grid(request, presets=preset, flags=flags, assignments=assignments)
    method = check_engine(engine, workers)
    if plan:
        typer.echo(plan_benchmark(grid, out, engine=method, workers=workers or 1))
        return
    with _progress("steps and episodes") as progress:
        failed = run_benchmark(grid, out, engine=method, workers=workers, fresh=fresh, progress=progress)
    typer.echo(f"report at {out / 'report.html'}")
    if failed:
        _fail(f"{len(failed)} cells failed; the same command tries them again: {'; '.join(failed)}", 1)
        raise typer.Exit(1)


@app.command("demo")
def demo_command(
    out: Out = Path("demo"),
    workers: Annotated[int, typer.Option("--workers", min=1, help="Rendering processes.")] = 2,
    preset: Annotated[str, typer.Option("--preset", help="Size of all three stages.")] = "tiny",
    seed: Annotated[int, typer.Option("--seed", help="Seed of all three stages.")] = 0,
    fresh: Fresh = False,
) -> None:
    """Run all three stages and write report.html."""
    from agent.demo import run_demo

    report = run_demo(out, preset=preset, seed=seed, workers=workers, fresh=fresh, progress=_progress)
    typer.echo(f"report at {report}")


@app.command("doctor")
def doctor_command(
    furniture: Annotated[
        Path | None,
        typer.Option("--furniture", file_okay=False, help="Say what homes would use of these catalogues."),
    ] = None,
) -> None:
    """Say what this machine has and what is missing."""
    from agent.doctor import describe_furniture, diagnose

    if furniture is not None:
        typer.echo(describe_furniture(furniture))
        return
    lines = diagnose()
    for line in lines:
        typer.echo(f"{'ok  ' if line.is_ok else 'MISS'} {line.name}: {line.detail}")
    if not all(line.is_ok or line.is_optional for line in lines):
        raise typer.Exit(1)


def main() -> None:
    """Console script: run a command and turn what goes wrong into one sentence and an exit code."""
    level, levels = os.environ.get("LANGWM_LOG", "INFO"), logging.getLevelNamesMapping()
    if level.upper() not in levels:
        sys.exit(_fail(f"LANGWM_LOG {level!r} is no level; allowed: {', '.join(levels)}", 2))
    logging.basicConfig(level=level.upper(), format="%(message)s", stream=sys.stderr)
    for chatty in ("httpx", "transformers", "matplotlib"):
        logging.getLogger(chatty).setLevel(logging.ERROR)
    # Stages that hold something in memory save it on either signal; the others just stop.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(run(sys.argv[1:]))


_INTERRUPTED = 130
"""Exit code of what SIGINT ended."""


def run(arguments: list[str]) -> int:
    """Run one command line; the exit code."""
    try:
        code = int(app(args=arguments, prog_name="langwm", standalone_mode=False) or 0)
    except _UsageError as error:
        return _fail(error.format_message(), 2)  # pyright: ignore[reportAttributeAccessIssue]
    except ValueError as error:
        if not _is_ours(error):
            raise
        return _fail(str(error), 2)
    except OSError as error:
        return _fail(_explain_os_error(error), 1)
    except FloatingPointError as error:
        return _fail(f"training diverged: {error}", 1)
    except (KeyboardInterrupt, typer.Abort):
        code = _INTERRUPTED
    # Some versions of Typer raise on an interrupt, others return this code.
    return _fail("interrupted; the same command goes on from here", code) if code == _INTERRUPTED else code


def _inspect_dataset(data: Path, gallery: Path | None, plots: Path | None, count: int) -> None:
    from langwm_data.shards.gallery import write_gallery
    from langwm_data.shards.plots import write_plots
    from langwm_data.shards.summary import summarise

    typer.echo(summarise(data).as_text())
    if gallery is not None:
        write_gallery(data, gallery, count=count)
        typer.echo(f"gallery at {gallery}")
    if plots is not None:
        for path in write_plots(data, plots):
            typer.echo(f"plot at {path}")


def _inspect_frame(data: Path, key: str, out: Path | None) -> None:
    from langwm_data.shards.dataset import ShardDataset
    from langwm_data.shards.frame_picture import describe_frame, write_frame_picture

    dataset = ShardDataset(data)
    if key not in dataset.keys:
        raise typer.BadParameter(f"{str(data)!r} has no frame {key!r}; its first is {dataset.keys[0]!r}")
    typer.echo(describe_frame(dataset[key]))
    if out is not None:
        write_frame_picture(dataset[key], out)
        typer.echo(f"picture at {out}")


def _verify(data: Path, *, repair: bool, rerender: int, workers: int) -> "VerifyReport":
    """Verify, repair what was found where that is wanted, and verify what came of it."""
    from langwm_data.redraw import redraw_frames
    from langwm_data.repair import repair_dataset
    from langwm_data.shards.verify import verify_dataset

    def verify() -> "VerifyReport":
        with _progress("frames") as progress:
            report = verify_dataset(data, workers=workers, progress=progress)
        if report.is_sound and rerender:
            with _progress("frames drawn again") as progress:
                again = redraw_frames(data, rerender, progress=progress)
            report = report.with_redrawn(min(rerender, report.frames), again)
        return report

    report = verify()
    for _ in range(2 if repair else 0):  # some things can be seen only where others are repaired
        if report.is_sound:
            break
        typer.echo("\n".join(map(str, report.findings)))
        with _progress("shards made again") as progress:
            for name in repair_dataset(data, report.findings, progress=progress):
                typer.echo(f"repaired: {name}")
        report = verify()
    return report


def _load(cls: type[T], package: str, presets: list[str], assignments: list[str], flags: dict[str, Any]) -> T:
    """Presets, then flags and --set."""
    return load_config(cls, package, presets=presets, overrides=_overrides(flags, assignments))


def _overrides(flags: dict[str, Any], assignments: list[str]) -> dict[str, Any]:
    """Flags that were given, then --set, which is the most explicit of all."""
    overrides = {name: value for name, value in flags.items() if value is not None}
    for text in assignments:
        overrides = merge(overrides, parse_assignment(text))
    return overrides


def _fail(message: str, code: int) -> int:
    typer.echo(f"langwm: {' '.join(message.split())}", err=True)
    return code


def _is_ours(error: ValueError) -> bool:
    """Whether our own code raised it: then it is a sentence for the user, else a mistake of ours."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    raiser = frames[-1].f_globals.get("__name__", "")
    return raiser.partition(".")[0] in {"langwm_data", "pretrain", "agent", "cli"}


def _explain_os_error(error: OSError) -> str:
    what = os.strerror(error.errno) if error.errno else str(error)
    place = error.filename2 or error.filename  # of a rename it is the second that was asked for
    where = f" at {str(place)!r}" if place else ""
    advice = "; make room, then give the same command again" if error.errno == errno.ENOSPC else ""
    return f"{what}{where}{advice}"


@contextlib.contextmanager
def _progress(unit: str) -> Iterator[Callable[[int, int], None]]:
    """A bar with rate and remaining time on a terminal, a plain line every ten seconds elsewhere."""
    if not sys.stderr.isatty():
        yield _PlainProgress(unit)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(unit)
        yield lambda done, total: bar.update(task, completed=done, total=total)


class _PlainProgress:
    """Progress as lines of text."""

    every_s = 10.0

    def __init__(self, unit: str) -> None:
        self.unit = unit
        self.start: tuple[float, int] | None = None
        self.last = -float("inf")

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        self.start = self.start or (now, done)
        if now - self.last < self.every_s and done < total:
            return
        self.last = now
        elapsed, advanced = now - self.start[0], done - self.start[1]
        rate = advanced / elapsed if elapsed > 0 else 0.0
        left = f", {(total - done) / rate:.0f} s left" if rate > 0 and done < total else ""
        typer.echo(f"{done}/{total} {self.unit}, {rate:.1f}/s{left}", err=True)


if __name__ == "__main__":
    main()
