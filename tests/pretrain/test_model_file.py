"""The folder of a pretrained model: what is written is read, what is damaged is refused in a sentence."""

import json

import pytest
import torch
from full_disk import largest_file
from safetensors.torch import load_file, save_file

from pretrain import LanguageGroundedMAE
from pretrain.config import TextConfig


@pytest.fixture
def folder(tmp_path, mae_config, make_text):
    torch.manual_seed(0)
    model = LanguageGroundedMAE(mae_config, TextConfig(model="minilm"), make_text(1))
    model.save_pretrained(tmp_path / "run" / "model")
    return tmp_path / "run" / "model"


def test_round_trip_from_the_folder_and_from_the_run(folder, mae_config):
    rgb = torch.randint(0, 256, (2, mae_config.height, mae_config.width, 3), dtype=torch.uint8)
    first = LanguageGroundedMAE.from_pretrained(folder)
    second = LanguageGroundedMAE.from_pretrained(str(folder.parent))
    assert torch.equal(first.encode(rgb), second.encode(rgb))
    assert (first.config, first.text.model, first.training) == (mae_config, "minilm", False)


def test_saving_the_same_weights_twice_gives_the_same_bytes(folder, tmp_path):
    LanguageGroundedMAE.from_pretrained(folder).save_pretrained(tmp_path / "again")
    for name in ("config.json", "model.safetensors"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()


def test_what_the_system_refuses_to_write_leaves_the_old_model(folder, mae_config):
    before = LanguageGroundedMAE.from_pretrained(folder)
    with largest_file(10_000), pytest.raises(OSError, match="File too large"):
        before.save_pretrained(folder)
    after = LanguageGroundedMAE.from_pretrained(folder).state_dict()
    assert all(torch.equal(w, after[name]) for name, w in before.state_dict().items())


def test_missing_model_is_refused(tmp_path):
    with pytest.raises(ValueError, match="holds no pretrained autoencoder"):
        LanguageGroundedMAE.from_pretrained(tmp_path)


def test_truncated_weights_are_refused(folder):
    path = folder / "model.safetensors"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match=r"model.safetensors cannot be read"):
        LanguageGroundedMAE.from_pretrained(folder)


def test_weights_of_another_architecture_are_refused(folder):
    path = folder / "model.safetensors"
    tensors = load_file(path)
    save_file({name: t for name, t in tensors.items() if name != "cls_token"}, path)
    with pytest.raises(ValueError, match=r"does not fit its config.json: cls_token is missing"):
        LanguageGroundedMAE.from_pretrained(folder)
    save_file(tensors | {"cls_token": torch.zeros(7)}, path)
    with pytest.raises(ValueError, match=r"does not fit its config.json: cls_token is torch.float32 \(7,\)"):
        LanguageGroundedMAE.from_pretrained(folder)


def test_weights_that_were_changed_afterwards_are_refused(folder):
    path = folder / "model.safetensors"
    tensors = load_file(path)
    save_file(tensors | {"cls_token": tensors["cls_token"] + 1e-3}, path)
    message = r"model\.safetensors has sha256 .* were damaged or changed after they were saved"
    with pytest.raises(ValueError, match=message):
        LanguageGroundedMAE.from_pretrained(folder)
    held = json.loads((folder / "config.json").read_text())
    del held["weights_sha256"]  # as models were written before
    (folder / "config.json").write_text(json.dumps(held))
    LanguageGroundedMAE.from_pretrained(folder.parent)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 9}, "has schema version 9; this program reads 1"),
        ({"mae": {"depth": 3}}, "does not describe a pretrained autoencoder: field 'depth' is unknown"),
        ({"text": 3}, "does not describe a pretrained autoencoder"),
    ],
)
def test_wrong_config_is_refused(folder, change, message):
    path = folder / "config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ValueError, match=message):
        LanguageGroundedMAE.from_pretrained(folder)


def test_config_that_is_not_json_is_refused(folder):
    (folder / "config.json").write_text("{")
    with pytest.raises(ValueError, match="does not describe a pretrained autoencoder"):
        LanguageGroundedMAE.from_pretrained(folder)


def test_the_camera_goes_with_the_weights(mae_config, text, tmp_path):
    mae = LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)
    mae.save_pretrained(tmp_path / "unknown")
    assert LanguageGroundedMAE.from_pretrained(tmp_path / "unknown").intrinsics is None
    mae.intrinsics = ((30.0, 0.0, 24.0), (0.0, 31.0, 16.0), (0.0, 0.0, 1.0))
    mae.save_pretrained(tmp_path / "known")
    assert LanguageGroundedMAE.from_pretrained(tmp_path / "known").intrinsics == mae.intrinsics
    path = tmp_path / "known" / "config.json"
    held = json.loads(path.read_text())
    path.write_text(json.dumps(held | {"intrinsics": [[30.0, 0.0, "x"]]}))
    with pytest.raises(ValueError, match=r"config\.json: intrinsics are not three rows of three numbers"):
        LanguageGroundedMAE.from_pretrained(tmp_path / "known")
    del held["intrinsics"]  # as models were written before
    path.write_text(json.dumps(held))
    assert LanguageGroundedMAE.from_pretrained(tmp_path / "known").intrinsics is None
