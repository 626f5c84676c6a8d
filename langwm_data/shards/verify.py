"""Is a dataset what it says it is? Every byte of it is looked at, and whatever is wrong is named.

Owns who checks what: the folder in this process, the shards in as many as wanted, one sample in memory
at a time. What must hold stands in ``folder_check``, ``index_check``, ``tar_walk`` and ``checks``.
"""

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Self

from langwm_data.shards.asset_check import check_assets
from langwm_data.shards.every_shard import ShardCheck, check_every_shard
from langwm_data.shards.findings import Finding
from langwm_data.shards.folder_check import check_folder, check_scenes, manifest_faults
from langwm_data.shards.index_check import check_tables
from langwm_data.shards.manifest import MANIFEST_FILE, read_manifest
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.shard_check import ShardChecker


@dataclass(frozen=True, kw_only=True)
class VerifyReport:
    """What was found."""

    frames: int
    """Frames that the dataset claims to have."""
    shards: int
    findings: tuple[Finding, ...]
    redrawn: int = 0
    """Frames that were drawn again and compared."""

    @property
    def is_sound(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings

    def with_redrawn(self, count: int, more: Iterable[Finding]) -> Self:
        """The same report with what drawing so many frames again found."""
        return dataclasses.replace(self, redrawn=count, findings=(*self.findings, *more))

    def as_text(self) -> str:
        """One line for each finding, and one that sums up."""
        size = f"{self.frames} frames in {self.shards} shards"
        size += f", {self.redrawn} drawn again" if self.redrawn else ""
        if self.is_sound:
            return f"sound: {size}"
        return "\n".join([*map(str, self.findings), f"damaged: {len(self.findings)} findings in {size}"])


def verify_dataset(
    path: Path | str, *, workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> VerifyReport:
    """Look at everything in a dataset: manifest, card, scenes, index, and every byte of every shard.

    Args:
        path: Folder that holds ``dataset.json``.
        workers: Processes. More than one needs a script guarded by ``if __name__ == "__main__":``.
        progress: Called with frames done and frames in all.

    Raises:
        DatasetError: If there is no finished dataset at ``path``.
        ChildProcessError: If a worker process is killed.
    """
    folder = Path(path)
    try:
        manifest = read_manifest(folder)
    except DatasetError as error:
        if not (folder / MANIFEST_FILE).is_file():
            raise
        what = str(error).removeprefix(f"{folder / MANIFEST_FILE}: ")
        return VerifyReport(frames=0, shards=0, findings=(Finding(where=MANIFEST_FILE, what=what),))
    findings = check_folder(folder, manifest)
    if not manifest_faults(manifest):
        scenes, of_scenes = check_scenes(folder, manifest)
        plan, of_tables = check_tables(folder, manifest)
        tasks = [
            ShardCheck(number=n, record=r, frames=plan.frames.get(r.path), objects=plan.objects.get(r.path))
            for n, r in enumerate(manifest.shards)
        ]
        answers = check_every_shard(partial(ShardChecker, folder, scenes), tasks, workers, progress)
        findings += (
            of_scenes
            + check_assets(folder, scenes)
            + of_tables
            + [Finding(**value) for answer in answers for value in answer]
        )
    return VerifyReport(frames=manifest.frames, shards=len(manifest.shards), findings=tuple(findings))
