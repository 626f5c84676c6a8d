"""Online learning of the MAE: the first of the three steps that one update takes.

The step itself is pretraining's own; the frames come from the replay buffer.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from agent.config import FinetuneConfig
from agent.models.world_model import Metrics
from langwm_data.seeding import make_rng
from pretrain.frames import FrameBatch
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.optim import Optimizer
from pretrain.update import mae_update, make_mae_batch


class Finetuner:
    """Optimizer of the MAE and the text encoder that its captions need.

    Random numbers depend on the seed and the number of the update alone.
    """

    def __init__(
        self, mae: LanguageGroundedMAE, text: FrozenText, config: FinetuneConfig, *, seed: int
    ) -> None:
        self._mae = mae
        self._text = text
        self._config = config
        self._seed = seed
        self._optimizer = Optimizer(mae, config.optimizer)
        self.num_updates = 0

    def update(self, frames: FrameBatch) -> Metrics:
        """Take the next update on at most ``batch_frames`` of ``frames``, drawn at random.

        Raises:
            FloatingPointError: If the loss is not finite.
        """
        rng = make_rng(self._seed, "finetune", self.num_updates)
        num_frames = min(self._config.batch_frames, len(frames))
        chosen = select_frames(frames, rng.permutation(len(frames))[:num_frames])
        batch = make_mae_batch(
            [rng] * len(chosen), chosen, self._text, self._config.objects, self._config.augment
        )
        metrics = mae_update(self._mae, self._optimizer, batch, seed=self._seed, step=self.num_updates)
        self.num_updates += 1
        return metrics

    def state_dict(self) -> dict[str, Any]:
        """Of the optimizer, and how far it is."""
        return {"optimizer": self._optimizer.state_dict(), "num_updates": self.num_updates}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Read back ``state_dict``."""
        self._optimizer.load_state_dict(state["optimizer"])
        self.num_updates = state["num_updates"]


def select_frames(frames: FrameBatch, numbers: np.ndarray) -> FrameBatch:
    """The frames with these numbers, in this order."""
    arrays = {k: v[numbers] for k, v in vars(frames).items() if isinstance(v, np.ndarray)}
    return replace(frames, objects=[frames.objects[n] for n in numbers], **arrays)
