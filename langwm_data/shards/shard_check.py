"""Look at one shard from its first byte to its last, and at its rows of the index.

Owns the order of the checks and what is skipped where an earlier one failed. What each check asks
stands in ``tar_walk``, ``checks`` and ``index_check``.
"""

import dataclasses
import hashlib
import re
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, islice
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, cast

from langwm_data.config import DatasetConfig
from langwm_data.config_io import build_config
from langwm_data.scenes.spec import Split
from langwm_data.shards.checks import (
    SceneRecord,
    camera_faults,
    chosen_caption_faults,
    identity_faults,
    label_faults,
    read_caption,
    read_images,
)
from langwm_data.shards.document import SampleDocument, parse_document
from langwm_data.shards.every_shard import ShardCheck
from langwm_data.shards.findings import WRONG_CHECKSUM, Finding, foreign
from langwm_data.shards.index import FRAMES_SCHEMA, OBJECTS_SCHEMA, frame_row, object_rows
from langwm_data.shards.index_check import RowReader, open_index, row_fault
from langwm_data.shards.leaks import sample_leaks
from langwm_data.shards.manifest import FRAMES_FILE, GENERATOR, OBJECTS_FILE, ShardRecord, read_manifest
from langwm_data.shards.plan_check import Place, PlanChecker
from langwm_data.shards.sample import CAPTION_KEY, META_KEY, DatasetError, Sample
from langwm_data.shards.scenes import read_scene
from langwm_data.shards.tar_walk import RawSample, walk_samples
from langwm_data.workers import Report

MAX_FINDINGS = 100
"""Of one shard; one with more is not read to its end."""

_CHUNK = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Rows:
    """What the index says of one sample."""

    before: dict[str, Any] | None
    """The row of the frame before it, where that was read."""
    frame: dict[str, Any]
    objects: list[dict[str, Any]] | None
    """Nothing where that table cannot be compared."""


@dataclass(kw_only=True)
class Walk:
    """How far a shard has been read."""

    record: ShardRecord
    number: int
    """Of the sample that comes now, in its split."""
    samples: int = 0
    """Read so far."""
    before: Place | None = None
    """Where the sample before it was taken; nothing where that is damaged."""

    def arrive(self, key: str) -> list[str]:
        """Take the number in the key of the next sample; whether it is the one that comes now."""
        expected = self.number + (self.samples > 0)
        text = key.rpartition("-")[2]
        self.number = int(text) if re.fullmatch(r"\d{6,18}", text, re.ASCII) else expected
        if self.number == expected:
            return []
        self.before = None
        return [f"it has number {self.number}; the one that comes here is {expected}"]


class HashingFile:
    """A file that is read once from start to end, and the SHA-256 of what was read."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._digest = hashlib.sha256()

    def read(self, size: int) -> bytes:
        """At most ``size`` bytes."""
        data = self._file.read(size)
        self._digest.update(data)
        return data

    def finish(self) -> str:
        """Read the rest; the SHA-256 of all."""
        while self.read(_CHUNK):
            pass
        return self._digest.hexdigest()


class ShardChecker:
    """Looks at shards of one dataset, in ascending order because rows of the index are read once.

    Args:
        folder: The dataset.
        scenes: Names of its scenes that are sound.
    """

    def __init__(self, folder: Path, scenes: frozenset[str]) -> None:
        self._folder = folder
        self._sound_scenes = scenes
        self._manifest = read_manifest(folder)
        self._config = build_config(DatasetConfig, self._manifest.config)
        self._scenes: dict[str, SceneRecord] = {}
        self._plans: dict[str, PlanChecker] = {}

    def __call__(self, task: ShardCheck, report: Report) -> list[dict[str, str]]:
        """The findings as JSON; ``report`` hears of every frame."""
        findings = list(islice(self._check(task, report), MAX_FINDINGS + 1))
        if len(findings) > MAX_FINDINGS:
            what = f"more than {MAX_FINDINGS} things are wrong; the rest of it was not looked at"
            findings[-1] = Finding(where=task.record.path, what=what)
        return [dataclasses.asdict(finding) for finding in findings]

    def _check(self, task: ShardCheck, report: Report) -> Iterator[Finding]:
        record, where = task.record, task.record.path
        path = self._folder / where
        if not path.is_file():
            yield Finding(where=where, what="is not a plain file" if path.exists() else "is missing")
            return
        if (size := path.stat().st_size) != record.bytes:
            yield Finding(where=where, what=f"has {size} bytes; the manifest says {record.bytes}")
        rows, of_rows = self._rows(task), []
        walk = Walk(record=record, number=self._first_number(record))
        with path.open("rb") as raw:
            file = HashingFile(raw)
            try:
                for sample in walk_samples(file.read):
                    of_rows += yield from self._check_sample(sample, walk, next(rows, None))
                    walk.samples += 1
                    report(1)
            except DatasetError as error:
                yield Finding(where=where, what=str(error))
            if walk.samples != record.samples:
                what = f"has {walk.samples} samples; the manifest says {record.samples}"
                yield Finding(where=where, what=what)
            if file.finish() != record.sha256:
                yield Finding(where=where, what=WRONG_CHECKSUM)
            else:  # else the index is of another shard than the one that is there
                yield from of_rows

    def _first_number(self, record: ShardRecord) -> int:
        """Number in its split of a shard's first frame."""
        return int(Path(record.path).stem.rpartition("-")[2]) * self._config.shards.samples_per_shard

    def _check_sample(
        self, raw: RawSample, walk: Walk, rows: Rows | None
    ) -> Generator[Finding, None, list[Finding]]:
        """Yield what is wrong with a sample; return what is wrong with its rows of the index."""
        shard = walk.record.path
        if walk.samples == 0 and rows is not None and rows.before is not None:
            walk.before = Place.of_row(rows.before)
        faults = walk.arrive(raw.key)
        sample = None
        try:
            sample, more = self._open_sample(raw, walk)
        except DatasetError as error:
            more = [str(error)]
        for fault in [*faults, *more]:
            yield Finding(where=shard, key=raw.key, what=fault)
        walk.before = Place.of_document(sample.meta) if sample else None
        if sample is None or rows is None:
            return []
        return list(_row_findings(rows, sample, shard, raw.places))

    def _open_sample(self, raw: RawSample, walk: Walk) -> tuple[Sample | None, list[str]]:
        """The sample where its files can be trusted, and what is wrong with it.

        Raises:
            DatasetError: If one of its files cannot be read.
        """
        if raw.faults:
            return None, raw.faults
        rgb, depth, instance = read_images(raw.files, self._manifest.camera)
        document = parse_document(raw.files[META_KEY])
        split = walk.record.split
        if faults := self._document_faults(raw.key, document, split):
            return None, faults
        if document["scene"] not in self._sound_scenes:
            return None, []
        sample = Sample(
            key=raw.key,
            rgb=rgb,
            depth=depth,
            instance=instance,
            meta=cast(dict[str, Any], document),
            caption=read_caption(raw.files[CAPTION_KEY]),
        )
        planned = self._plan(document["scene"]).faults(document, split, walk.number, walk.before)
        return sample, planned + self._truth_faults(sample, document)

    def _document_faults(self, key: str, document: SampleDocument, split: Split) -> list[str]:
        """What the document says without a look at the images."""
        name, record = document["scene"], self._manifest.splits.get(split)
        if record is None or name not in record.scenes:
            return [f"scene {foreign(name)} is no scene of the {split} split"]
        faults = camera_faults(document, self._manifest.camera, self._config.camera) + sample_leaks(
            document, split, holds_out=self._manifest.holds_out
        )
        if name in self._sound_scenes:  # whoever checks the scenes names the others
            faults += identity_faults(key, document, split, self._scene(name))
        return faults

    def _truth_faults(self, sample: Sample, document: SampleDocument) -> list[str]:
        """Whether labels and captions are what the images say."""
        scene, objects = self._scene(document["scene"]), document["objects"]
        return [
            *label_faults(sample, objects, scene, self._config.labels),
            *chosen_caption_faults(sample.caption, objects),
        ]

    def _scene(self, name: str) -> SceneRecord:
        """A sound scene, read once."""
        if name not in self._scenes:
            self._scenes[name] = SceneRecord.of(read_scene(self._folder, name))
        return self._scenes[name]

    def _plan(self, name: str) -> PlanChecker:
        """What is planned for the frames of a sound scene."""
        if name not in self._plans:
            scene = read_scene(self._folder, name)
            draws_again = self._manifest.generator == GENERATOR
            self._plans[name] = PlanChecker(self._config, scene, draws_again=draws_again)
        return self._plans[name]

    def _rows(self, task: ShardCheck) -> Iterator[Rows]:
        """The index's rows of each sample in turn; none where the index cannot be compared."""
        if task.frames is None:
            return
        if task.objects is None:
            for before, frame in self._frames.take(task.frames):
                yield Rows(before=before, frame=frame, objects=None)
            return
        groups = groupby((row for _, row in self._objects.take(task.objects)), itemgetter("key"))
        group = next(groups, None)
        for before, frame in self._frames.take(task.frames):
            objects = []
            if group is not None and group[0] == frame["key"]:
                objects, group = list(group[1]), next(groups, None)
            yield Rows(before=before, frame=frame, objects=objects)

    @cached_property
    def _frames(self) -> RowReader:
        return RowReader(open_index(self._folder / FRAMES_FILE, FRAMES_SCHEMA, self._manifest.frames))

    @cached_property
    def _objects(self) -> RowReader:
        return RowReader(open_index(self._folder / OBJECTS_FILE, OBJECTS_SCHEMA, self._manifest.objects))


def _row_findings(
    rows: Rows, sample: Sample, shard: str, places: Mapping[str, tuple[int, int]]
) -> Iterator[Finding]:
    """Whether the index says of a sample what it would say if it were made now."""
    if fault := row_fault(rows.frame, frame_row(sample, shard, places)):
        yield Finding(where=FRAMES_FILE, key=sample.key, what=fault)
    if rows.objects is None:
        return
    made = object_rows(sample)
    if len(made) != len(rows.objects):
        what = f"it has {len(rows.objects)} rows; the sample has {len(made)} objects"
        yield Finding(where=OBJECTS_FILE, key=sample.key, what=what)
        return
    for found, again in zip(rows.objects, made, strict=True):
        if fault := row_fault(found, again):
            what = f"object {again['instance']}: {fault}"
            yield Finding(where=OBJECTS_FILE, key=sample.key, what=what)
