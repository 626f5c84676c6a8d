"""What this machine has of what the toolkit needs."""

import importlib.metadata
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from langwm_data.config import RenderConfig
from langwm_data.scenes.assets import cache_folder
from langwm_data.scenes.catalogue.offer import Furniture
from langwm_data.sim.bullet import import_pybullet
from langwm_data.sim.render import describe_renderer

REQUIRED = ("torch", "transformers", "opencv-python-headless", "pyarrow", "webdataset", "gymnasium")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line of the diagnosis."""

    name: str
    is_ok: bool
    detail: str
    is_optional: bool = False


def diagnose() -> list[Finding]:
    """Look for packages, physics, a renderer, text weights, cores and disk; nothing is written."""
    findings = [_package(name) for name in REQUIRED]
    findings.append(_try("pybullet", _pybullet))
    findings.append(_try("renderer", _renderer))
    findings.append(_try("text weights (minilm)", _text_weights))
    findings.append(_try("accelerator", _accelerator, is_optional=True))
    findings.append(_try("bf16", _bf16, is_optional=True))
    free = shutil.disk_usage(Path.cwd()).free
    findings.append(Finding(name="cores", is_ok=True, detail=str(os.cpu_count())))
    findings.append(
        Finding(name="free disk here", is_ok=free > 2e9, detail=f"{free / 1e9:.1f} GB (the demo takes 1 GB)")
    )
    return findings


def describe_furniture(folder: Path) -> str:
    """What homes would use of the catalogues in ``folder``, and by name what they would not, and why.

    Raises:
        ValueError: If there is no catalogue, or one is damaged.
    """
    return Furniture(folder, cache_folder()).report()


def _package(name: str) -> Finding:
    try:
        return Finding(name=name, is_ok=True, detail=importlib.metadata.version(name))
    except importlib.metadata.PackageNotFoundError:
        return Finding(name=name, is_ok=False, detail=f"not installed; pip install {name}")


def _try(name: str, look: Callable[[], str], *, is_optional: bool = False) -> Finding:
    try:
        return Finding(name=name, is_ok=True, detail=look(), is_optional=is_optional)
    except (ImportError, ValueError, RuntimeError) as error:
        return Finding(name=name, is_ok=False, detail=str(error), is_optional=is_optional)


def _pybullet() -> str:
    import_pybullet()
    return importlib.metadata.version("pybullet")


def _renderer() -> str:
    return describe_renderer(RenderConfig())


def _text_weights() -> str:
    from pretrain.language import minilm_folder

    minilm_folder()
    return "the published weights"


def _accelerator() -> str:
    import torch

    device = torch.accelerator.current_accelerator(check_available=True)
    if device is None:
        raise RuntimeError("none; everything runs on the CPU")
    return str(device)


def _bf16() -> str:
    import torch

    from pretrain.precision import has_bf16

    device = torch.accelerator.current_accelerator(check_available=True) or torch.device("cpu")
    if not has_bf16(device):
        raise RuntimeError(f"no instructions for it on this {device.type}; precision=auto computes in fp32")
    return f"on this {device.type}; precision=auto computes in it"
