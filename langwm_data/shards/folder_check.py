"""What must be true of a dataset beside its shards: manifest, data card, configuration, scenes, files.

Owns the files that describe a dataset. Each is read only after a look at what kind of file it is and
how large.
"""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from langwm_data.config import DatasetConfig
from langwm_data.config_io import CONFIG_FILE, ConfigError, build_config
from langwm_data.fingerprint import fingerprint_of
from langwm_data.labels.semantic import CATEGORY_IDS
from langwm_data.scenes.splits import check_models, check_palette
from langwm_data.shards.card import card_head
from langwm_data.shards.findings import WRONG_CHECKSUM, Finding, foreign
from langwm_data.shards.manifest import (
    CARD_FILE,
    FRAMES_FILE,
    MANIFEST_FILE,
    OBJECTS_FILE,
    Manifest,
    manifest_text,
)
from langwm_data.shards.sample import MILLIMETRES, DatasetError
from langwm_data.shards.scenes import SCENES_DIR, read_scene, scene_path
from langwm_data.shards.writer import shard_path
from langwm_data.sim.camera import Camera

MAX_CARD_BYTES = 1 << 20
_MAX_HEAD, _MAX_BRACKETS = 1 << 16, 200
"""Of a card's YAML, 3 kB without brackets. PyYAML's time grows with the square of open brackets."""
MAX_SCENE_BYTES = 32 << 20
"""A furnished floor takes 150 kB."""


def check_folder(folder: Path, manifest: Manifest) -> list[Finding]:
    """Everything but the shards, the scenes and the rows of the index."""
    faults = manifest_faults(manifest)
    if (folder / MANIFEST_FILE).read_bytes() != manifest_text(manifest).encode():
        faults.append("it is not written as the generator writes it (space, order, names given twice)")
    findings = [Finding(where=MANIFEST_FILE, what=fault) for fault in faults]
    findings += check_places(folder, manifest)
    if fault := config_fault(folder / CONFIG_FILE, manifest):
        findings.append(Finding(where=CONFIG_FILE, what=fault))
    if fault := card_fault(folder / CARD_FILE, manifest):
        findings.append(Finding(where=CARD_FILE, what=fault))
    return findings


def check_scenes(folder: Path, manifest: Manifest) -> tuple[frozenset[str], list[Finding]]:
    """Names of the scenes that are sound, and what is wrong with the others."""
    sound, findings = set(), []
    for split, record in manifest.splits.items():
        for name in record.scenes:
            if fault := scene_fault(folder, name, split, manifest):
                findings.append(Finding(where=f"{SCENES_DIR}/{_file_name(name)}", what=fault))
            else:
                sound.add(name)
    return frozenset(sound), findings


def check_places(folder: Path, manifest: Manifest) -> Iterator[Finding]:
    """The folders hold the files of the dataset and nothing else, and lead nowhere else."""
    scenes = {_file_name(name) for record in manifest.splits.values() for name in record.scenes}
    expected = {SCENES_DIR: scenes, "index": {Path(FRAMES_FILE).name, Path(OBJECTS_FILE).name}}
    for shard in manifest.shards:
        expected.setdefault(shard.path.partition("/")[0], set()).add(Path(shard.path).name)
    for name, files in expected.items():
        if (folder / name).is_symlink():
            yield Finding(where=name, what="is a link to another folder")
        elif (folder / name).is_dir():
            for path in sorted((folder / name).iterdir()):
                if path.name not in files:
                    yield Finding(
                        where=f"{name}/{foreign(path.name)[1:-1]}", what="is no part of this dataset"
                    )


def manifest_faults(manifest: Manifest) -> list[str]:
    """Whether the numbers of a manifest agree with each other and with its configuration."""
    faults = []
    try:
        config = build_config(DatasetConfig, manifest.config)
    except ConfigError as error:
        return [f"its configuration is not one of this program: {str(error)[:300]}"]
    camera = Camera.on_robot(config.camera, (0.0, 0.0), 0.0)
    found = manifest.camera
    if (found.height, found.width, found.K) != (camera.height, camera.width, camera.intrinsics.tolist()):
        faults.append("its camera is not that of its configuration")
    if found.depth_unit_m != 1 / MILLIMETRES:
        faults.append(f"its depth_unit_m is {found.depth_unit_m!r}; allowed: {1 / MILLIMETRES}")
    for split, record in manifest.splits.items():
        of_split = [shard for shard in manifest.shards if shard.split == split]
        if [shard.path for shard in of_split] != [shard_path(split, n) for n in range(len(of_split))]:
            faults.append(f"its shards of {split} are not numbered from 0 on")
        counts = {record.frames, sum(record.scenes.values()), sum(shard.samples for shard in of_split)}
        if len(counts) > 1:
            faults.append(f"it counts the frames of {split} as {sorted(counts)}")
    if manifest.frames != sum(shard.samples for shard in manifest.shards):
        faults.append(f"it has {manifest.frames} frames; its shards have another number")
    if manifest.objects != sum(manifest.categories.values()):
        faults.append(f"it has {manifest.objects} objects; its categories have another number")
    return faults + _origin_faults(manifest)


def _origin_faults(manifest: Manifest) -> list[str]:
    """Whether its own words about how it was made give its fingerprint, and name the files that it has."""
    faults = []
    mark = fingerprint_of(
        manifest.config,
        sources=manifest.sources,
        physics=manifest.physics,
        renderer=manifest.renderer,
        generator=manifest.generator,
        schema_version=manifest.schema_version,
    )
    if mark != manifest.fingerprint:
        faults.append("its fingerprint is not that of its config, sources, physics, renderer and generator")
    scenes = {f"{SCENES_DIR}/{name}.json" for split in manifest.splits.values() for name in split.scenes}
    if wrong := sorted({*scenes, FRAMES_FILE, OBJECTS_FILE} ^ set(manifest.files)):
        faults.append(f"its files are not those of its scenes and index: {foreign(wrong[0])}")
    for name, number in manifest.category_ids.items():
        if CATEGORY_IDS.get(name) != number:
            faults.append(f"category_ids gives {foreign(name)} the number {number}; here it is another")
    return faults


def config_fault(path: Path, manifest: Manifest) -> str:
    """Whether ``config.yaml`` is the configuration in the manifest. Compared as text, never parsed."""
    expected = yaml.safe_dump(manifest.config, sort_keys=False).encode()
    if fault := _file_fault(path, len(expected)):
        return fault
    return "" if path.read_bytes() == expected else f"is not the configuration in {MANIFEST_FILE}"


def card_fault(path: Path, manifest: Manifest) -> str:
    """Whether the head of the data card gives Hugging Face the right files and types.

    The rest of the card is for people, who may change it.
    """
    if fault := _file_fault(path, MAX_CARD_BYTES):
        return fault
    expected = card_head(manifest)
    try:
        head = _head(path.read_bytes())
    except DatasetError as error:
        return str(error)
    wrong = [name for name in ("configs", "dataset_info") if head.get(name) != expected[name]]
    return f"its head has another {wrong[0]!r} than the shards need to load in Hugging Face" if wrong else ""


def scene_fault(folder: Path, name: str, split: str, manifest: Manifest) -> str:
    """Whether a baked scene is the one that was written, and for this split."""
    try:
        path = scene_path(folder, name)
        if fault := _file_fault(path, MAX_SCENE_BYTES):
            return fault
        scene = read_scene(folder, name)
        check_palette(scene, manifest.holds_out)
        check_models(scene, manifest.holds_out)
    except ValueError as error:
        return str(error).removeprefix(f"{folder / SCENES_DIR / name}.json: ")[:300]
    text = path.read_bytes()
    if json.dumps(json.loads(text), separators=(",", ":"), sort_keys=True).encode() != text:
        return "is not written as the generator writes it (space, order, names given twice)"
    if scene.split != split:
        return f"is a scene for {scene.split}; the manifest says {split}"
    sha256 = manifest.files.get(f"{SCENES_DIR}/{name}.json")
    return "" if hashlib.sha256(text).hexdigest() == sha256 else WRONG_CHECKSUM


def _file_fault(path: Path, limit: int) -> str:
    """Whether there is a plain file of at most ``limit`` bytes; a pipe would never end."""
    if not path.exists():
        return "is missing"
    if not path.is_file():
        return "is not a plain file"
    size = path.stat().st_size
    return f"has {size} bytes; allowed: {limit}" if size > limit else ""


class _PlainLoader(yaml.SafeLoader):
    """PyYAML's safe loader, which refuses aliases as well."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise DatasetError("its head has aliases")
        return super().compose_node(parent, index)


def _head(card: bytes) -> dict[str, Any]:
    """The YAML between the two lines ``---``.

    Raises:
        DatasetError: If there is none, or it is not plain YAML: aliases let a page stand for gigabytes.
    """
    try:
        _, head, _ = card.decode().split("---\n", 2)
        if len(head) > _MAX_HEAD or head.count("[") + head.count("{") > _MAX_BRACKETS:
            raise DatasetError("its head is longer or deeper than that of a data card")
        values = yaml.load(head, Loader=_PlainLoader)
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        if isinstance(error, DatasetError):
            raise
        raise DatasetError("it has no head of YAML between two lines ---") from error
    if not isinstance(values, dict):
        raise DatasetError("its head is not a table")
    return values


def _file_name(scene: str) -> str:
    return f"{foreign(scene)[1:-1]}.json"
