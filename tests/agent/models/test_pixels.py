import dataclasses
import math

import pytest
import torch
from torch.distributions import Normal

from agent.config import LossScales, MLPConfig, PixelConfig, RSSMConfig, TaskConfig, WorldModelConfig
from agent.models.pixels import PixelModel, as_pixels, as_rgb
from agent.models.world_model import ModelBatch, WorldModel, world_model_loss
from pretrain import parts

CONFIG = WorldModelConfig(
    pixels=PixelConfig(channels=4),
    rssm=RSSMConfig(num_latents=8, num_classes=8, deter=32, hidden=32),
    head=MLPConfig(layers=1, units=32),
    task=TaskConfig(layers=1, units=32, scale=(5.0, 3.14, 0.5, 1.57)),
    loss_scales=LossScales(task=1.0),
)


def make_observation(height=32, width=48, config=CONFIG):
    torch.manual_seed(0)
    return PixelModel(config, height=height, width=width, task_dim=4)


def make_frames(count, height=32, width=48):
    generator = torch.Generator().manual_seed(1)
    return torch.randint(0, 256, (count, height, width, 3), generator=generator, dtype=torch.uint8)


def make_batch(batch=2, length=5):
    generator = torch.Generator().manual_seed(1)
    is_first = torch.zeros(batch, length, dtype=torch.bool)
    is_first[:, 0] = True
    x, y = torch.arange(48.0)[None, :, None], torch.arange(32.0)[:, None, None]
    middles = torch.rand(batch, length, 2, 3, generator=generator) * torch.tensor([[48.0], [32.0]])
    distance = [torch.hypot(x - mx, y - my) for mx, my in middles.flatten(0, 1)]
    pixels = as_pixels((torch.stack(distance) < 8).to(torch.uint8) * 255).unflatten(0, (batch, length))
    return ModelBatch(
        visual=pixels,
        target=pixels,
        task=torch.randn(batch, length, 4, generator=generator),
        action=torch.rand(batch, length, 2, generator=generator) * 2 - 1,
        reward=torch.randn(batch, length, generator=generator),
        is_first=is_first,
        is_terminal=torch.zeros(batch, length, dtype=torch.bool),
    )


def test_pixels_and_frames_are_the_same_thing():
    frames = torch.arange(256, dtype=torch.uint8).reshape(1, 16, 16, 1).expand(-1, -1, -1, 3).contiguous()
    pixels = as_pixels(frames)
    assert (pixels.min().item(), pixels.max().item()) == (-0.5, 0.5)
    assert torch.equal(as_rgb(pixels), frames)
    assert torch.equal(as_rgb(pixels * 3), (frames.int() * 3 - 255).clamp(0, 255).to(torch.uint8))


def test_channels_lie_side_by_side():
    frames = make_frames(2)
    assert torch.equal(as_pixels(frames)[1, 2, 3, 4], frames[1, 3, 4, 2] / 255 - 0.5)
    assert as_pixels(frames).is_contiguous(memory_format=torch.channels_last)


@pytest.mark.parametrize(("height", "width"), [(16, 16), (64, 80), (128, 160), (48, 32)])
def test_frames_of_any_multiple_of_16_are_taken_in_and_told_again(height, width):
    model = make_observation(height, width)
    embed = model.embed(as_pixels(make_frames(2, height, width)), torch.zeros(2, 4))
    assert embed.shape == (2, model.embed_dim)
    assert model.embed_dim == 32 * (height // 16) * (width // 16) + 32
    assert model.decode(torch.zeros(2, CONFIG.rssm.feat_dim)).shape == (2, 3, height, width)


def test_sizes_of_dreamerv2():
    """48, 96, 192, 384 channels; 8 x 10 places are left of 128 x 160 pixels."""
    model = make_observation(128, 160, WorldModelConfig())
    layers = [m for m in model.encoder if isinstance(m, torch.nn.Conv2d)]
    assert [m.out_channels for m in layers] == [48, 96, 192, 384]
    assert model.embed_dim == 384 * 8 * 10 + 256
    back = [m for m in model.decoder if isinstance(m, torch.nn.ConvTranspose2d)]
    assert [(m.in_channels, m.out_channels) for m in back] == [(384, 192), (192, 96), (96, 48), (48, 3)]
    assert {(m.kernel_size, m.stride) for m in (*layers, *back)} == {((4, 4), (2, 2))}


def test_image_loss_is_the_log_density_of_unit_normals_up_to_its_constant():
    model, pixels, feat = make_observation(), as_pixels(make_frames(3)), torch.randn(3, CONFIG.rssm.feat_dim)
    loss = model.losses(pixels, torch.zeros(3, model.embed_dim), feat)["image"]
    log_density = Normal(model.decode(feat), 1.0).log_prob(pixels).sum((1, 2, 3)).mean()
    constant = 0.5 * math.log(2 * math.pi) * 32 * 48 * 3
    assert loss.item() == pytest.approx(-log_density.item() - constant, rel=1e-4)


@pytest.mark.parametrize(("height", "width", "expected"), [(128, 160, 307), (64, 80, 77)])
def test_what_a_tenth_of_black_to_white_costs(height, width, expected):
    model = make_observation(height, width)
    feat = torch.zeros(1, CONFIG.rssm.feat_dim)
    loss = model.losses(model.decode(feat) + 0.1, torch.zeros(1, model.embed_dim), feat)["image"]
    assert loss.item() == pytest.approx(expected, abs=0.5)


def test_a_shift_of_16_pixels_shifts_the_features_by_one_place():
    model, frames = make_observation(64, 96), torch.zeros(2, 64, 96, 3, dtype=torch.uint8)
    frames[0, 20:40, 30:50] = 200
    frames[1, 20:40, 46:66] = 200
    seen = model.encoder(as_pixels(frames))
    torch.testing.assert_close(seen[0, :, :, 1:4], seen[1, :, :, 2:5])


def test_every_parameter_is_trained():
    model = WorldModel(CONFIG, make_observation(), action_dim=2)
    loss, _, _ = world_model_loss(model, make_batch(), torch.Generator().manual_seed(0))
    loss.backward()
    assert [n for n, p in model.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_a_fixed_batch_is_learned_by_heart():
    model, batch = WorldModel(CONFIG, make_observation(), action_dim=2), make_batch()
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    history = []
    for step in range(250):
        loss, metrics, post = world_model_loss(model, batch, torch.Generator().manual_seed(step))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        history.append(metrics)
    blank = (
        0.5 * (batch.target - batch.target.mean((0, 1, 3, 4), keepdim=True)).square().sum((2, 3, 4)).mean()
    )
    assert history[-1]["wm/image_loss"] < 0.2 * blank
    assert history[-1]["wm/task_loss"] < 0.1 * history[0]["wm/task_loss"]
    assert history[-1]["wm/reward_loss"] < 0.1 * history[0]["wm/reward_loss"]
    assert history[-1]["wm/discount_loss"] < 0.06
    told = as_rgb(model.observation.decode(post.feat.flatten(0, 1)))
    assert (told.int() - as_rgb(batch.target.flatten(0, 1)).int()).abs().float().mean() < 25


def test_half_precision_gives_nearly_the_same_loss():
    model, batch = WorldModel(CONFIG, make_observation(), action_dim=2), make_batch()
    full = world_model_loss(model, batch, torch.Generator().manual_seed(0))[1]
    with torch.autocast("cpu", torch.bfloat16):
        half = world_model_loss(model, batch, torch.Generator().manual_seed(0))[1]
    assert half["wm/image_loss"] == pytest.approx(full["wm/image_loss"], rel=0.02)


def test_what_was_augmented_is_told_unchanged():
    model, batch = WorldModel(CONFIG, make_observation(), action_dim=2), make_batch()
    changed = dataclasses.replace(batch, visual=batch.visual.flip(-1))
    plain, other = (world_model_loss(model, b, torch.Generator().manual_seed(0))[1] for b in (batch, changed))
    blind = 0.5 * batch.target.square().sum((2, 3, 4)).mean().item()
    assert plain["wm/kl_loss"] != other["wm/kl_loss"]
    assert plain["wm/image_loss"] == pytest.approx(other["wm/image_loss"], rel=0.1)
    assert plain["wm/image_loss"] == pytest.approx(blind, rel=0.5)


def test_frames_in_parts_teach_the_same(monkeypatch):
    found = []
    for rows in (50, 3):
        monkeypatch.setattr(parts, "ROWS_AT_ONCE", rows)
        torch.manual_seed(0)
        model = WorldModel(CONFIG, make_observation(), action_dim=2)
        loss, _, _ = world_model_loss(model, make_batch(), torch.Generator().manual_seed(0))
        loss.backward()
        found.append([loss.detach(), *(p.grad for p in model.parameters())])
    torch.testing.assert_close(found[1], found[0], rtol=1e-4, atol=1e-5)
