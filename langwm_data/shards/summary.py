"""What is in a dataset, as numbers and as a page of text."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.compute as pc

from langwm_data.scenes.taxonomy import is_structure, phrase
from langwm_data.shards.dataset import ShardDataset

_BAR_WIDTH = 30


@dataclass(frozen=True, kw_only=True)
class DatasetSummary:
    """Counts, distances and disk use of one dataset."""

    path: str
    generator: str
    renderer: str
    image_size: tuple[int, int]
    """Height and width in pixels."""
    frames: dict[str, int]
    """By split."""
    scenes: dict[str, dict[str, int]]
    """Frames by split and scene."""
    categories: dict[str, int]
    """Visible instances by category, most frequent first; walls, floors and ceilings left out."""
    captions: int
    frames_without_caption: int
    distances: dict[int, int]
    """Captioned objects by whole metres, rounded down."""
    shards: int
    bytes_shards: int
    bytes_total: int

    def as_text(self) -> str:
        """A page for the terminal."""
        total = sum(self.frames.values())
        height, width = self.image_size
        lines = [
            f"{self.path}: {total} frames of {height} x {width} px, {self.shards} shards",
            f"made by {self.generator}, renderer {self.renderer}",
            f"disk: {format_size(self.bytes_total)}"
            f" ({format_size(self.bytes_shards / max(total, 1))} per frame)",
            f"captions: {self.captions}; frames without one: {self.frames_without_caption}",
        ]
        for split, scenes in self.scenes.items():
            floors = f"{len(scenes)} floor{'s' if len(scenes) > 1 else ''}"
            lines += ["", f"{split}: {self.frames[split]} frames on {floors}", *_bars(scenes)]
        names = {phrase(category): count for category, count in self.categories.items()}
        lines += ["", f"objects: {sum(names.values())} in {len(names)} categories", *_bars(names)]
        bins = {f"{low}-{low + 1} m": count for low, count in self.distances.items()}
        lines += ["", "distance of captioned objects", *_bars(bins)]
        return "\n".join(lines)


def summarise(path: Path | str) -> DatasetSummary:
    """Count what a dataset holds, from its manifest and index alone.

    Raises:
        DatasetError: If there is no finished dataset at ``path``, or it is damaged.
    """
    dataset = ShardDataset(path)
    manifest = dataset.manifest
    furniture = {name: n for name, n in manifest.categories.items() if not is_structure(name)}
    is_captioned = pc.call_function("list_value_length", [dataset.objects["captions"]]).to_numpy() > 0
    metres = np.floor(dataset.objects["distance_m"].to_numpy()[is_captioned]).astype(int)
    return DatasetSummary(
        path=str(path),
        generator=manifest.generator,
        renderer=manifest.renderer,
        image_size=(manifest.camera.height, manifest.camera.width),
        frames={name: split.frames for name, split in manifest.splits.items()},
        scenes={name: split.scenes for name, split in manifest.splits.items()},
        categories=dict(sorted(furniture.items(), key=lambda item: (-item[1], item[0]))),
        captions=manifest.captions,
        frames_without_caption=len(dataset.frames.filter(pc.field("num_captions") == 0)),
        distances=dict(enumerate(np.bincount(metres).tolist())),
        shards=len(manifest.shards),
        bytes_shards=sum(shard.bytes for shard in manifest.shards),
        bytes_total=sum(file.stat().st_size for file in dataset.path.rglob("*") if file.is_file()),
    )


def _bars(counts: dict[str, int]) -> list[str]:
    """One line per entry: name, count, and a bar in proportion to the largest."""
    if not counts:
        return []
    name_width, most = max(map(len, counts)), max(counts.values())
    count_width = len(str(most))
    return [
        f"  {name:<{name_width}}  {n:>{count_width}}  {'█' * round(_BAR_WIDTH * n / most)}".rstrip()
        for name, n in counts.items()
    ]


def format_size(num_bytes: float) -> str:
    """Bytes in the unit that fits, such as ``14.2 kB``."""
    for unit in ("B", "kB", "MB", "GB"):
        if num_bytes < 1000:
            return f"{num_bytes:.0f} B" if unit == "B" else f"{num_bytes:.1f} {unit}"
        num_bytes /= 1000
    return f"{num_bytes:.1f} TB"
