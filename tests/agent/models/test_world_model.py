import dataclasses

import pytest
import torch

from agent.config import LossScales, MLPConfig, PoolingConfig, RSSMConfig, TaskConfig, WorldModelConfig
from agent.models.encoder import TokenModel
from agent.models.world_model import ModelBatch, WorldModel, world_model_loss
from pretrain import parts

CONFIG = WorldModelConfig(
    pooling=PoolingConfig(dim=16, num_heads=2, num_layers=1, mlp_ratio=2, dropout=0.0),
    rssm=RSSMConfig(num_latents=8, num_classes=8, deter=32, hidden=32),
    head=MLPConfig(layers=1, units=32),
    task=TaskConfig(layers=1, units=32, scale=(5.0, 3.14, 0.5, 1.57)),
)


def make_model(config=CONFIG):
    torch.manual_seed(0)
    return WorldModel(config, TokenModel(config, num_tokens=5, token_dim=12, task_dim=4), action_dim=2)


def make_batch(batch=3, length=6):
    generator = torch.Generator().manual_seed(1)
    is_first = torch.zeros(batch, length, dtype=torch.bool)
    is_first[:, 0] = True
    tokens = torch.randn(batch, length, 5, 12, generator=generator)
    return ModelBatch(
        visual=tokens,
        target=tokens,
        task=torch.randn(batch, length, 4, generator=generator),
        action=torch.rand(batch, length, 2, generator=generator) * 2 - 1,
        reward=torch.randn(batch, length, generator=generator),
        is_first=is_first,
        is_terminal=torch.zeros(batch, length, dtype=torch.bool),
    )


def test_loss_terms_fall_on_a_fixed_batch():
    model, batch = make_model(), make_batch()
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    history = []
    for _ in range(150):
        loss, metrics, _ = world_model_loss(model, batch, torch.Generator().manual_seed(0))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        history.append(metrics)
    for term in ("token", "pool", "task", "reward", "discount"):
        key = f"wm/{term}_loss"
        assert history[-1][key] < 0.6 * history[0][key] or history[-1][key] < 0.06, key
    assert history[-1]["wm/loss"] < 0.3 * history[0]["wm/loss"]


def test_loss_is_the_scaled_sum_of_its_terms():
    scales = LossScales(token=0.5, pool=0.25, task=2.0, reward=3.0, discount=4.0, kl=5.0)
    model = make_model(dataclasses.replace(CONFIG, loss_scales=scales))
    loss, metrics, _ = world_model_loss(model, make_batch(), torch.Generator().manual_seed(0))
    terms = {k: v for k, v in dataclasses.asdict(scales).items() if f"wm/{k}_loss" in metrics}
    assert terms.keys() == {"token", "pool", "task", "reward", "discount", "kl"}
    expected = sum(v * metrics[f"wm/{k}_loss"] for k, v in terms.items())
    assert loss.item() == pytest.approx(expected, rel=1e-5)


def test_tokens_told_from_the_embedding_at_no_weight_are_not_told():
    model = make_model(dataclasses.replace(CONFIG, loss_scales=LossScales(pool=0.0)))
    loss, metrics, _ = world_model_loss(model, make_batch(), torch.Generator().manual_seed(0))
    _, full, _ = world_model_loss(make_model(), make_batch(), torch.Generator().manual_seed(0))
    assert metrics.keys() == full.keys() - {"wm/pool_loss"}
    assert loss.item() == pytest.approx(full["wm/loss"] - full["wm/pool_loss"], rel=1e-5)
    loss.backward()
    assert all(p.grad is None for p in model.observation.decoder.from_embed.parameters())


def test_what_is_told_is_what_was_seen_before_augmentation():
    model, batch = make_model(), make_batch()
    other = dataclasses.replace(batch, target=batch.target + 100)
    losses = [world_model_loss(model, b, torch.Generator().manual_seed(0))[1] for b in (batch, other)]
    assert losses[1]["wm/token_loss"] > 1000 > losses[0]["wm/token_loss"]
    assert losses[1]["wm/kl_loss"] == losses[0]["wm/kl_loss"]


def test_every_parameter_is_trained():
    model = make_model()
    loss, _, _ = world_model_loss(model, make_batch(), torch.Generator().manual_seed(0))
    loss.backward()
    assert [name for name, p in model.named_parameters() if p.grad is None] == []


def test_discount_head_learns_gamma_and_termination():
    model, batch = make_model(), make_batch(length=3)
    is_terminal = torch.zeros(3, 3, dtype=torch.bool)
    is_terminal[0, 2] = True
    batch = dataclasses.replace(batch, is_terminal=is_terminal)
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    for _ in range(200):
        loss, _, post = world_model_loss(model, batch, torch.Generator().manual_seed(0))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    discount = model.predict_discount(post.feat)
    assert discount[0, 2] < 0.1
    assert (discount[~is_terminal] - 0.99).abs().max() < 0.03


def test_reward_is_predicted_in_the_environments_units():
    for transform in ("symlog", "identity"):
        model = make_model(dataclasses.replace(CONFIG, reward_transform=transform))
        feat = torch.randn(4, model.rssm.feat_dim)
        raw = model.reward_head(feat).squeeze(-1)
        expected = raw.sign() * (raw.abs().exp() - 1) if transform == "symlog" else raw
        torch.testing.assert_close(model.predict_reward(feat), expected)


def test_the_task_token_can_skip_the_pooling():
    plain = make_model()
    skipping = make_model(
        dataclasses.replace(CONFIG, task=dataclasses.replace(CONFIG.task, skips_pooling=True))
    )
    batch = make_batch()
    tokens, task = batch.visual.flatten(0, 1), batch.task.flatten(0, 1)
    assert plain.embed(tokens, task).shape == (18, 16)
    embed = skipping.embed(tokens, task)
    assert embed.shape == (18, 32)
    assert torch.equal(embed[:, 16:], skipping.observation.encoder.task_in(task / skipping.task_scale))
    loss, _, _ = world_model_loss(skipping, batch, torch.Generator().manual_seed(0))
    assert loss.isfinite()


def test_frames_in_parts_teach_the_same(monkeypatch):
    found = []
    for rows in (50, 4):
        monkeypatch.setattr(parts, "ROWS_AT_ONCE", rows)
        model = make_model()
        loss, _, _ = world_model_loss(model, make_batch(), torch.Generator().manual_seed(0))
        loss.backward()
        found.append([loss.detach(), *(p.grad for p in model.parameters())])
    torch.testing.assert_close(found[1], found[0], rtol=1e-4, atol=1e-5)
