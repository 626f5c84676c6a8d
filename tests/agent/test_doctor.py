import importlib.metadata

import pytest

import agent.doctor as doctor
from langwm_data.config import RenderConfig
from langwm_data.sim.render import describe_renderer


def test_a_sound_machine_is_found_sound():
    findings = {finding.name: finding for finding in doctor.diagnose()}
    assert findings["torch"].is_ok
    assert findings["torch"].detail == importlib.metadata.version("torch")
    assert findings["renderer"].detail == describe_renderer(RenderConfig())


def test_what_is_missing_is_named_with_its_cure(monkeypatch):
    monkeypatch.setattr(doctor, "REQUIRED", ("no-such-package",))
    finding = doctor.diagnose()[0]
    assert (finding.name, finding.is_ok) == ("no-such-package", False)
    assert finding.detail == "not installed; pip install no-such-package"


@pytest.mark.parametrize("has", [True, False])
def test_it_says_in_which_numbers_auto_computes(monkeypatch, has):
    monkeypatch.setattr("pretrain.precision.has_bf16", lambda device: has)
    finding = next(f for f in doctor.diagnose() if f.name == "bf16")
    assert (finding.is_ok, finding.is_optional) == (has, True)
    assert ("computes in it" if has else "computes in fp32") in finding.detail


def test_a_part_that_does_not_open_is_named_with_its_reason(monkeypatch):
    def broken(config):
        raise ValueError("no picture")

    monkeypatch.setattr(doctor, "describe_renderer", broken)
    finding = next(f for f in doctor.diagnose() if f.name == "renderer")
    assert (finding.is_ok, finding.detail) == (False, "no picture")
