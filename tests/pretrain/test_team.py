"""Parts of a batch, and processes that share it, learn what one process learns from the whole."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
import torch
import yaml

from langwm_data.config_io import ConfigError, config_to_dict
from pretrain import LanguageGroundedMAE, parts, pretrain_mae
from pretrain.checkpoint import latest_checkpoint
from pretrain.config import OptimConfig, TextConfig
from pretrain.metrics import read_metrics
from pretrain.optim import Optimizer
from pretrain.team import Team, own_device
from pretrain.update import mae_update

RUN = """
import sys, yaml
from pathlib import Path
from langwm_data.config_io import build_config
from pretrain import pretrain_mae
from pretrain.config import PretrainConfig
config, data, out = sys.argv[1:]
pretrain_mae(build_config(PretrainConfig, yaml.safe_load(Path(config).read_text())), Path(data), Path(out))
"""


def launch(tmp_path, config, data, out):
    """Two processes under torchrun."""
    (tmp_path / "run.py").write_text(RUN)
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config_to_dict(config)))
    command = [
        sys.executable,
        "-m",
        "torch.distributed.run",
        "--nproc-per-node",
        "2",
        "--standalone",
    ]
    command += [str(tmp_path / "run.py"), str(tmp_path / "config.yaml"), str(data), str(out)]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.getcwd()}
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def config(pretrain_config):
    """Without dropout, whose random numbers differ from process to process."""
    return replace(pretrain_config, batch_size=8, mae=replace(pretrain_config.mae, dropout=0.0))


def losses(run):
    names = ("mae/depth_loss", "mae/grad_norm", "mae/mask_fraction", "mae/truncation_rate")
    return [[row["step"], *(row[name] for name in names)] for row in read_metrics(run)]


def test_two_processes_that_stop_when_asked_and_go_on_learn_what_one_learns(config, data_folder, tmp_path):
    out, endless = tmp_path / "team", replace(config, steps=5000, valid_every=5000, checkpoint_every=5000)
    process = launch(tmp_path, endless, data_folder, out)
    deadline = time.monotonic() + 120
    while not (out / "metrics.jsonl").is_file() or len(read_metrics(out)) < 3:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    done = int(latest_checkpoint(out).name.removeprefix("step-"))
    assert done >= 3
    process = launch(tmp_path, replace(endless, steps=done + 2), data_folder, out)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    alone = pretrain_mae(replace(config, steps=done + 2), data_folder, tmp_path / "alone")
    assert [row["step"] for row in read_metrics(out)] == list(range(1, done + 3))
    assert torch.tensor(losses(out)) == pytest.approx(torch.tensor(losses(alone)), rel=1e-4)
    ours, its = (LanguageGroundedMAE.from_pretrained(p) for p in (out, alone))
    for name, weight in ours.state_dict().items():
        torch.testing.assert_close(weight, its.state_dict()[name], rtol=1e-3, atol=1e-5, msg=name)


@pytest.mark.parametrize("parts", [2, 4])
def test_parts_add_up_to_the_whole(mae_config, text, make_batch, parts):
    batch = make_batch(mae_config, batch_size=8)
    found = []
    for accumulate in (1, parts):
        torch.manual_seed(0)
        model = LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)
        optimizer = Optimizer(model, OptimConfig(accumulate=accumulate, warmup_steps=0))
        metrics = mae_update(model, optimizer, batch, seed=0, step=0)
        found.append((metrics, torch.cat([p.detach().flatten() for p in model.parameters()])))
    (whole, weights), (split, same) = found
    for name in ("mae/depth_loss", "mae/reward_loss", "mae/grad_norm", "mae/mask_fraction"):
        assert split[name] == pytest.approx(whole[name], rel=1e-5)
    torch.testing.assert_close(weights, same, rtol=1e-4, atol=1e-6)


def test_parts_of_different_sizes_add_up_to_the_whole(mae_config, text, make_batch, monkeypatch):
    batch, found = make_batch(mae_config, batch_size=7), []
    for rows in (50, 2):
        monkeypatch.setattr(parts, "ROWS_AT_ONCE", rows)
        torch.manual_seed(0)
        model = LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)
        metrics = mae_update(model, Optimizer(model, OptimConfig(warmup_steps=0)), batch, seed=0, step=0)
        found.append({name: value for name, value in metrics.items() if "hidden" not in name})
    assert found[1] == pytest.approx(found[0], rel=1e-5)


def test_the_mean_of_weights_follows_and_resumes(config, data_folder, tmp_path):
    config = replace(config, optimizer=replace(config.optimizer, ema_decay=0.5))
    whole = pretrain_mae(config, data_folder, tmp_path / "whole")
    out = pretrain_mae(replace(config, steps=2), data_folder, tmp_path / "parts")
    pretrain_mae(config, data_folder, out)
    assert (out / "model" / "model.safetensors").read_bytes() == (
        whole / "model" / "model.safetensors"
    ).read_bytes()
    state = torch.load(latest_checkpoint(whole) / "state.pt", weights_only=True)["state"]
    mean = LanguageGroundedMAE.from_pretrained(whole).state_dict()["cls_token"]
    assert torch.equal(mean, state["average"]["cls_token"])
    assert not torch.equal(mean, state["mae"]["cls_token"])


def test_a_mean_is_what_its_formula_says(mae_config, text):
    from pretrain.average import WeightAverage

    model = LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)
    average = WeightAverage(model, 0.9)
    before = model.cls_token.detach().clone()
    with torch.no_grad():
        model.cls_token += 1
    average.follow(model)
    torch.testing.assert_close(average.model.cls_token, before + 0.1)
    assert WeightAverage(model, 0.0).model is model


def test_rows_are_shared_out_without_gaps():
    assert [row for r in range(4) for row in Team(rank=r, size=4).rows(12)] == list(range(12))


@pytest.mark.parametrize("changes", [{"batch_size": 7}, {"batch_size": 9}])
def test_uneven_shares_are_refused(config, data_folder, tmp_path, changes):
    optimizer = replace(config.optimizer, accumulate=2)
    sentence = r"batch_size \d must be a multiple of 2: optimizer\.accumulate 2 parts times 1 processes"
    with pytest.raises(ConfigError, match=sentence):
        pretrain_mae(replace(config, optimizer=optimizer, **changes), data_folder, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_each_process_has_a_device_of_its_own(monkeypatch):
    assert own_device("cuda") == "cuda"
    monkeypatch.setenv("LOCAL_RANK", "1")
    assert [own_device(name) for name in ("cuda", "cuda:0", "cpu")] == ["cuda:1", "cuda:0", "cpu"]
