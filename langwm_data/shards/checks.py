"""What must be true of one sample: its images, its document, its labels, its captions.

Pure functions of bytes and of what the dataset says about itself. Each returns sentences; an empty list
means that nothing is wrong. Who reads shards and collects the sentences stands in ``verify``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from langwm_data.config import CameraConfig, LabelsConfig
from langwm_data.labels.captions import direction, format_distance
from langwm_data.labels.instances import ObjectLabel, label_frame
from langwm_data.labels.parse import parse_caption
from langwm_data.scenes.spec import InstanceName, MaterialSlot, SceneSpec, Split
from langwm_data.shards.document import CaptionDocument, ObjectDocument, SampleDocument
from langwm_data.shards.findings import foreign
from langwm_data.shards.manifest import CameraRecord
from langwm_data.shards.sample import (
    CAPTION_KEY,
    DEPTH_KEY,
    INSTANCE_KEY,
    RGB_KEY,
    DatasetError,
    Sample,
    to_metres,
)
from langwm_data.shards.strict_png import read_png
from langwm_data.sim.camera import Camera

MAX_CAPTION_BYTES = 1000

_MEASURED = ("category", "model", "phrase", "area_px", "direction_rule1", "direction_rule2")

_FRACTIONS = ("visible_fraction", "truncated_fraction", "occluded_fraction")

_TOLERANCE = 1e-6
"""Processors add up a mean in different orders."""


@dataclass(frozen=True, kw_only=True)
class SceneRecord:
    """What a sample has to agree with in its baked scene."""

    name: str
    building: str
    floor: int
    split: Split
    slots: tuple[MaterialSlot, ...]
    instances: Mapping[int, InstanceName]

    @classmethod
    def of(cls, scene: SceneSpec) -> Self:
        """What is compared of a scene."""
        return cls(
            name=scene.name,
            building=scene.building,
            floor=scene.floor,
            split=scene.split,
            slots=scene.slots,
            instances=scene.instances(),
        )


def read_images(
    files: Mapping[str, bytes], camera: CameraRecord
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.uint16]]:
    """Colour, depth in metres and instances.

    Raises:
        DatasetError: If one is not a plain PNG of the dataset's size and of the right depth.
    """
    size = camera.height, camera.width
    images = {}
    for name, shape, dtype in (
        (RGB_KEY, (*size, 3), np.uint8),
        (DEPTH_KEY, size, np.uint16),
        (INSTANCE_KEY, size, np.uint16),
    ):
        try:
            images[name] = read_png(files[name], shape, dtype)
        except DatasetError as error:
            raise DatasetError(f"{name} {error}") from error
    return images[RGB_KEY], to_metres(images[DEPTH_KEY]), images[INSTANCE_KEY]


def read_caption(data: bytes) -> str:
    """The content of ``txt``.

    Raises:
        DatasetError: If it is not UTF-8, or longer than any caption.
    """
    if len(data) > MAX_CAPTION_BYTES:
        raise DatasetError(f"{CAPTION_KEY} has {len(data)} bytes; allowed: {MAX_CAPTION_BYTES}")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise DatasetError(f"{CAPTION_KEY} is not UTF-8") from error


def identity_faults(key: str, document: SampleDocument, split: Split, scene: SceneRecord) -> list[str]:
    """Whether key, shard, document and scene name the same floor, split and building."""
    faults = []
    if key.rpartition("-")[0] != scene.name:
        faults.append(f"the document is of scene {foreign(scene.name)}, the key is of another")
    if document["split"] != split:
        faults.append(f"split is {foreign(document['split'])} in a shard of {split}")
    if (document["building"], document["floor"]) != (scene.building, scene.floor):
        found = f"{document['building']}, {document['floor']}"
        faults.append(
            f"building and floor are {foreign(found)}; scene {scene.name} is {scene.building}, {scene.floor}"
        )
    if len(document["palette"]) != len(scene.slots):
        faults.append(
            f"palette has {len(document['palette'])} materials; the scene has {len(scene.slots)} slots"
        )
        return faults
    for slot, text in zip(scene.slots, document["palette"], strict=True):
        if text.rpartition("/")[0] not in slot.categories:
            faults.append(
                f"slot {slot.name!r} holds {foreign(text)}; allowed categories: {', '.join(slot.categories)}"
            )
    return faults


def camera_faults(sample: SampleDocument, camera: CameraRecord, config: CameraConfig) -> list[str]:
    """Whether size and intrinsics are the dataset's, and the pose that of a camera on a robot somewhere."""
    document, faults = sample["camera"], []
    if (document["height"], document["width"], document["K"]) != (camera.height, camera.width, camera.K):
        faults.append("camera size or K is not that of the dataset")
    pose = np.array(document["camera_to_world"])
    again = Camera.on_robot(config, (float(pose[0, 3]), float(pose[1, 3])), document["yaw_rad"])
    if not np.allclose(pose, again.camera_to_world, rtol=0, atol=1e-9):
        faults.append(
            "camera_to_world is not the pose of yaw_rad, at the height and pitch of the configuration"
        )
    if not math.isclose(document["pitch_rad"], again.pitch_rad, rel_tol=0, abs_tol=1e-9):
        faults.append(f"pitch_rad is {document['pitch_rad']!r}; the configuration says {again.pitch_rad!r}")
    if sample["pose"] != [pose[0, 3], pose[1, 3], document["yaw_rad"]]:
        faults.append("pose is not the place and yaw of the camera")
    return faults


def label_faults(
    sample: Sample, objects: list[ObjectDocument], scene: SceneRecord, config: LabelsConfig
) -> list[str]:
    """Whether every object is in the scene's table and measures what its mask and depth say."""
    if unknown := sorted(_visible(sample.instance) - set(scene.instances)):
        return [f"{INSTANCE_KEY} shows id {unknown[0]}, which scene {scene.name} does not have"]
    # The generator only draws which template to use, and that is not compared.
    rng = np.random.default_rng(0)
    truth = {o.instance: o for o in label_frame(sample.instance, sample.depth, scene.instances, config, rng)}
    listed = [o["instance"] for o in objects]
    if listed != list(truth):
        wrong = sorted(set(listed) ^ set(truth))
        if not wrong:
            return ["objects are listed twice or not in the order of their ids"]
        return [f"objects {wrong[:10]} are listed but not in the mask, or in the mask but not listed"]
    faults = []
    for obj in objects:
        of = truth[obj["instance"]]
        faults += [f"object {of.instance}: {fault}" for fault in _object_faults(obj, of)]
        for caption in obj["captions"]:
            fault = caption_fault(caption, of, sample.instance.shape[1], config)
            faults += [f"object {of.instance}: {fault}"] if fault else []
    return faults


def caption_fault(caption: CaptionDocument, truth: ObjectLabel, width: int, config: LabelsConfig) -> str:
    """What a caption says that is not so; empty where all of it is true.

    The sentence is parsed, and what it says is compared with what was measured in mask and depth.
    """
    try:
        said = parse_caption(caption["text"])
    except ValueError as error:
        return str(error)
    rule = caption["rule"]
    if (said.template, said.direction, said.distance) != (
        caption["template"],
        caption["direction"],
        caption["distance"],
    ) or rule not in said.rules:
        return f"caption {foreign(caption['text'])} is not of the template, rule and slots beside it"
    if said.phrase != truth.phrase:
        return f"caption says {foreign(said.phrase)}; the mask shows a {truth.phrase}"
    if said.direction != (there := direction(truth.center_px[0], width, rule)):
        return f"caption says {said.direction}; by rule {rule} it is {there}"
    if said.distance != (far := format_distance(truth.distance_m, config.distance_format)):
        return f"caption says {said.distance}; by its depth it is {far}"
    return ""


def chosen_caption_faults(text: str, objects: list[ObjectDocument]) -> list[str]:
    """Whether ``txt`` is the caption of the largest captioned object, empty where there is none."""
    named = [o for o in objects if o["captions"]]
    largest = max(named, key=lambda o: o["area_px"], default=None)
    if text == (largest["captions"][0]["text"] if largest else ""):
        return []
    return [f"{CAPTION_KEY} {foreign(text)} is not the caption of the largest captioned object"]


def _visible(instance: NDArray[np.uint16]) -> set[int]:
    """Ids in the mask, without the background."""
    return set(np.flatnonzero(np.bincount(instance.ravel())).tolist()) - {0}


def _object_faults(obj: ObjectDocument, truth: ObjectLabel) -> list[str]:
    """Measured again, field by field."""
    pairs = {name: (obj[name], getattr(truth, name)) for name in _MEASURED}
    pairs |= {name: (tuple(obj[name]), getattr(truth, name)) for name in ("bbox_xyxy", "center_px")}
    faults = [
        f"{name} is {foreign(said)}; the mask says {measured!r}"
        for name, (said, measured) in pairs.items()
        if said != measured
    ]
    if not math.isclose(obj["distance_m"], truth.distance_m, rel_tol=0, abs_tol=_TOLERANCE):
        faults.append(f"distance_m is {obj['distance_m']!r}; mask and depth say {truth.distance_m!r}")
    visible, truncated, occluded = (obj[name] for name in _FRACTIONS)
    if min(visible, truncated, occluded) < 0 or abs(visible - (1 - truncated) * (1 - occluded)) > _TOLERANCE:
        faults.append(
            f"visible, truncated and occluded fractions {visible}, {truncated}, {occluded} do not fit"
        )
    if len(obj["captions"]) != len(truth.captions):
        faults.append(
            f"it has {len(obj['captions'])} captions; by its size and category {len(truth.captions)}"
        )
    return faults
