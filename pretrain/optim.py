"""One optimizer step: Adam with linear warm-up and a limit on the gradient's norm."""

import torch
from torch import Tensor, nn

from pretrain.config import OptimConfig


def make_optimizer(module: nn.Module, config: OptimConfig) -> torch.optim.Adam:
    """Adam over the weights of ``module`` that are trained."""
    parameters = [p for p in module.parameters() if p.requires_grad]
    return torch.optim.Adam(parameters, lr=config.learning_rate, eps=config.epsilon, fused=True)


def optimizer_step(
    loss: Tensor, optimizer: torch.optim.Optimizer, config: OptimConfig, step: int
) -> dict[str, float]:
    """Backpropagate ``loss`` and take step number ``step`` (the first is 0).

    Raises:
        FloatingPointError: If the loss or its gradient is not finite; the weights are left as they were.
    """
    warmup = min(1.0, (step + 1) / config.warmup_steps) if config.warmup_steps else 1.0
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    norm = torch.nn.utils.clip_grad_norm_(parameters, config.max_grad_norm)
    if not torch.isfinite(norm):
        raise FloatingPointError(f"the loss is {loss.item()} at step {step}; try a lower learning rate")
    for group in optimizer.param_groups:
        group["lr"] = config.learning_rate * warmup
    optimizer.step()
    return {"grad_norm": norm.item(), "learning_rate": config.learning_rate * warmup}
