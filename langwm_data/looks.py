"""In which materials and lights a frame is shown: drawn from the seed and the frame's place in its split.

Any worker can draw them for any frame, and whoever has the configuration and the scene can draw them again.
"""

from langwm_data.config import DatasetConfig
from langwm_data.scenes.spec import MaterialRef, SceneSpec, Split
from langwm_data.scenes.splits import sample_palette, side_of
from langwm_data.seeding import make_rng
from langwm_data.sim.lights import Lights, sample_lights

Occasion = tuple[str | int, ...]
"""What a random choice was made for, as ``make_rng`` takes it."""


def palette_occasion(config: DatasetConfig, split: Split, number: int) -> Occasion:
    """What the materials of frame ``number`` of a split were drawn for."""
    return _occasion(config, "palette", config.randomize.palette, split, number)


def lights_occasion(config: DatasetConfig, split: Split, number: int) -> Occasion:
    """What the lights of frame ``number`` of a split were drawn for."""
    return _occasion(config, "lights", config.randomize.lights, split, number)


def _occasion(config: DatasetConfig, what: str, every: str, split: Split, number: int) -> Occasion:
    if every == "frame":
        return (what, "frame", split, number)
    return (what, split, number // config.cameras.frames_per_block) if every == "block" else (what,)


def draw_palette(
    config: DatasetConfig, occasion: Occasion, scene: SceneSpec, split: Split
) -> tuple[MaterialRef, ...]:
    """A material that ``split`` may show for every slot of ``scene``."""
    side = side_of(split, "textures", config.splits.holds_out)
    return sample_palette(make_rng(config.seed, *occasion), scene.slots, side, scene.pictures)


def draw_lights(config: DatasetConfig, occasion: Occasion) -> Lights:
    """Lights around those of ``render.lights``, or just these where they are fixed."""
    if config.randomize.lights == "fixed":
        return Lights.of(config.render.lights)
    return sample_lights(make_rng(config.seed, *occasion), config.render.lights, config.randomize)
