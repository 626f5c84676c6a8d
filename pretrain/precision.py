"""In which numbers networks compute: fp32, or bf16 where the device has instructions for it.

On a CPU without them, as most laptops are, PyTorch computes bf16 products number by number, some sixty times
slower than fp32. What is begun with ``auto`` on one machine goes on elsewhere, with other roundings.
"""

import functools
import logging

import torch

from pretrain.config import Precision

log = logging.getLogger(__name__)

_FLAGS = ("avx512_bf16", "amx_bf16", "bf16")
"""Of CPUs, as PyTorch names them; the last is ARM's."""


def autocast(device: torch.device | str, precision: Precision) -> torch.autocast:
    """The context in which a network's forward pass runs; weights stay in fp32.

    Args:
        device: Where it runs.
        precision: ``auto`` is bf16 where ``has_bf16``, else fp32. ``bf16`` is obeyed everywhere, with a
            warning where it is slow.
    """
    device = torch.device(device)
    if precision == "bf16" and not has_bf16(device):
        _warn_once(device.type)
    is_bf16 = precision == "bf16" or (precision == "auto" and has_bf16(device))
    return torch.autocast(device.type, torch.bfloat16, enabled=is_bf16)


def has_bf16(device: torch.device | str) -> bool:
    """Whether a device multiplies matrices in bf16 by instructions of its own."""
    return _has_bf16(torch.device(device).type)


@functools.cache
def _has_bf16(kind: str) -> bool:
    if kind == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    if kind != "cpu" or not torch.backends.mkldnn.is_available():
        return False
    try:
        found = torch.cpu.get_capabilities()
    except AttributeError:  # an older PyTorch
        return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
    return any(found.get(flag, False) for flag in _FLAGS)


@functools.cache
def _warn_once(kind: str) -> None:
    log.warning("precision bf16 is slow here, because this %s has no instructions for it; try auto", kind)
