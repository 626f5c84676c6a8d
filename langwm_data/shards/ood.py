"""Prove from the shards that training shows nothing of what is held out for testing.

Owns the walk over all documents. What counts as a leak stands in ``leaks``; names of files, manifests and
the index are not asked, because they could say anything.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from langwm_data.scenes.spec import Split
from langwm_data.scenes.splits import EVERYTHING, HeldOut, check_models, describe_held_out, is_shared
from langwm_data.shards.document import parse_document
from langwm_data.shards.every_shard import ShardCheck, check_every_shard
from langwm_data.shards.findings import Finding, foreign
from langwm_data.shards.folder_check import check_places
from langwm_data.shards.leaks import Shown, sample_leaks
from langwm_data.shards.manifest import Manifest, ShardRecord, read_manifest
from langwm_data.shards.sample import META_KEY, DatasetError
from langwm_data.shards.scenes import SCENES_DIR, read_scene
from langwm_data.shards.shard_check import MAX_FINDINGS
from langwm_data.shards.tar_walk import RawSample, walk_samples
from langwm_data.workers import Report


@dataclass(frozen=True, kw_only=True)
class OodReport:
    """What the splits show, and what leaked."""

    shown: dict[Split, Shown]
    held_out_models: frozenset[str]
    findings: tuple[Finding, ...]
    holds_out: tuple[HeldOut, ...] = EVERYTHING
    """What its test frames do not share with training frames, as the dataset says: that is what is proved."""

    @property
    def is_sound(self) -> bool:
        """Whether nothing leaked and everything could be read."""
        return not self.findings

    def as_text(self) -> str:
        """The counts behind the verdict, each leak, and the verdict."""
        lines = [f"{split}: {shown.as_text()}" for split, shown in self.shown.items()]
        if len(self.shown) == 2:
            train, test = self.shown["train"], self.shown["test"]
            lines.append(
                f"in both: {len(train.buildings.keys() & test.buildings.keys())} buildings,"
                f" {len(train.textures.keys() & test.textures.keys())} textures,"
                f" {len(train.models.keys() & test.models.keys())} models"
                f" ({len(self.held_out_models)} models are held out)"
            )
        lines += map(str, self.findings)
        if self.is_sound:
            return "\n".join([*lines, self._proved()])
        return "\n".join([*lines, f"NOT PROVED: {len(self.findings)} findings"])

    def _proved(self) -> str:
        if self.holds_out == EVERYTHING:
            return "proved: no held-out building, model or texture appears in training"
        shared = [what for what in EVERYTHING if what not in self.holds_out]
        return (
            f"proved: test frames show {describe_held_out(self.holds_out)}, and share all else with training:"
            f" {', '.join(shared)}"
        )


def verify_ood(
    path: Path | str,
    *,
    held_out_models: frozenset[str] = frozenset(),
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> OodReport:
    """Read every document in every shard and compare what the two splits show.

    Args:
        path: Folder that holds ``dataset.json``.
        held_out_models: Models that only test frames may show, beside those of which a scene of the
            dataset says so. The procedural furniture holds out none: buildings of both splits choose from
            the same models.
        workers: Processes. More than one needs a script guarded by ``if __name__ == "__main__":``.
        progress: Called with frames done and frames in all.

    Raises:
        DatasetError: If there is no finished dataset at ``path``, or its manifest is damaged.
    """
    folder = Path(path)
    manifest = read_manifest(folder)
    findings = list(check_places(folder, manifest))
    holds_out = manifest.holds_out
    recorded, of_scenes = _recorded_models(folder, manifest)
    held_out_models, findings = held_out_models | recorded, findings + of_scenes
    if "models" in holds_out and holds_out != EVERYTHING and not recorded:
        findings.append(Finding(where=SCENES_DIR, what="no scene has a furniture model that is for test"))
    tasks = [ShardCheck(number=n, record=record) for n, record in enumerate(manifest.shards)]
    make_check = partial(OodChecker, folder, held_out_models, holds_out)
    shown: dict[Split, Shown] = {split: Shown() for split in manifest.splits}
    for task, answer in zip(tasks, check_every_shard(make_check, tasks, workers, progress), strict=True):
        findings += [Finding(**value) for value in answer["findings"]]
        shown.setdefault(task.record.split, Shown()).update(Shown(**answer["shown"]))
    if len(shown) == 2:
        findings += _in_both(shown["train"], shown["test"], holds_out)
    return OodReport(
        shown=shown, held_out_models=held_out_models, findings=tuple(findings), holds_out=holds_out
    )


def _recorded_models(folder: Path, manifest: Manifest) -> tuple[frozenset[str], list[Finding]]:
    """The models that some scene says are for test, and scenes that show what is not for their split."""
    held_out: set[str] = set()
    findings = []
    for name in dict.fromkeys(name for record in manifest.splits.values() for name in record.scenes):
        try:
            scene = read_scene(folder, name)
            held_out |= {record.model for record in scene.models if record.split == "test"}
            check_models(scene, manifest.holds_out)
        except ValueError as error:
            findings.append(Finding(where=f"{SCENES_DIR}/{foreign(name)[1:-1]}.json", what=str(error)[:300]))
    return frozenset(held_out), findings


class OodChecker:
    """Reads the documents of shards and says what they show and what of it is a leak."""

    def __init__(self, folder: Path, held_out_models: frozenset[str], holds_out: tuple[HeldOut, ...]) -> None:
        self._folder, self._held_out_models, self._holds_out = folder, held_out_models, holds_out

    def __call__(self, task: ShardCheck, report: Report) -> dict[str, Any]:
        """Findings and what is shown, as JSON."""
        shown = Shown()
        findings = list(islice(self._check(task.record, shown, report), MAX_FINDINGS))
        return {
            "findings": [dataclasses.asdict(finding) for finding in findings],
            "shown": dataclasses.asdict(shown),
        }

    def _check(self, record: ShardRecord, shown: Shown, report: Report) -> Iterator[Finding]:
        path = self._folder / record.path
        if not path.is_file():
            yield Finding(where=record.path, what="is not a plain file" if path.exists() else "is missing")
            return
        samples = 0
        try:
            with path.open("rb") as file:
                for samples, raw in enumerate(walk_samples(file.read), start=1):  # noqa: B007
                    for leak in self._sample_leaks(raw, record.split, shown):
                        yield Finding(where=record.path, key=raw.key, what=leak)
                    report(1)
        except DatasetError as error:
            yield Finding(where=record.path, what=str(error))
        if samples != record.samples:
            yield Finding(
                where=record.path, what=f"has {samples} samples; the manifest says {record.samples}"
            )

    def _sample_leaks(self, raw: RawSample, split: Split, shown: Shown) -> list[str]:
        if raw.faults:
            return raw.faults
        try:
            document = parse_document(raw.files[META_KEY])
        except DatasetError as error:
            return [str(error)]
        shown.add(document, raw.key)
        leaks = sample_leaks(document, split, self._held_out_models, self._holds_out)
        if document["split"] != split:
            leaks.append(f"split is {foreign(document['split'])} in a shard of {split}")
        return leaks


def _in_both(train: Shown, test: Shown, holds_out: tuple[HeldOut, ...]) -> list[Finding]:
    """Held-out buildings and textures that both splits show, by a test frame and a training frame that do.

    Materials of iGibson of which nothing is held out may be in both; in homes they are findings of their own.
    """
    return [
        Finding(
            where="train",
            key=tables[0][name],
            what=f"{kind[:-1]} {foreign(name)} is shown by test frame {tables[1][name]} too",
        )
        for kind, tables in (
            ("buildings", (train.buildings, test.buildings)),
            ("textures", (train.textures, test.textures)),
        )
        if kind in holds_out
        for name in sorted(tables[0].keys() & tables[1].keys())
        if kind == "buildings" or not is_shared(name.rpartition("/")[0])
    ]
