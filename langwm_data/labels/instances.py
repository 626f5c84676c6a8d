"""From an instance mask and depth to one label per visible instance."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Caption:
    """One template sentence with the slots it was filled from."""

    text: str
    template: int
    """1 to 7. Source: appendix, Language Templates."""
    rule: int
    """1 or 2, the direction rule."""
    direction: str
    distance: str


@dataclass(frozen=True, kw_only=True)
class ObjectLabel:
    """One visible instance. Pixels are edges: a box covers x1 <= x < x2 (exclusive), floats."""

    instance: int
    category: str
    model: str
    bbox_xyxy: tuple[float, float, float, float]
    center_px: tuple[float, float]
    """Centroid of the mask, x and y; a pixel's centre lies at .5."""
    area_px: int
    distance_m: float
    """Mean z-depth over the mask, clipped to ``LabelsConfig.max_depth_m`` first."""
    direction_rule1: str
    direction_rule2: str
    captions: tuple[Caption, ...]
    """Empty for surfaces and for objects too small to be named."""
