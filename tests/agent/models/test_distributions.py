import numpy as np
import pytest
import torch
from scipy import stats
from torch import distributions as td

from agent.models.distributions import (
    TruncatedNormal,
    categorical_entropy,
    categorical_kl,
    sample_straight_through,
    symexp,
)
from pretrain.losses import symlog


@pytest.fixture
def generator():
    return torch.Generator().manual_seed(0)


def test_kl_and_entropy_agree_with_torch_distributions(generator):
    p, q = torch.randn(2, 5, 4, 7, generator=generator)
    ours, theirs = categorical_kl(p, q), td.kl_divergence(td.Categorical(logits=p), td.Categorical(logits=q))
    torch.testing.assert_close(ours, theirs.sum(-1))
    torch.testing.assert_close(categorical_entropy(p), td.Categorical(logits=p).entropy().sum(-1))


def test_samples_are_one_hot_with_the_right_frequencies(generator):
    logit = torch.randn(3, 5, generator=generator)
    sample = sample_straight_through(logit.expand(40_000, 3, 5), generator)
    assert ((sample > 0.5).sum(-1) == 1).all()
    torch.testing.assert_close(sample.sum(-1), torch.ones(40_000, 3))
    torch.testing.assert_close(sample.mean(0), logit.softmax(-1), atol=0.01, rtol=0)


def test_straight_through_gradient_is_that_of_the_probabilities(generator):
    logit = torch.randn(2, 3, 5, generator=generator, requires_grad=True)
    weight = torch.randn(2, 3, 5, generator=generator)
    (through_sample,) = torch.autograd.grad((weight * sample_straight_through(logit, generator)).sum(), logit)
    (through_probability,) = torch.autograd.grad((weight * logit.softmax(-1)).sum(), logit)
    torch.testing.assert_close(through_sample, through_probability)


@pytest.mark.parametrize(("loc", "scale"), [(0.0, 0.5), (0.9, 0.1), (-0.99, 1.0), (0.3, 2.0)])
def test_truncated_normal_agrees_with_scipy(loc, scale, generator):
    reference = stats.truncnorm((-1 - loc) / scale, (1 - loc) / scale, loc, scale)
    ours = TruncatedNormal(torch.tensor([loc]), torch.tensor([scale]))
    values = torch.linspace(-0.95, 0.95, 9)[:, None]
    batch = TruncatedNormal(ours.loc.expand(9, 1), ours.scale.expand(9, 1))
    np.testing.assert_allclose(batch.log_prob(values), reference.logpdf(values[:, 0]), rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(ours.entropy(), reference.entropy(), rtol=1e-3, atol=1e-4)
    many = TruncatedNormal(ours.loc.expand(20_000, 1), ours.scale.expand(20_000, 1))
    sample = many.rsample(generator)[:, 0].numpy()
    assert np.abs(sample).max() < 1
    assert stats.kstest(sample, reference.cdf).pvalue > 1e-3


def test_truncated_normal_gradient_is_that_of_the_quantile_function():
    loc = torch.tensor([0.4], dtype=torch.float64, requires_grad=True)
    scale = torch.tensor([0.6], dtype=torch.float64, requires_grad=True)

    def quantile_sample(loc, scale):
        return TruncatedNormal(loc, scale).rsample(torch.Generator().manual_seed(3))

    torch.autograd.gradcheck(quantile_sample, (loc, scale))


def test_symexp_inverts_symlog():
    values = torch.tensor([-100.0, -0.01, 0.0, 0.3, 10.0])
    torch.testing.assert_close(symexp(symlog(values)), values)
