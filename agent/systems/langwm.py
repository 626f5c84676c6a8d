"""LanGWM: a world model and an actor-critic on the language-grounded autoencoder's features."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import torch
from jaxtyping import Float
from torch import Tensor

from agent.config import AgentConfig, KeyEncoderConfig
from agent.models.encoder import TokenModel
from agent.models.world_model import Metrics
from agent.replay import Replay, ReplayBatch
from agent.systems.dreamer import Dreamer, Perception, make_dreamer
from agent.systems.features import TokenCache
from agent.systems.finetune import Finetuner
from agent.systems.key_encoder import KeyEncoder, second_view
from agent.systems.learner import DreamerLearner
from agent.systems.pretrained import check_camera, load_mae
from agent.systems.system import Learner, Model, Spaces, System
from langwm_data.config_io import ConfigError
from langwm_data.seeding import make_rng
from pretrain.batch import TextTokens
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.parts import map_parts
from pretrain.precision import autocast
from pretrain.update import torch_seed


class MAEPerception(Perception):
    """Tokens of the autoencoder: no masks, the empty caption. Source: method notes, decision 9.

    Args:
        mae: The autoencoder.
        cache: Remembers the tokens of a MAE that never changes; without one all are computed every time.
        key: Whether a slowly moving copy goes beside it, and whether the tokens are the copy's.
    """

    def __init__(
        self, mae: LanguageGroundedMAE, *, cache: TokenCache | None = None, key: KeyEncoderConfig
    ) -> None:
        super().__init__()
        self.mae = mae
        self.key = None if key.mode == "none" else KeyEncoder(mae, key.momentum)
        seen = self.key.mae if self.key and key.mode == "ema_features" else mae
        self._encode = seen.encode if cache is None else cache.encode

    def encode(self, obs: Mapping[str, Tensor]) -> Float[Tensor, "B N V"]:
        """Tokens of ``rgb``."""
        return map_parts(self._encode, obs["rgb"])


class LanGWMLearner(Learner):
    """One update: the MAE where it is finetuned, then world model, then actor and critic.

    Source: Sec. 4.1; method notes, decision 19.
    """

    def __init__(self, model: Dreamer, config: AgentConfig) -> None:
        self._config = config
        self._dreamer = DreamerLearner(model, config)
        self._perception = cast("MAEPerception", model.perception)
        self._finetuner: Finetuner | None = None
        if config.features == "finetuned":
            mae = self._perception.mae
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
        metrics = finetuner.update(replay.sample(rng, config.batch_size, config.batch_length).frames())
        if self.is_pretrained and self._perception.key is not None:
            self._perception.key.catch_up(self._perception.mae)
        return metrics

    def update(self, replay: Replay, index: int) -> Metrics:
        """Take update number ``index`` of everything that learns."""
        batch = self._dreamer.sample(replay, index)
        metrics = self._finetuner.update(batch.frames()) if self._finetuner else {}
        return metrics | self._dreamer.update_on(batch, index, self._update_key(batch, index))

    def _update_key(self, batch: ReplayBatch, index: int) -> Float[Tensor, "B T V"] | None:
        """Let the key encoder follow the MAE; what it makes of a second view, where states must find that."""
        config, key = self._config, self._perception.key
        if key is None:
            return None
        key.follow(self._perception.mae)
        if config.key_encoder.mode != "infonce":
            return None
        rng = make_rng(config.seed, "second view", index)
        view = second_view(rng, batch.rgb, config.finetune.augment).to(self._perception.mae.device)
        with autocast(view.device, config.precision):
            return key.describe(view.flatten(0, 1)).unflatten(0, view.shape[:2])

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
            "features 'frozen' needs a pretrained MAE; give --mae RUN, or --set features=finetuned to"
            " learn one from what the agent sees"
        )
    if config.features == "frozen" and config.key_encoder.mode != "none":
        raise ConfigError(
            f"key_encoder.mode {config.key_encoder.mode!r} needs features 'finetuned': a frozen MAE never"
            " moves away from its running mean"
        )
    mae = _make_mae(config)
    wanted = mae.config
    if (spaces.height, spaces.width) != (wanted.height, wanted.width):
        raise ConfigError(
            f"env.camera is {spaces.height} x {spaces.width} pixels but the MAE reads"
            f" {wanted.height} x {wanted.width}; make them equal"
        )
    if config.env.id is None:
        check_camera(mae, config.env.camera)
    mae = mae.to(config.device)
    with torch.random.fork_rng([]):
        torch.manual_seed(torch_seed(config.seed, "agent weights"))
        model = _assemble(
            MAEPerception(mae, cache=_make_cache(mae, config), key=config.key_encoder), config, spaces
        )
    return model.to(config.device)


def restore(config: AgentConfig, spaces: Spaces, tensors: Mapping[str, Tensor]) -> Dreamer:
    """The agent with these weights."""
    null = TextTokens(
        embed=tensors["perception.mae.null_embed"], attend=tensors["perception.mae.null_attend"]
    )
    mae = LanguageGroundedMAE(config.finetune.model, config.finetune.text, null)
    model = _assemble(MAEPerception(mae, key=config.key_encoder), config, spaces)
    model.load_state_dict(tensors)
    return model


def resolve(config: AgentConfig, model: Model) -> AgentConfig:
    """``config`` with what the given MAE is, so that the agent can be made again without its run."""
    mae = cast("MAEPerception", cast("Dreamer", model).perception).mae
    return replace(config, finetune=replace(config.finetune, model=mae.config, text=mae.text))


def _make_mae(config: AgentConfig) -> LanguageGroundedMAE:
    if config.mae is not None:
        return load_mae(config.mae, config.system, config.finetune)
    null = FrozenText(config.finetune.text, config.device).null_text
    with torch.random.fork_rng([]):
        torch.manual_seed(torch_seed(config.seed, "mae weights"))
        return LanguageGroundedMAE(config.finetune.model, config.finetune.text, null)


def _make_cache(mae: LanguageGroundedMAE, config: AgentConfig) -> TokenCache | None:
    """Memory for the features of a frozen MAE, unrounded, so that an agent that is read back acts the same.

    None where it would not hold every frame, since frames that are missed are encoded one by one, which is
    slower than all together; and none on other devices, from which frames would have to be fetched.
    """
    frame_bytes = 4 * (1 + mae.config.num_patches) * mae.config.dim
    num_frames = min(config.steps, config.replay.capacity_steps)
    fits = num_frames * frame_bytes <= config.token_cache_mib * 2**20
    is_used = config.features == "frozen" and mae.device.type == "cpu" and fits
    return TokenCache(mae, config.token_cache_mib, torch.float32) if is_used else None


def _assemble(perception: MAEPerception, config: AgentConfig, spaces: Spaces) -> Dreamer:
    mae, sizes = perception.mae.config, config.world_model
    observation = TokenModel(
        sizes, num_tokens=1 + mae.num_patches, token_dim=mae.dim, task_dim=spaces.task_dim
    )
    key_dim = mae.dim if config.key_encoder.mode == "infonce" else None
    return make_dreamer(perception, observation, config, spaces, key_dim=key_dim)


def _make_learner(model: Model, config: AgentConfig) -> LanGWMLearner:
    return LanGWMLearner(cast("Dreamer", model), config)


def needs_labels(config: AgentConfig) -> bool:
    """Whether objects are hidden or told of while the MAE learns."""
    objects = config.finetune.objects
    return config.features == "finetuned" and (objects.hides or objects.captions != "none")


def needs_depth(config: AgentConfig) -> bool:
    """Whether the MAE learns to fill in depth."""
    return config.features == "finetuned" and config.finetune.model.target == "depth"


SYSTEM = System(
    create=create,
    restore=restore,
    resolve=resolve,
    make_learner=_make_learner,
    reads_mae=True,
    needs_labels=needs_labels,
    needs_depth=needs_depth,
)
EMPTY_LANGUAGE = replace(SYSTEM, note="objects hidden, the caption always empty")
NO_MASK = replace(SYSTEM, note="no objects hidden, captions as in langwm; not in the paper")
NO_MASK_EMPTY_LANGUAGE = replace(SYSTEM, note="no objects hidden, the caption always empty")
MWM = replace(
    SYSTEM,
    note="fills in colours, no language (the constant tokens of the empty caption stay); tokens told from"
    " the state alone; sizes and learning rates as in langwm; the task observation as in all rows",
)
