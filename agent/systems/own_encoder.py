"""The world model and the actor-critic on an encoder of the user's own.

The encoder is used, not kept: a run holds everything but it, and whoever goes on with the run or acts with
the agent gives it again.
"""

from collections.abc import Mapping
from typing import cast

import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from agent.config import AgentConfig
from agent.models.encoder import TokenModel
from agent.systems.dreamer import Dreamer, Perception, make_dreamer
from agent.systems.features import Encoder, TokenCache
from agent.systems.learner import DreamerLearner
from agent.systems.system import Spaces, System
from langwm_data.config_io import ConfigError
from pretrain.update import torch_seed

NAME = "own-encoder"


class CheckedEncoder:
    """An encoder whose word is not taken for it. No module, so its weights are neither trained nor saved.

    Args:
        encoder: The user's.
        device: Where its tokens are wanted, and where it is given frames.
        height: Of frames, in pixels.
        width: Of frames, in pixels.
    """

    def __init__(self, encoder: Encoder, device: torch.device | str, height: int, width: int) -> None:
        self._encoder = encoder
        self.num_tokens, self.token_dim = -1, -1
        tokens = self.encode(torch.zeros(1, height, width, 3, dtype=torch.uint8, device=device))
        self.num_tokens, self.token_dim = tokens.shape[1:]

    @torch.no_grad()
    def encode(self, rgb: UInt8[Tensor, "B H W 3"]) -> Float[Tensor, "B N D"]:
        """The encoder's tokens.

        Raises:
            ValueError: If it gives something else.
        """
        tokens = self._encoder.encode(rgb)
        size = (self.num_tokens, self.token_dim)
        expected = f"({len(rgb)}, {'N, D' if size == (-1, -1) else f'{size[0]}, {size[1]}'})"
        if not isinstance(tokens, Tensor) or not tokens.is_floating_point() or tokens.ndim != 3:
            found = f"{tokens.dtype} {tuple(tokens.shape)}" if isinstance(tokens, Tensor) else type(tokens)
            raise ValueError(f"the encoder's encode gave {found}; wanted a tensor of floats {expected}")
        if len(tokens) != len(rgb) or (size != (-1, -1) and tuple(tokens.shape[1:]) != size):
            raise ValueError(f"the encoder's encode gave {tuple(tokens.shape)}; wanted {expected}")
        if not tokens.half().isfinite().all():
            raise ValueError(
                "the encoder's encode gave numbers that are not finite in half precision, in which tokens are"
                " kept; scale them down"
            )
        return tokens.to(rgb.device)


class OwnPerception(Perception):
    """Tokens of the user's encoder, computed once per frame."""

    def __init__(self, encoder: CheckedEncoder, cache_mib: int) -> None:
        super().__init__()
        self._encode = TokenCache(encoder, cache_mib).encode

    def encode(self, obs: Mapping[str, Tensor]) -> Float[Tensor, "B N V"]:
        """Tokens of ``rgb``."""
        return self._encode(obs["rgb"])


def make_system(encoder: Encoder) -> System:
    """The system that sees through ``encoder``."""

    def assemble(config: AgentConfig, spaces: Spaces, device: str) -> Dreamer:
        checked = CheckedEncoder(encoder, device, spaces.height, spaces.width)
        perception = OwnPerception(checked, config.token_cache_mib)
        observation = TokenModel(
            config.world_model,
            num_tokens=checked.num_tokens,
            token_dim=checked.token_dim,
            task_dim=spaces.task_dim,
        )
        return make_dreamer(perception, observation, config, spaces)

    def create(config: AgentConfig, spaces: Spaces) -> Dreamer:
        if config.features != "frozen" or config.mae is not None:
            raise ConfigError(
                f"system {NAME!r} learns nothing of its encoder; it goes with features 'frozen' and no --mae"
            )
        with torch.random.fork_rng([]):
            torch.manual_seed(torch_seed(config.seed, "agent weights"))
            return assemble(config, spaces, config.device).to(config.device)

    def restore(config: AgentConfig, spaces: Spaces, tensors: Mapping[str, Tensor]) -> Dreamer:
        model = assemble(config, spaces, "cpu")
        model.load_state_dict(tensors)
        return model

    return System(
        create=create,
        restore=restore,
        make_learner=lambda model, config: DreamerLearner(cast("Dreamer", model), config),
        note="features of an encoder of the user's own, frozen",
    )
