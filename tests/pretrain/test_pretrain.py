"""Training: learns, resumes to the same numbers, stops when asked, refuses what cannot work."""

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

import pretrain
from langwm_data.config_io import ConfigError, load_config_file
from pretrain import LanguageGroundedMAE, pretrain_mae, train
from pretrain.checkpoint import latest_checkpoint, save_checkpoint
from pretrain.config import AugmentConfig, ObjectMaskConfig, OptimConfig, PretrainConfig, TextConfig
from pretrain.metrics import read_metrics
from pretrain.optim import Optimizer, learning_rate_at
from pretrain.update import batch_rngs, mae_update, make_mae_batch


def losses(run):
    return [(row["step"], row["mae/depth_loss"], row.get("valid/depth_error_m")) for row in read_metrics(run)]


def weights(run):
    return (run / "model" / "model.safetensors").read_bytes()


@pytest.fixture
def whole(tmp_path, pretrain_config, data_folder):
    return pretrain_mae(pretrain_config, data_folder, tmp_path / "whole")


class Stop(Exception):
    """Stands for the end of the process."""


def test_killed_and_resumed_equals_uninterrupted(whole, pretrain_config, data_folder, tmp_path):
    def kill(done, total):
        if done == 3:
            raise Stop

    out = tmp_path / "killed"
    with pytest.raises(Stop):
        pretrain_mae(pretrain_config, data_folder, out, progress=kill)
    assert latest_checkpoint(out).name == "step-000000002"
    pretrain_mae(pretrain_config, data_folder, out)
    assert losses(out) == losses(whole)
    assert [row[0] for row in losses(out)] == [1, 2, 3, 4]
    assert weights(out) == weights(whole)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_saves_then_stops(whole, pretrain_config, data_folder, tmp_path, number):
    out = tmp_path / "stopped"
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt):
        pretrain_mae(
            pretrain_config,
            data_folder,
            out,
            progress=lambda done, _: done == 1 and os.kill(os.getpid(), number),
        )
    assert signal.getsignal(number) == before
    assert latest_checkpoint(out).name == "step-000000001"
    mae = LanguageGroundedMAE.from_pretrained(out)
    assert mae.intrinsics == ((30.0, 0.0, 24.0), (0.0, 30.0, 16.0), (0.0, 0.0, 1.0))
    pretrain_mae(pretrain_config, data_folder, out)
    assert losses(out) == losses(whole)
    assert weights(out) == weights(whole)


def test_a_longer_run_goes_on_from_a_finished_one(whole, pretrain_config, data_folder, tmp_path):
    out = pretrain_mae(replace(pretrain_config, steps=2), data_folder, tmp_path / "short")
    pretrain_mae(pretrain_config, data_folder, out)
    assert losses(out) == losses(whole)


def test_a_cosine_resumes_exactly_and_a_longer_run_follows_its_own_curve(
    pretrain_config, data_folder, tmp_path
):
    cosine = replace(pretrain_config.optimizer, schedule="cosine", warmup_steps=1)
    config = replace(pretrain_config, optimizer=cosine)

    def kill(done, total):
        if done == 3:
            raise Stop

    out = tmp_path / "killed"
    with pytest.raises(Stop):
        pretrain_mae(config, data_folder, out, progress=kill)
    pretrain_mae(config, data_folder, out)
    whole = pretrain_mae(config, data_folder, tmp_path / "whole")
    assert losses(out) == losses(whole)
    pretrain_mae(replace(config, steps=6), data_folder, out)
    rates = [row["mae/learning_rate"] for row in read_metrics(out)]
    lengths = [4] * 4 + [6] * 2
    assert rates == [learning_rate_at(cosine, step, length) for step, length in enumerate(lengths)]


def test_fewer_steps_than_were_done_change_nothing(whole, pretrain_config, data_folder):
    before = (whole / "config.yaml").read_text()
    pretrain_mae(replace(pretrain_config, steps=2), data_folder, whole)
    assert (whole / "config.yaml").read_text() == before


def test_a_step_is_saved_once(pretrain_config, data_folder, tmp_path, monkeypatch):
    saved = []
    monkeypatch.setattr(train, "save_checkpoint", lambda run, step, state: saved.append(step))
    pretrain_mae(replace(pretrain_config, steps=5), data_folder, tmp_path / "run")
    assert saved == [2, 4, 5]
    pretrain_mae(replace(pretrain_config, steps=4), data_folder, tmp_path / "other")
    assert saved == [2, 4, 5, 2, 4]


def test_a_finished_run_says_so_and_does_nothing(whole, pretrain_config, data_folder, caplog):
    before = {path: path.stat().st_mtime_ns for path in (whole / "model").iterdir()}
    with caplog.at_level("INFO"):
        pretrain_mae(pretrain_config, data_folder, whole)
    assert "has finished its 4 steps; --fresh starts over" in caplog.text
    assert {path: path.stat().st_mtime_ns for path in (whole / "model").iterdir()} == before


def test_what_a_run_leaves(whole, pretrain_config):
    assert load_config_file(PretrainConfig, whole / "config.yaml") == pretrain_config
    panel = cv2.imread(str(whole / "pictures" / "step-000000004.png"))
    assert panel.shape[0] > 4 * 32
    assert panel.shape[1] == 4 * (48 + 4)
    last = read_metrics(whole)[-1]
    assert {
        "mae/depth_loss",
        "mae/mask_fraction",
        "mae/truncation_rate",
        "mae/grad_norm",
        "perf/images_per_s",
        "perf/data_wait_share",
        "valid/hidden_depth_error_m",
        "valid/hidden_depth_error_m_no_caption",
    } <= set(last)
    model = LanguageGroundedMAE.from_pretrained(whole)
    assert model.text == pretrain_config.text
    assert model.null_embed.any()


def test_seeds_differ(whole, pretrain_config, data_folder, tmp_path):
    other = pretrain_mae(replace(pretrain_config, seed=1), data_folder, tmp_path / "other")
    assert losses(other) != losses(whole)


def test_global_generators_are_left_alone(pretrain_config, data_folder, tmp_path):
    torch.manual_seed(3)
    before = torch.get_rng_state()
    pretrain_mae(replace(pretrain_config, steps=1), data_folder, tmp_path / "run")
    assert torch.equal(torch.get_rng_state(), before)


def test_overfits_one_batch(mae_config, make_frames, text):
    torch.manual_seed(0)
    model = LanguageGroundedMAE(replace(mae_config, mask_ratio=0.25), TextConfig(), text.null_text)
    batch = make_mae_batch(
        batch_rngs(0, 0, range(4)), make_frames(4), text, ObjectMaskConfig(max_objects=1), None
    )
    config = OptimConfig(learning_rate=3e-3, warmup_steps=10)
    optimizer = Optimizer(model, config)
    found = [mae_update(model, optimizer, batch, seed=0, step=s) for s in range(160)]
    for name in ("mae/depth_loss", "mae/reward_loss"):  # token masks differ from step to step
        assert np.median([m[name] for m in found[-20:]]) < 0.1 * found[0][name]


def test_bf16_stays_close_to_fp32(mae_config, make_frames, text):
    found = []
    for precision in ("fp32", "bf16"):
        torch.manual_seed(0)
        model = LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)
        config = OptimConfig(precision=precision)
        batch = make_mae_batch(batch_rngs(0, 0, range(4)), make_frames(4), text, ObjectMaskConfig(), None)
        found.append(mae_update(model, Optimizer(model, config), batch, seed=0, step=0))
    assert found[0]["mae/depth_loss"] == pytest.approx(found[1]["mae/depth_loss"], rel=0.03)


def test_a_batch_depends_on_its_generator_alone(make_frames, text):
    first, second = (
        make_mae_batch(batch_rngs(0, 5, range(4)), make_frames(4), text, ObjectMaskConfig(), AugmentConfig())
        for _ in range(2)
    )
    assert first.captions == second.captions
    for name in ("rgb", "is_hidden", "depth"):
        assert torch.equal(getattr(first, name), getattr(second, name))
    assert first.rgb.dtype == torch.uint8


def test_hiding_leaves_colours_and_depth_alone(make_frames, text):
    frames = make_frames(4)
    batch = make_mae_batch(batch_rngs(0, 5, range(len(frames))), frames, text, ObjectMaskConfig(), None)
    assert np.array_equal(batch.rgb, frames.rgb)
    assert np.array_equal(batch.depth, frames.depth)
    assert batch.is_hidden.any(dim=(1, 2)).all()
    assert torch.equal(batch.reward, torch.from_numpy(frames.reward))


def test_another_configuration_in_the_same_place_is_refused(whole, pretrain_config, data_folder):
    with pytest.raises(ConfigError, match=r"another configuration: batch_size \(4 there, 2 asked for\)"):
        pretrain_mae(replace(pretrain_config, batch_size=2), data_folder, whole)


def test_another_dataset_in_the_same_place_is_refused(whole, pretrain_config, make_dataset, tmp_path):
    other = make_dataset(tmp_path / "data", fingerprint="b")
    before = (whole / "config.yaml").read_text()
    with pytest.raises(ConfigError, match="was trained on another dataset than --data"):
        pretrain_mae(replace(pretrain_config, steps=9), other, whole)
    assert (whole / "config.yaml").read_text() == before
    pretrain_mae(pretrain_config, other, whole, fresh=True)


def test_the_run_of_another_command_is_refused_in_a_short_sentence(pretrain_config, data_folder, tmp_path):
    save_checkpoint(tmp_path, 3, {"learner": 1})
    (tmp_path / "config.yaml").write_text("system: langwm\nsteps: 3\n")
    with pytest.raises(ConfigError, match=r"holds something else: .* give a new folder$"):
        pretrain_mae(pretrain_config, data_folder, tmp_path)


def test_fresh_does_not_remove_the_dataset_that_is_learned_from(
    whole, pretrain_config, make_dataset, tmp_path
):
    out = shutil.copytree(whole, tmp_path / "run")
    data = make_dataset(out / "pictures/data")
    with pytest.raises(ConfigError, match=r"--fresh would remove '.*/pictures/data', which this command"):
        pretrain_mae(pretrain_config, data, out, fresh=True)
    assert (data / "dataset.json").is_file()


def test_wrong_requests_leave_the_place_untouched(pretrain_config, data_folder, make_dataset, tmp_path):
    out = tmp_path / "run"
    wrong = [
        (pretrain_config, tmp_path / "nowhere", "no dataset at .*: the folder does not exist"),
        (pretrain_config, make_dataset(tmp_path / "d", num_train=0, num_test=2), "has no training frames"),
        (replace(pretrain_config, device="abacus"), data_folder, "device 'abacus' cannot be used"),
        (
            replace(pretrain_config, text=TextConfig(model=str(tmp_path))),
            data_folder,
            "is no BERT but of type None",
        ),
    ]
    for config, data, message in wrong:
        with pytest.raises(ConfigError, match=message):
            pretrain_mae(config, data, out)
        assert not out.exists()


def test_dataset_without_test_frames_trains_unwatched(pretrain_config, make_dataset, tmp_path, caplog):
    data = make_dataset(tmp_path / "data", num_train=5, num_test=0)
    with caplog.at_level("INFO"):
        out = pretrain_mae(replace(pretrain_config, steps=3, log_every=2), data, tmp_path / "run")
    assert "training goes unwatched" in caplog.text
    assert "valid/depth_error_m" not in read_metrics(out)[-1]
    assert [row["step"] for row in read_metrics(out)] == [1, 2, 3]


def test_import_of_the_package_is_light():
    code = "import sys, pretrain.config; print('torch' in sys.modules, 'transformers' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["False", "False"]


def test_package_exports_only_what_it_names():
    assert pretrain.pretrain_mae is train.pretrain_mae
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = pretrain.nothing


def test_a_dataset_without_captions_is_refused_where_language_is_wanted(
    pretrain_config, data_folder, tmp_path, monkeypatch
):
    monkeypatch.setattr("pretrain.dataset._objects_by_frame", lambda shards: [[] for _ in shards.keys])
    message = r"has no captions: no training frame shows .* or objects\.captions=none"
    with pytest.raises(ConfigError, match=message):
        pretrain_mae(pretrain_config, data_folder, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    objects = replace(pretrain_config.objects, captions="none")
    pretrain_mae(replace(pretrain_config, objects=objects), data_folder, tmp_path / "out")


def test_a_checkpoint_of_another_architecture_is_refused(pretrain_config, data_folder, tmp_path):
    small = replace(pretrain_config, mae=replace(pretrain_config.mae, dim=16))
    for name, config in (("own", pretrain_config), ("small", small)):
        pretrain_mae(replace(config, steps=2), data_folder, tmp_path / name)
    shutil.rmtree(tmp_path / "own/checkpoints")
    shutil.copytree(tmp_path / "small/checkpoints", tmp_path / "own/checkpoints")
    with pytest.raises(
        ConfigError, match=r"checkpoint, of step 2, is of another architecture than config\.yaml"
    ):
        pretrain_mae(pretrain_config, data_folder, tmp_path / "own")
