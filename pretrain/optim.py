"""One optimizer step: Adam with a warm-up, a schedule and a limit on the gradient's norm."""

import math
from typing import Any

import torch
from torch import Tensor, nn

from pretrain.config import OptimConfig


class Optimizer:
    """Adam over the weights of a module that are trained, and how fast it goes at each step.

    Args:
        module: What learns.
        config: How.
        total_steps: Length of the run, which a cosine needs; ``None`` where there is no known end.
    """

    def __init__(self, module: nn.Module, config: OptimConfig, total_steps: int | None = None) -> None:
        self.config = config
        self._total_steps = total_steps
        self.parameters = [p for p in module.parameters() if p.requires_grad]
        self._adam = torch.optim.Adam(
            self.parameters, lr=config.learning_rate, eps=config.epsilon, fused=True
        )

    def step(self, loss: Tensor, step: int) -> dict[str, float]:
        """Backpropagate ``loss`` and take step number ``step`` (the first is 0).

        Raises:
            FloatingPointError: If the loss or its gradient is not finite; the weights are left as they were.
        """
        self.forget_gradients()
        loss.backward()
        return self.apply_gradients(loss.item(), step)

    def forget_gradients(self) -> None:
        """Begin a step whose gradients come in several parts."""
        self._adam.zero_grad(set_to_none=True)

    def apply_gradients(self, loss: float, step: int) -> dict[str, float]:
        """Take step number ``step`` with the gradients that are there.

        Raises:
            FloatingPointError: As ``step``.
        """
        learning_rate = learning_rate_at(self.config, step, self._total_steps)
        norm = nn.utils.clip_grad_norm_(self.parameters, self.config.max_grad_norm)
        if not torch.isfinite(norm):
            raise FloatingPointError(
                f"the loss is {loss} at step {step} and its gradient's norm {norm.item()};"
                f" try a learning rate below {self.config.learning_rate}"
            )
        for group in self._adam.param_groups:
            group["lr"] = learning_rate
        self._adam.step()
        return {"grad_norm": norm.item(), "learning_rate": learning_rate}

    def state_dict(self) -> dict[str, Any]:
        """Of Adam."""
        return self._adam.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Read back ``state_dict``."""
        self._adam.load_state_dict(state)


def learning_rate_at(config: OptimConfig, step: int, total_steps: int | None = None) -> float:
    """Learning rate of step number ``step`` (the first is 0).

    It rises linearly to its full value at the last step of the warm-up. Then it stays there, or falls
    along half a cosine that reaches zero one step after the last.

    Args:
        config: Rate, warm-up and schedule.
        step: Which.
        total_steps: Steps of the run, warm-up included; needed for the cosine alone.
    """
    warmup = min(1.0, (step + 1) / config.warmup_steps) if config.warmup_steps else 1.0
    if config.schedule == "constant":
        return config.learning_rate * warmup
    assert total_steps is not None
    done = max(step - config.warmup_steps, 0) / max(total_steps - config.warmup_steps, 1)
    return config.learning_rate * warmup * (1 + math.cos(math.pi * min(done, 1.0))) / 2
