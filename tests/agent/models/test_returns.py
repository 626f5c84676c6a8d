import torch

from agent.models.returns import lambda_return, step_weight


def loop_return(reward, discount, value, lambda_):
    """Mix of n-step returns by its definition, term by term, for one sequence."""
    horizon = len(reward)

    def n_step(start, n):
        total, factor = 0.0, 1.0
        for k in range(start, start + n):
            total += factor * reward[k]
            factor *= discount[k]
        return total + factor * value[start + n - 1]

    returns = []
    for start in range(horizon):
        left = horizon - start
        mixed = sum((1 - lambda_) * lambda_ ** (n - 1) * n_step(start, n) for n in range(1, left))
        returns.append(mixed + lambda_ ** (left - 1) * n_step(start, left))
    return returns


def test_lambda_return_is_the_mix_of_n_step_returns():
    generator = torch.Generator().manual_seed(1)
    reward, value = torch.randn(2, 3, 6, generator=generator, dtype=torch.float64)
    discount = torch.rand(3, 6, generator=generator, dtype=torch.float64)
    ours = lambda_return(reward, discount, value, 0.8)
    for row in range(3):
        expected = loop_return(reward[row], discount[row], value[row], 0.8)
        torch.testing.assert_close(ours[row], torch.stack(expected))


def test_lambda_return_at_its_two_limits():
    reward, discount, value = torch.rand(3, 1, 4)
    torch.testing.assert_close(lambda_return(reward, discount, value, 0.0), reward + discount * value)
    whole = lambda_return(reward, torch.full((1, 4), 0.5), value, 1.0)[0, 0]
    expected = (reward[0] * torch.tensor([1, 0.5, 0.25, 0.125])).sum() + value[0, 3] / 16
    torch.testing.assert_close(whole, expected)


def test_success_stops_bootstrapping_and_a_timeout_does_not():
    reward, value = torch.tensor([[0.0, 10.0]]), torch.tensor([[7.0, 5.0]])
    success = lambda_return(reward, torch.tensor([[0.99, 0.0]]), value, 1.0)
    timeout = lambda_return(reward, torch.tensor([[0.99, 0.99]]), value, 1.0)
    torch.testing.assert_close(success, torch.tensor([[9.9, 10.0]]))
    torch.testing.assert_close(timeout[:, 1], torch.tensor([10 + 0.99 * 5]))


def test_steps_after_a_termination_count_nothing():
    discount = torch.tensor([[0.9, 0.0, 0.9], [0.9, 0.9, 0.9]])
    weight = step_weight(torch.tensor([1.0, 0.0]), discount)
    torch.testing.assert_close(weight, torch.tensor([[1.0, 0.9, 0.0], [0.0, 0.0, 0.0]]))
