"""Random changes to stacks of frames for systems that learn from pixels. Pure functions of tensors.

All frames of a stack are changed alike. Nothing is flipped or turned, for that would also change what a
bearing means.

Source: CURL and RAD.
"""

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, UInt8
from torch import Tensor

from agent.config import SACConfig

CUTOUT_SHARE = (10 / 84, 30 / 84)
"""Least and largest edge of a cutout as a share of the frame's shorter edge. Source: RAD, 10 to 30 of 84."""
JITTER = (0.4, 0.4, 0.4, 0.5)
"""Largest change of brightness, contrast, saturation and hue. Source: RAD."""
_LUMA = (0.2989, 0.587, 0.114)

Frames = UInt8[Tensor, "B S H W 3"]
Pixels = Float[Tensor, "B S 3 h w"]
"""In [0, 1]."""


def view_size(config: SACConfig, height: int, width: int) -> tuple[int, int]:
    """Height and width of what the encoder sees of frames of this size."""
    share = 1.0
    if "crop" in config.data_augs:
        share = config.crop_share
    elif "translate" in config.data_augs:
        share = config.translate_share
    if share == 1.0:
        return height, width
    rows, columns = (4 * math.ceil(share * edge / 4) for edge in (height, width))
    return (min(rows, height), min(columns, width)) if share < 1 else (rows, columns)


def central_view(frames: Frames, config: SACConfig) -> Pixels:
    """What is seen without chance: the middle of the frames, or the frames amid the canvas."""
    height, width = frames.shape[2:4]
    rows, columns = view_size(config, height, width)
    top, left = abs(height - rows) // 2, abs(width - columns) // 2
    if rows > height or columns > width:
        return _as_pixels(F.pad(frames, (0, 0, left, columns - width - left, top, rows - height - top)))
    return _as_pixels(frames[:, :, top : top + rows, left : left + columns])


def random_view(
    frames: Frames, config: SACConfig, generator: torch.Generator, places: Int[Tensor, "B 2"] | None = None
) -> tuple[Pixels, Int[Tensor, "B 2"] | None]:
    """Every augmentation of ``config.data_augs`` in its order.

    Args:
        frames: As they were seen.
        config: Which augmentations, and how strong.
        generator: Source of chance, on the device of ``frames``.
        places: Offsets of an earlier view, for this one to have the same; ``translate`` alone can.

    Returns:
        The view, and the offsets of ``translate`` where it was used.
    """
    view, places = _place(frames, config, generator, places)
    pixels = _as_pixels(view)
    for name in config.data_augs:
        if name == "grayscale":
            pixels = random_grayscale(pixels, config.grayscale_probability, generator)
        elif name == "cutout":
            pixels = cutout(pixels, generator)
        elif name == "color_jitter":
            pixels = color_jitter(pixels, generator)
    return pixels, places


def random_pair(
    frames: Frames, next_frames: Frames, config: SACConfig, generator: torch.Generator
) -> tuple[Pixels, Pixels]:
    """Views of an observation and of the next one.

    Each is augmented by itself, but ``translate`` puts both in the same place. Source: CURL, RAD.
    """
    view, places = random_view(frames, config, generator)
    return view, random_view(next_frames, config, generator, places)[0]


def _place(
    frames: Frames, config: SACConfig, generator: torch.Generator, places: Int[Tensor, "B 2"] | None
) -> tuple[UInt8[Tensor, "B S h w 3"], Int[Tensor, "B 2"] | None]:
    size = view_size(config, *frames.shape[2:4])
    if "crop" in config.data_augs:
        return random_crop(frames, size, generator), None
    if "pad_crop" in config.data_augs:
        p = config.padding_px
        flat = frames.flatten(0, 1).permute(0, 3, 1, 2)
        padded = F.pad(flat.float(), (p, p, p, p), mode="replicate").to(torch.uint8)
        return random_crop(padded.permute(0, 2, 3, 1).unflatten(0, frames.shape[:2]), size, generator), None
    if "translate" in config.data_augs:
        return translate(frames, size, generator, places)
    return frames, None


def random_crop(
    frames: Frames, size: tuple[int, int], generator: torch.Generator
) -> UInt8[Tensor, "B S h w 3"]:
    """Of each stack a window of that size at a place of its own."""
    height, width = size
    places = _random_places(frames, (frames.shape[2] - height, frames.shape[3] - width), generator)
    # One slice for each stack: on a CPU a sixtieth of the time that one gather for all of them takes.
    pairs = zip(frames, places.tolist(), strict=True)
    return torch.stack([stack[:, y : y + height, x : x + width] for stack, (y, x) in pairs])


def translate(
    frames: Frames, size: tuple[int, int], generator: torch.Generator, places: Int[Tensor, "B 2"] | None
) -> tuple[UInt8[Tensor, "B S h w 3"], Int[Tensor, "B 2"]]:
    """Each stack on a black canvas of that size, at ``places`` or wherever chance puts it; also where."""
    height, width = frames.shape[2:4]
    if places is None:
        places = _random_places(frames, (size[0] - height, size[1] - width), generator)
    canvas = frames.new_zeros(*frames.shape[:2], *size, 3)
    for place, stack, (y, x) in zip(canvas, frames, places.tolist(), strict=True):
        place[:, y : y + height, x : x + width] = stack
    return canvas, places


def random_grayscale(pixels: Pixels, probability: float, generator: torch.Generator) -> Pixels:
    """Some stacks without their colours."""
    is_gray = torch.rand(len(pixels), generator=generator, device=pixels.device) < probability
    luma = pixels.new_tensor(_LUMA)[:, None, None]
    gray = (pixels * luma).sum(2, keepdim=True).expand_as(pixels)
    return torch.where(is_gray[:, None, None, None, None], gray, pixels)


def cutout(pixels: Pixels, generator: torch.Generator) -> Pixels:
    """A black box somewhere in each stack."""
    height, width = pixels.shape[-2:]
    low, high = (share * min(height, width) for share in CUTOUT_SHARE)
    chance = torch.rand(4, len(pixels), generator=generator, device=pixels.device)
    edges = low + chance[:2] * (high - low)
    starts = chance[2:] * (pixels.new_tensor([[height], [width]]) - edges)
    is_cut = [
        (axis >= start[:, None]) & (axis < (start + edge)[:, None])
        for axis, start, edge in zip(
            (torch.arange(n, device=pixels.device) for n in (height, width)), starts, edges, strict=True
        )
    ]
    box = is_cut[0][:, :, None] & is_cut[1][:, None]
    return pixels.masked_fill(box[:, None, None], 0.0)


def color_jitter(pixels: Pixels, generator: torch.Generator) -> Pixels:
    """Brightness, saturation and hue, then contrast, of each stack by amounts of its own."""
    chance = 2 * torch.rand(4, len(pixels), 1, 1, 1, generator=generator, device=pixels.device) - 1
    brightness, contrast, saturation = (1 + chance[i] * JITTER[i] for i in range(3))
    hue, colour, value = rgb_to_hsv(pixels).unbind(2)
    changed = [
        (hue + chance[3] * JITTER[3]) % 1,
        (colour * saturation).clamp(0, 1),
        (value * brightness).clamp(0, 1),
    ]
    rgb = hsv_to_rgb(torch.stack(changed, 2))
    mean = rgb.mean((-2, -1), keepdim=True)
    return (mean + (rgb - mean) * contrast[..., None]).clamp(0, 1)


def rgb_to_hsv(pixels: Pixels) -> Pixels:
    """Hue, saturation and value, each in [0, 1]."""
    value, most = pixels.max(2)
    spread = value - pixels.amin(2)
    red, green, blue = pixels.unbind(2)
    safe = torch.where(spread > 0, spread, 1.0)
    sectors: Sequence[Tensor] = [(green - blue) / safe % 6, (blue - red) / safe + 2, (red - green) / safe + 4]
    hue = torch.stack(list(sectors), 2).gather(2, most[:, :, None])[:, :, 0] / 6
    saturation = spread / torch.where(value > 0, value, 1.0)
    return torch.stack([hue, saturation, value], 2)


def hsv_to_rgb(hsv: Pixels) -> Pixels:
    """Inverse of ``rgb_to_hsv``."""
    hue, saturation, value = hsv.unbind(2)
    channels = []
    for shift in (5, 3, 1):
        k = (shift + 6 * hue) % 6
        channels.append(value - value * saturation * torch.minimum(k, 4 - k).clamp(0, 1))
    return torch.stack(channels, 2)


def _random_places(frames: Frames, room: tuple[int, int], generator: torch.Generator) -> Int[Tensor, "B 2"]:
    count, device = len(frames), frames.device
    drawn = [torch.randint(n + 1, (count,), generator=generator, device=device) for n in room]
    return torch.stack(drawn, 1)


def _as_pixels(frames: UInt8[Tensor, "B S h w 3"]) -> Pixels:
    return frames.permute(0, 1, 4, 2, 3).contiguous().float().div_(255)
