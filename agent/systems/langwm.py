"""LanGWM: a world model and an actor-critic on the language-grounded autoencoder's features."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import torch
from jaxtyping import Float
from torch import Tensor

from agent.config import AgentConfig
from agent.models.encoder import TokenModel
from agent.models.world_model import Metrics
from agent.replay import Replay
from agent.systems.dreamer import Dreamer, Perception, make_dreamer
from agent.systems.features import TokenCache
from agent.systems.finetune import Finetuner
from agent.systems.learner import DreamerLearner
from agent.systems.system import Learner, Model, Spaces, System
from langwm_data.config_io import ConfigError
from langwm_data.seeding import make_rng
from pretrain.batch import TextTokens
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.update import torch_seed


class MAEPerception(Perception):
    """Tokens of the autoencoder: no masks, the empty caption. Source: method notes, decision 9.

    Args:
        mae: The autoencoder.
        cache: Remembers the tokens of a MAE that never changes; none where it is finetuned.
    """

    def __init__(self, mae: LanguageGroundedMAE, cache: TokenCache | None = None) -> None:
        super().__init__()
        self.mae = mae
        self._encode = cache.encode if cache else mae.encode

    def encode(self, obs: Mapping[str, Tensor]) -> Float[Tensor, "B N V"]:
        """Tokens of ``rgb``."""
        return self._encode(obs["rgb"])


class LanGWMLearner(Learner):
    """One update: the MAE where it is finetuned, then world model, then actor and critic.

    Source: Sec. 4.1; method notes, decision 19.
    """

    def __init__(self, model: Dreamer, config: AgentConfig) -> None:
        self._config = config
        self._dreamer = DreamerLearner(model, config)
        self._finetuner: Finetuner | None = None
        if config.features == "finetuned":
            mae = cast("MAEPerception", model.perception).mae
            text = FrozenText(mae.text, config.device)
            self._finetuner = Finetuner(mae, text, config.finetune, seed=config.seed)

    @property
    def is_pretrained(self) -> bool:
        """Whether a new MAE has learned enough from the prefilled replay alone."""
        if self._finetuner is None or self._config.mae is not None:
            return True
        return self._finetuner.num_updates >= self._config.finetune.pretrain_updates

    def pretrain(self, replay: Replay) -> Metrics:
        """Take one step of the new MAE."""
        config, finetuner = self._config, self._finetuner
        assert finetuner is not None
        rng = make_rng(config.seed, "mae pretraining", finetuner.num_updates)
        return finetuner.update(replay.sample(rng, config.batch_size, config.batch_length).frames())

    def update(self, replay: Replay, index: int) -> Metrics:
        """Take update number ``index`` of everything that learns."""
        batch = self._dreamer.sample(replay, index)
        metrics = self._finetuner.update(batch.frames()) if self._finetuner else {}
        return metrics | self._dreamer.update_on(batch, index)

    def state_dict(self) -> dict[str, Any]:
        """Of all optimizers."""
        finetuner = self._finetuner.state_dict() if self._finetuner else None
        return {"dreamer": self._dreamer.state_dict(), "finetuner": finetuner}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Read back ``state_dict``."""
        self._dreamer.load_state_dict(state["dreamer"])
        if self._finetuner is not None:
            self._finetuner.load_state_dict(state["finetuner"])


def create(config: AgentConfig, spaces: Spaces) -> Dreamer:
    """A new agent on the MAE that ``config`` names, or on a new one.

    Raises:
        ConfigError: If there is no such MAE or text encoder, or the sizes do not fit.
    """
    if config.features == "frozen" and config.mae is None:
        raise ConfigError(
            "features 'frozen' needs a pretrained MAE; give --mae RUN, or --features finetuned to learn"
            " one from what the agent sees"
        )
    mae = _make_mae(config)
    wanted = mae.config
    if (spaces.height, spaces.width) != (wanted.height, wanted.width):
        raise ConfigError(
            f"env.camera is {spaces.height} x {spaces.width} pixels but the MAE reads"
            f" {wanted.height} x {wanted.width}; make them equal"
        )
    mae = mae.to(config.device)
    cache = TokenCache(mae, config.token_cache_mib) if config.features == "frozen" else None
    with torch.random.fork_rng([]):
        torch.manual_seed(torch_seed(config.seed, "agent weights"))
        model = _assemble(MAEPerception(mae, cache), config, spaces)
    return model.to(config.device)


def restore(config: AgentConfig, spaces: Spaces, tensors: Mapping[str, Tensor]) -> Dreamer:
    """The agent with these weights."""
    null = TextTokens(
        embed=tensors["perception.mae.null_embed"], attend=tensors["perception.mae.null_attend"]
    )
    mae = LanguageGroundedMAE(config.finetune.model, config.finetune.text, null)
    model = _assemble(MAEPerception(mae), config, spaces)
    model.load_state_dict(tensors)
    return model


def resolve(config: AgentConfig, model: Model) -> AgentConfig:
    """``config`` with what the given MAE is, so that the agent can be made again without its run."""
    mae = cast("MAEPerception", cast("Dreamer", model).perception).mae
    return replace(config, finetune=replace(config.finetune, model=mae.config, text=mae.text))


def _make_mae(config: AgentConfig) -> LanguageGroundedMAE:
    if config.mae is not None:
        return LanguageGroundedMAE.from_pretrained(config.mae)
    null = FrozenText(config.finetune.text, config.device).null_text
    with torch.random.fork_rng([]):
        torch.manual_seed(torch_seed(config.seed, "mae weights"))
        return LanguageGroundedMAE(config.finetune.model, config.finetune.text, null)


def _assemble(perception: MAEPerception, config: AgentConfig, spaces: Spaces) -> Dreamer:
    mae, sizes = perception.mae.config, config.world_model
    observation = TokenModel(
        sizes, num_tokens=1 + mae.num_patches, token_dim=mae.dim, task_dim=spaces.task_dim
    )
    return make_dreamer(perception, observation, config, spaces)


def _make_learner(model: Model, config: AgentConfig) -> LanGWMLearner:
    return LanGWMLearner(cast("Dreamer", model), config)


SYSTEM = System(
    create=create,
    restore=restore,
    resolve=resolve,
    make_learner=_make_learner,
    needs_labels=lambda config: config.features == "finetuned",
)
