import math

import pytest
import torch
from torch.distributions import Normal

from agent.config import LossScales, MLPConfig, RSSMConfig, TaskConfig, WorldModelConfig
from agent.models.vector import VectorModel
from agent.models.world_model import ModelBatch, WorldModel, world_model_loss

CONFIG = WorldModelConfig(
    vector=MLPConfig(layers=2, units=24),
    rssm=RSSMConfig(num_latents=8, num_classes=8, deter=32, hidden=32),
    head=MLPConfig(layers=1, units=32),
    task=TaskConfig(layers=1, units=16, scale=(5.0, 3.14, 0.5, 1.57)),
    loss_scales=LossScales(task=1.0),
)


def make_observation():
    torch.manual_seed(0)
    return VectorModel(CONFIG, vector_dim=10, task_dim=4)


def make_batch(batch=3, length=6):
    generator = torch.Generator().manual_seed(1)
    is_first = torch.zeros(batch, length, dtype=torch.bool)
    is_first[:, 0] = True
    vector = torch.randn(batch, length, 10, generator=generator)
    return ModelBatch(
        visual=vector,
        target=vector,
        task=torch.randn(batch, length, 4, generator=generator),
        action=torch.rand(batch, length, 2, generator=generator) * 2 - 1,
        reward=torch.randn(batch, length, generator=generator),
        is_first=is_first,
        is_terminal=torch.zeros(batch, length, dtype=torch.bool),
    )


def test_vector_and_task_stand_side_by_side():
    model = make_observation()
    vector, task = torch.randn(2, 10), torch.randn(2, 4)
    embed = model.embed(vector, task)
    assert embed.shape == (2, model.embed_dim) == (2, 24 + 16)
    assert torch.equal(model.embed(vector, task + 1)[:, :24], embed[:, :24])
    assert torch.equal(model.embed(vector + 1, task)[:, 24:], embed[:, 24:])


def test_loss_is_the_log_density_of_unit_normals_up_to_its_constant():
    model, vector, feat = make_observation(), torch.randn(3, 10), torch.randn(3, CONFIG.rssm.feat_dim)
    loss = model.losses(vector, torch.zeros(3, model.embed_dim), feat)["vector"]
    log_density = Normal(model.decoder(feat), 1.0).log_prob(vector).sum(-1).mean()
    assert loss.item() == pytest.approx(-log_density.item() - 5 * math.log(2 * math.pi), rel=1e-4)


def test_every_parameter_is_trained():
    model = WorldModel(CONFIG, make_observation(), action_dim=2)
    loss, _, _ = world_model_loss(model, make_batch(), torch.Generator().manual_seed(0))
    loss.backward()
    assert [n for n, p in model.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_a_fixed_batch_is_learned_by_heart():
    model, batch = WorldModel(CONFIG, make_observation(), action_dim=2), make_batch()
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    history = []
    for step in range(300):
        loss, metrics, _ = world_model_loss(model, batch, torch.Generator().manual_seed(step))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        history.append(metrics)
    for term in ("vector", "task", "reward"):
        assert history[-1][f"wm/{term}_loss"] < 0.1 * history[0][f"wm/{term}_loss"], term
