import logging
from pathlib import Path

import pytest
import torch
import yaml

import agent
import pretrain
from pretrain import precision
from pretrain.precision import autocast, has_bf16


@pytest.fixture
def cpu_with(monkeypatch):
    """Makes the CPU one that has, or has not, some instructions."""
    precision._has_bf16.cache_clear()
    precision._warn_once.cache_clear()

    def give(**found: bool) -> None:
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: found, raising=False)

    yield give
    precision._has_bf16.cache_clear()
    precision._warn_once.cache_clear()


def product_dtype(asked: precision.Precision) -> torch.dtype:
    x = torch.ones(2, 2)
    with autocast("cpu", asked):
        return (x @ x).dtype


@pytest.mark.parametrize("flag", ["avx512_bf16", "amx_bf16", "bf16"])
def test_auto_is_bf16_on_a_cpu_that_has_instructions_for_it(cpu_with, flag):
    cpu_with(**{flag: True})
    assert has_bf16("cpu") == torch.backends.mkldnn.is_available()
    assert product_dtype("auto") == (torch.bfloat16 if has_bf16("cpu") else torch.float32)


def test_auto_is_fp32_on_a_cpu_that_has_none(cpu_with, caplog):
    cpu_with(avx2=True, avx512_f=True, avx512_bf16=False)
    assert not has_bf16("cpu")
    assert product_dtype("auto") == torch.float32
    assert product_dtype("fp32") == torch.float32
    assert not caplog.records


def test_bf16_is_obeyed_everywhere_with_one_warning_where_it_is_slow(cpu_with, caplog):
    cpu_with(avx2=True)
    with caplog.at_level(logging.WARNING):
        assert product_dtype("bf16") == torch.bfloat16
        assert product_dtype("bf16") == torch.bfloat16
    assert [r.getMessage() for r in caplog.records] == [
        "precision bf16 is slow here, because this cpu has no instructions for it; try auto"
    ]


def test_fp32_is_fp32_also_where_bf16_is_fast(cpu_with):
    cpu_with(avx512_bf16=True)
    assert product_dtype("fp32") == torch.float32


def test_an_older_pytorch_is_asked_another_way(cpu_with, monkeypatch):
    monkeypatch.delattr(torch.cpu, "get_capabilities", raising=False)
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: True, raising=False)
    assert has_bf16("cpu") == torch.backends.mkldnn.is_available()
    precision._has_bf16.cache_clear()
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: False)
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: False, raising=False)
    assert not has_bf16("cpu")


def values(tree: object, name: str) -> list[object]:
    """Of all fields of that name in a tree of settings."""
    if not isinstance(tree, dict):
        return []
    return [
        found for key, value in tree.items() for found in ([value] if key == name else values(value, name))
    ]


def test_no_preset_asks_for_bf16_where_it_may_be_slow():
    folders = [Path(str(package.__path__[0])) / "presets" for package in (pretrain, agent)]
    presets = [path for folder in folders for path in folder.rglob("*.yaml")]
    found = [v for path in presets for v in values(yaml.safe_load(path.read_text()), "precision")]
    assert found
    assert "bf16" not in found
