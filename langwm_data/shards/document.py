"""The JSON document of a sample: which names it has, of which types, and nothing else.

Owns the strict reading that ``verify`` does. ``frames`` fills the document, ``card`` declares the same
types for Hugging Face ``datasets``.
"""

import json
from typing import Annotated, TypeVar

from annotated_types import Len
from pydantic import ConfigDict, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from langwm_data.shards.sample import META_KEY, DatasetError

MAX_DOCUMENT_BYTES = 4 << 20
"""A view of a crowded home takes 20 kB."""

T = TypeVar("T")
Row3 = Annotated[list[float], Len(3, 3)]
Row4 = Annotated[list[float], Len(4, 4)]
Pair = Annotated[list[float], Len(2, 2)]

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, str_max_length=1000)


class CaptionDocument(TypedDict):
    """``labels.captions.Caption`` in JSON."""

    __pydantic_config__ = _STRICT  # pyright: ignore[reportGeneralTypeIssues]

    text: str
    template: int
    rule: int
    direction: str
    distance: str


class ObjectDocument(TypedDict):
    """``labels.instances.ObjectLabel`` in JSON."""

    __pydantic_config__ = _STRICT  # pyright: ignore[reportGeneralTypeIssues]

    instance: int
    category: str
    model: str
    phrase: str
    bbox_xyxy: Row4
    center_px: Pair
    area_px: int
    distance_m: float
    direction_rule1: str
    direction_rule2: str
    captions: list[CaptionDocument]
    visible_fraction: float
    truncated_fraction: float
    occluded_fraction: float


class CameraDocument(TypedDict):
    """``sim.camera.Camera`` in JSON: pixels, metres, radians."""

    __pydantic_config__ = _STRICT  # pyright: ignore[reportGeneralTypeIssues]

    height: int
    width: int
    K: Annotated[list[Row3], Len(3, 3)]
    camera_to_world: Annotated[list[Row4], Len(4, 4)]
    yaw_rad: float
    pitch_rad: float


class LightsDocument(TypedDict):
    """``sim.lights.Lights`` in JSON."""

    __pydantic_config__ = _STRICT  # pyright: ignore[reportGeneralTypeIssues]

    ambient: Row3
    sun: Row3
    lamp: Row3
    sun_direction: Row3


class SampleDocument(TypedDict):
    """One sample's ``json``."""

    __pydantic_config__ = _STRICT  # pyright: ignore[reportGeneralTypeIssues]

    scene: str
    building: str
    floor: int
    split: str
    palette: list[str]
    lights: LightsDocument
    trajectory: int
    step: int
    action: Pair
    pose: Row3
    camera: CameraDocument
    objects: list[ObjectDocument]


_ADAPTER = TypeAdapter(SampleDocument)


def parse_document(data: bytes) -> SampleDocument:
    """Read a document that has exactly the form in which it is written.

    What was read is written again and has to give the same bytes. That finds all that a parser passes
    over: names given twice, whole numbers where real ones belong, another order, added space.

    Raises:
        DatasetError: If it has another form; one sentence that says where.
    """
    if len(data) > MAX_DOCUMENT_BYTES:
        raise DatasetError(f"{META_KEY} has {len(data)} bytes; allowed: {MAX_DOCUMENT_BYTES}")
    try:
        document = _ADAPTER.validate_json(data)
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False)[0]
        where = ".".join(ascii(p).strip("'")[:40] for p in first["loc"])
        raise DatasetError(f"{META_KEY}: {where}{': ' if where else ''}{first['msg'][:200]}") from error
    if json.dumps(document, separators=(",", ":")).encode() != data:
        raise DatasetError(
            f"{META_KEY} is not written as the generator writes it (space, order, names, numbers)"
        )
    return document
