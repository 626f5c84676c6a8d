import pytest
import torch

from agent.config import RSSMConfig
from agent.models.distributions import categorical_kl
from agent.models.nets import LayerNormGRUCell, frozen, make_mlp
from agent.models.rssm import RSSM, balanced_kl

CONFIG = RSSMConfig(num_latents=4, num_classes=5, deter=16, hidden=12)


@pytest.fixture
def generator():
    return torch.Generator().manual_seed(0)


@pytest.fixture
def rssm(generator):
    torch.manual_seed(0)
    return RSSM(CONFIG, embed_dim=6, action_dim=2)


def sequence(generator, batch=3, length=5):
    embed = torch.randn(batch, length, 6, generator=generator)
    action = torch.rand(batch, length, 2, generator=generator) * 2 - 1
    return embed, action, torch.zeros(batch, length, dtype=torch.bool)


def test_gru_cell_agrees_with_its_equations(generator):
    torch.manual_seed(0)
    cell = LayerNormGRUCell(3, 4)
    torch.nn.init.normal_(cell.norm.weight)
    x, h = torch.randn(2, 3, generator=generator), torch.randn(2, 4, generator=generator)
    for row in range(2):
        parts = cell.linear.weight @ torch.cat([x[row], h[row]])
        parts = (parts - parts.mean()) / torch.sqrt(parts.var(unbiased=False) + 1e-3) * cell.norm.weight
        reset, candidate, update = parts[:4], parts[4:8], parts[8:]
        candidate = torch.tanh(torch.sigmoid(reset) * candidate)
        update = torch.sigmoid(update - 1)
        torch.testing.assert_close(cell(x, h)[row], update * candidate + (1 - update) * h[row])


def test_gru_cell_remembers_by_default():
    cell = LayerNormGRUCell(3, 4)
    torch.nn.init.zeros_(cell.linear.weight)
    hidden = torch.ones(1, 4)
    torch.testing.assert_close(cell(torch.zeros(1, 3), hidden), hidden * torch.sigmoid(torch.tensor(1.0)))


def test_observing_step_by_step_equals_observing_the_sequence(rssm):
    embed, action, is_first = sequence(torch.Generator().manual_seed(1))
    is_first[:, 0] = True
    whole, prior = rssm.observe(embed, action, is_first, rssm.initial(3), torch.Generator().manual_seed(2))
    state, generator = rssm.initial(3), torch.Generator().manual_seed(2)
    for t in range(5):
        step = slice(t, t + 1)
        post, step_prior = rssm.observe(embed[:, step], action[:, step], is_first[:, step], state, generator)
        state = post.at(0)
        torch.testing.assert_close(state.feat, whole.feat[:, t])
        torch.testing.assert_close(step_prior[:, 0], prior[:, t])


def test_prior_of_observe_is_what_imagination_predicts(rssm):
    embed, action, is_first = sequence(torch.Generator().manual_seed(1))
    post, prior = rssm.observe(embed, action, is_first, rssm.initial(3), torch.Generator().manual_seed(2))
    imagined = rssm.imagine_step(post.at(2), action[:, 3], torch.Generator().manual_seed(3))
    torch.testing.assert_close(imagined.logit, prior[:, 3])
    torch.testing.assert_close(imagined.deter, post.deter[:, 3])


def test_is_first_forgets_the_state_and_the_action(rssm):
    embed, action, is_first = sequence(torch.Generator().manual_seed(1))
    is_first[:, 2] = True
    old, _ = rssm.observe(embed, action, is_first, rssm.initial(3), torch.Generator().manual_seed(2))
    fresh, _ = rssm.observe(
        embed[:, 2:3], torch.zeros(3, 1, 2), is_first[:, 2:3], rssm.initial(3), torch.Generator()
    )
    torch.testing.assert_close(old.deter[:, 2], fresh.deter[:, 0])
    torch.testing.assert_close(old.logit[:, 2], fresh.logit[:, 0])


def test_state_does_not_see_the_future(rssm):
    embed, action, is_first = sequence(torch.Generator().manual_seed(1))
    embed.requires_grad_(True)
    post, _ = rssm.observe(embed, action, is_first, rssm.initial(3), torch.Generator().manual_seed(2))
    (gradient,) = torch.autograd.grad(post.feat[:, 2].square().sum(), embed)
    assert gradient[:, 0].abs().sum() > 0
    assert gradient[:, 3:].abs().sum() == 0


def test_kl_balance_splits_the_gradient(generator):
    post = torch.randn(3, 4, 5, generator=generator, requires_grad=True)
    prior = torch.randn(3, 4, 5, generator=generator, requires_grad=True)
    loss, value = balanced_kl(post, prior, balance=0.8, free_nats=0.0)
    plain = categorical_kl(post, prior)
    torch.testing.assert_close(loss, plain)
    torch.testing.assert_close(value, plain.detach())
    ours = torch.autograd.grad(loss.sum(), (post, prior))
    whole = torch.autograd.grad(plain.sum(), (post, prior))
    torch.testing.assert_close(ours[0], 0.2 * whole[0])
    torch.testing.assert_close(ours[1], 0.8 * whole[1])


def test_kl_below_the_free_nats_is_left_alone(generator):
    prior = torch.randn(2, 4, 5, generator=generator)
    post = prior.clone()
    post[1] += torch.randn(4, 5, generator=generator)
    post.requires_grad_(True)
    loss, _ = balanced_kl(post, prior, balance=0.8, free_nats=0.1)
    (gradient,) = torch.autograd.grad(loss.sum(), post)
    assert gradient[0].abs().sum() == 0
    assert gradient[1].abs().sum() > 0


def test_frozen_lets_gradients_through_but_not_in():
    net = make_mlp(3, 4, 1, 1)
    x = torch.ones(1, 3, requires_grad=True)
    with frozen(net):
        net(x).sum().backward()
    assert x.grad is not None
    assert all(p.grad is None and p.requires_grad for p in net.parameters())


def test_frozen_weights_are_cast_once_and_come_back():
    net = make_mlp(3, 4, 1, 1)
    weights, x = [m.weight for m in net if hasattr(m, "weight")], torch.ones(2, 3)
    with torch.autocast("cpu", torch.bfloat16):
        plain = net(x)
        with frozen(net):
            assert {m.weight.dtype for m in net if hasattr(m, "weight")} == {torch.bfloat16}
            assert torch.equal(net(x), plain)
    assert all(m.weight is w for m, w in zip((net[0], net[2]), weights, strict=True))
    with frozen(net):
        assert net[0].weight.dtype == torch.float32
