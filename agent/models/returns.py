"""Return targets for the critic and weights for imagined steps. Pure functions of tensors.

``reward[:, t]`` and ``discount[:, t]`` belong to the state that step t leads to, so the value of a
state never contains the reward for arriving in it.
"""

import torch
from jaxtyping import Float
from torch import Tensor


def lambda_return(
    reward: Float[Tensor, "B T"],
    discount: Float[Tensor, "B T"],
    next_value: Float[Tensor, "B T"],
    lambda_: float,
) -> Float[Tensor, "B T"]:
    """Exponentially weighted mix of n-step returns, computed backwards.

    Args:
        reward: Reward on entering step t + 1.
        discount: Zero where the episode terminated there, else gamma.
        next_value: The slow critic's value of the state at t + 1.
        lambda_: 0 gives one-step targets, 1 the bootstrapped discounted sum.

    Source: DreamerV2; the paper's Eq. 6 gives only the discounted sum.
    """
    returns, last = [], next_value[:, -1]
    for t in reversed(range(reward.shape[1])):
        mixed = (1 - lambda_) * next_value[:, t] + lambda_ * last
        last = reward[:, t] + discount[:, t] * mixed
        returns.append(last)
    return torch.stack(returns[::-1], dim=1)


def step_weight(is_alive: Float[Tensor, " B"], discount: Float[Tensor, "B T"]) -> Float[Tensor, "B T"]:
    """How much each imagined step counts: the chance, discounted, that the episode still runs there.

    Args:
        is_alive: 0 where imagination starts from a terminal state, else 1.
        discount: Of the states that steps 0 to T - 1 lead to.

    Source: DreamerV2 (cumulative product of discounts, shifted by one).
    """
    shifted = torch.cat([is_alive[:, None], discount[:, :-1]], dim=1)
    return shifted.cumprod(dim=1)
