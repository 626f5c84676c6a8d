"""The autoencoder as somebody else's library: their masks, the hub, a graph without this package."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from pretrain import LanguageGroundedMAE
from pretrain.config import TextConfig
from pretrain.export import push_to_hub
from pretrain.supplied import boxes_mask


@pytest.fixture
def mae(mae_config, text):
    torch.manual_seed(0)
    return LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)


@pytest.fixture
def rgb(mae_config, make_batch):
    return make_batch(mae_config, batch_size=3).rgb


def test_boxes_are_edges_and_stay_inside():
    mask = boxes_mask([[(2.0, 1.0, 4.0, 3.0)], [], [(-5.0, -5.0, 1.0, 1.0), (6.5, 2.2, 99.0, 99.0)]], 4, 8)
    assert mask.sum(dim=(1, 2)).tolist() == [4, 0, 1 + 2 * 2]
    assert mask[0, 1:3, 2:4].all()
    assert mask[2, 2:, 6:].all()


def test_hidden_pixels_do_not_matter_and_others_do(mae, rgb):
    hidden = boxes_mask([[(8.0, 8.0, 24.0, 24.0)]] * 3, 32, 48)
    other = torch.where(hidden[..., None], 255 - rgb, rgb)
    assert torch.equal(mae.fill_in(rgb, is_hidden=hidden).depth, mae.fill_in(other, is_hidden=hidden).depth)
    assert not torch.equal(mae.fill_in(rgb).depth, mae.fill_in(other).depth)


def test_dropped_tokens_do_not_reach_the_encoder(mae, rgb):
    num = mae.config.num_patches
    seen = []
    handle = mae.encoder.register_forward_hook(lambda *args: seen.append(args[1][0].shape[1]))
    mae.fill_in(rgb)
    mae.fill_in(rgb, is_dropped=torch.arange(num).expand(3, num) % 4 > 0)
    handle.remove()
    assert [n - 1 - 21 for n in seen] == [num, num // 4]


def test_nothing_masked_is_what_encode_and_decode_give(mae, rgb):
    mae.eval()
    with torch.no_grad():
        ids = torch.arange(mae.config.num_patches).expand(3, -1)
        image, reward = mae.decode_tokens(mae.encode(rgb), ids)
    output = mae.train().fill_in(rgb)
    assert mae.training
    torch.testing.assert_close(output.image, image)
    torch.testing.assert_close(output.reward, reward)


def test_captions_of_the_caller_are_read(mae, rgb, text):
    told, _ = text.embed(["There is chair in the left 3 meters."] * 3)
    assert not torch.equal(mae.fill_in(rgb, text=told).depth, mae.fill_in(rgb).depth)


def test_arrays_are_read_as_tensors_are(mae, rgb):
    frames = rgb.numpy().copy()
    frames.flags.writeable = False
    hidden = boxes_mask([[(8.0, 8.0, 24.0, 24.0)]] * 3, 32, 48)
    dropped = torch.arange(mae.config.num_patches).expand(3, -1) % 2 > 0
    assert torch.equal(mae.encode(frames), mae.encode(rgb))
    assert torch.equal(mae.encode(frames[:, ::-1]), mae.encode(rgb.flip(1)))
    masks = {"is_hidden": hidden, "is_dropped": dropped}
    arrays = {name: mask.numpy() for name, mask in masks.items()}
    assert torch.equal(mae.fill_in(frames, **arrays).depth, mae.fill_in(rgb, **masks).depth)


@pytest.mark.parametrize("dropped", [[1, 2, 3], [24, 24, 24]])
def test_uneven_or_total_dropping_is_refused(mae, rgb, dropped):
    is_dropped = torch.arange(mae.config.num_patches) < torch.tensor(dropped)[:, None]
    with pytest.raises(ValueError, match=r"is_dropped leaves out \[.*\] of 24 tokens; allowed"):
        mae.fill_in(rgb, is_dropped=is_dropped)


def test_frames_of_another_size_are_refused(mae):
    with pytest.raises(ValueError, match=r"frames of shape \(16, 16, 3\); this model reads \(32, 48, 3\)"):
        mae.fill_in(torch.zeros(1, 16, 16, 3, dtype=torch.uint8))


WRONG = """
import sys, numpy as np, torch
from pretrain import LanguageGroundedMAE
from pretrain.batch import TextTokens
mae = LanguageGroundedMAE.from_pretrained(sys.argv[1])
rgb = torch.zeros(3, 32, 48, 3, dtype=torch.uint8)
text = lambda num, width: TextTokens(
    embed=torch.zeros(num, 21, width), attend=torch.ones(num, 21, dtype=torch.bool)
)
for use, frames, more in (
    (mae.encode, torch.full((1, 32, 48, 3), torch.nan), {}),
    (mae.fill_in, torch.zeros(1, 32, 48, 3, dtype=torch.int64), {}),
    (mae.encode, np.zeros((1, 32, 48, 3), dtype=np.float32), {}),
    (mae.encode, [[0, 0, 0]], {}),
    (mae.encode, rgb[0], {}),
    (mae.fill_in, rgb.permute(0, 3, 1, 2), {}),
    (mae.fill_in, rgb, {"is_hidden": torch.zeros(3, 48, 32, dtype=torch.bool)}),
    (mae.fill_in, rgb, {"is_hidden": np.zeros((3, 32, 48), dtype=np.uint8)}),
    (mae.fill_in, rgb, {"is_dropped": torch.zeros(3, 24)}),
    (mae.fill_in, rgb, {"text": text(3, 9)}),
    (mae.fill_in, rgb, {"text": text(2, 16)}),
):
    try:
        use(frames, **more)
    except ValueError as error:
        print(error)
"""


def test_what_does_not_fit_is_refused_in_a_sentence(mae, tmp_path):
    """In a process of its own, where no shapes are checked but by the program itself."""
    mae.save_pretrained(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", WRONG, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == [
        "frames of type torch.float32; this model reads torch.uint8, colours from 0 to 255",
        "frames of type torch.int64; this model reads torch.uint8, colours from 0 to 255",
        "frames of type torch.float32; this model reads torch.uint8, colours from 0 to 255",
        "frames of type list; this model reads torch.uint8, colours from 0 to 255",
        "frames of shape (48, 3); this model reads (32, 48, 3), in a batch",
        "frames of shape (3, 32, 48); this model reads (32, 48, 3), in a batch",
        "is_hidden is torch.bool (3, 48, 32); for these frames and this model, torch.bool (3, 32, 48)",
        "is_hidden is torch.uint8 (3, 32, 48); for these frames and this model, torch.bool (3, 32, 48)",
        "is_dropped is torch.float32 (3, 24); for these frames and this model, torch.bool (3, 24)",
        "text.embed is torch.float32 (3, 21, 9); for these frames and this model, torch.float32 (3, 21, 16)",
        "text.embed is torch.float32 (2, 21, 16); for these frames and this model, torch.float32 (3, 21, 16)",
    ]


EXPORT = """
import sys, torch
from pretrain import LanguageGroundedMAE
from pretrain.export import export_encoder
mae = LanguageGroundedMAE.from_pretrained(sys.argv[1])
torch.export.save(export_encoder(mae), sys.argv[2])
"""
LOAD = """
import sys, torch
sys.modules["pretrain"] = None
encode = torch.export.load(sys.argv[1]).module()
for size in (1, 5):
    noise = torch.Generator().manual_seed(size)
    rgb = torch.randint(0, 256, (size, 32, 48, 3), generator=noise, dtype=torch.uint8)
    print(encode(rgb).double().sum().item())
"""


def test_an_exported_encoder_gives_the_same_without_this_package(mae, tmp_path):
    mae.save_pretrained(tmp_path / "model")
    file = tmp_path / "encoder.pt2"
    for code, arguments in ((EXPORT, [tmp_path / "model", file]), (LOAD, [file])):
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True, check=True
        )
    sums = [float(line) for line in done.stdout.split()]
    for size, found in zip((1, 5), sums, strict=True):
        generator = torch.Generator().manual_seed(size)
        rgb = torch.randint(0, 256, (size, 32, 48, 3), generator=generator, dtype=torch.uint8)
        assert found == pytest.approx(mae.encode(rgb).double().sum().item(), rel=1e-6)


def test_the_hub_gets_weights_config_and_a_card(mae, rgb, monkeypatch, tmp_path):
    calls = SimpleNamespace(repo=None, files={})

    class Hub:
        def __init__(self, token):
            calls.token = token

        def create_repo(self, name, private, exist_ok):
            calls.repo = (name, private, exist_ok)
            return f"https://hub/{name}"

        def upload_folder(self, repo_id, folder_path, commit_message):
            calls.files = {p.name: p.read_bytes() for p in Path(folder_path).iterdir()}

    monkeypatch.setattr("huggingface_hub.HfApi", Hub)
    assert push_to_hub(mae, "somebody/homes", is_private=True) == "https://hub/somebody/homes"
    assert calls.repo == ("somebody/homes", True, True)
    assert sorted(calls.files) == ["README.md", "config.json", "model.safetensors"]
    assert b'from_pretrained("somebody/homes")' in calls.files["README.md"]

    copy = tmp_path / "copy"
    copy.mkdir()
    for name, data in calls.files.items():
        (copy / name).write_bytes(data)
    monkeypatch.setattr("huggingface_hub.snapshot_download", lambda name, allow_patterns: str(copy))
    assert torch.equal(LanguageGroundedMAE.from_pretrained("somebody/homes").encode(rgb), mae.encode(rgb))


def test_a_name_that_is_nowhere_is_refused(monkeypatch):
    from huggingface_hub.errors import LocalEntryNotFoundError

    def missing(name, allow_patterns):
        raise LocalEntryNotFoundError("offline")

    monkeypatch.setattr("huggingface_hub.snapshot_download", missing)
    with pytest.raises(ValueError, match=r"'somebody/nothing' holds no pretrained .*: it is no folder"):
        LanguageGroundedMAE.from_pretrained("somebody/nothing")
