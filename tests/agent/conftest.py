"""A stand-in for the homes: PointGoal in an empty room, seen through a camera that shows nothing."""

import math
import re

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium import spaces

from agent.config import (
    AgentConfig,
    BehaviorConfig,
    EnvConfig,
    FinetuneConfig,
    MLPConfig,
    OracleBoxesConfig,
    PixelConfig,
    PoolingConfig,
    RSSMConfig,
    TaskConfig,
    WorldModelConfig,
)
from langwm_data.config import CameraConfig
from langwm_data.labels.captions import TEMPLATES
from pretrain.batch import TextTokens
from pretrain.config import MAEConfig, OptimConfig, TextConfig
from pretrain.frames import FrameObject
from pretrain.mae import LanguageGroundedMAE

SIZE = 16


class EmptyRoom(gymnasium.Env):
    """The robot starts at the origin; speeds and success radius are those of ``PointNavEnv``."""

    def __init__(self, max_steps=100, distances_m=(1.0, 3.0)):
        self.max_steps = max_steps
        self.distances_m = distances_m
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = spaces.Dict(
            rgb=spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8),
            depth=spaces.Box(0.0, 10.0, (SIZE, SIZE), np.float32),
            task=spaces.Box(-np.inf, np.inf, (4,), np.float32),
        )

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.xy, self.yaw = np.zeros(2), self.np_random.uniform(-math.pi, math.pi)
        angle, self.start_m = (
            self.np_random.uniform(-math.pi, math.pi),
            self.np_random.uniform(*self.distances_m),
        )
        self.goal = self.start_m * np.array([math.cos(angle), math.sin(angle)])
        self.path_m, self.num_steps, self.speed = 0.0, 0, (0.0, 0.0)
        return self.observe(), self.describe(is_success=False)

    def step(self, action):
        linear, angular = np.clip(np.asarray(action, float), -1, 1) * (0.5, math.pi / 2)
        before = self.distance_m
        self.yaw = math.remainder(self.yaw + angular * 0.1, 2 * math.pi)
        self.xy = self.xy + linear * 0.1 * np.array([math.cos(self.yaw), math.sin(self.yaw)])
        self.speed, self.path_m = (linear, angular), self.path_m + abs(linear) * 0.1
        self.num_steps += 1
        is_success = self.distance_m < 0.36
        reward = before - self.distance_m + 10 * is_success
        is_late = not is_success and self.num_steps >= self.max_steps
        return self.observe(), reward, is_success, is_late, self.describe(is_success)

    @property
    def distance_m(self):
        return float(np.linalg.norm(self.goal - self.xy))

    def observe(self):
        x, y = self.goal - self.xy
        bearing = math.remainder(math.atan2(y, x) - self.yaw, 2 * math.pi)
        return {
            "rgb": np.full((SIZE, SIZE, 3), 128, np.uint8),
            "depth": np.ones((SIZE, SIZE), np.float32),
            "task": np.array([self.distance_m, bearing, *self.speed], np.float32),
        }

    def describe(self, is_success):
        return {
            "success": is_success,
            "spl": is_success * self.start_m / max(self.start_m, self.path_m),
            "soft_spl": 0.0,
            "distance_to_goal": self.distance_m,
            "path_length": self.path_m,
            "geodesic_distance": self.start_m,
            "collisions": 0,
            "scene": "room",
            "tier": 0,
            "pose": np.array([*self.xy, self.yaw]),
            "goal": self.goal.copy(),
            "objects": [
                FrameObject(category="chair", bbox_xyxy=(2.0, 2.0, 9.0, 9.0), center_x=5.0, distance_m=2.0)
            ],
        }


@pytest.fixture(scope="session")
def make_room():
    return EmptyRoom


@pytest.fixture
def tiny_mae():
    """An untrained MAE for the room's frames, with invented language tokens."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        null = TextTokens(embed=torch.randn(1, 3, 8), attend=torch.ones(1, 3, dtype=torch.bool))
        return LanguageGroundedMAE(tiny_mae_config(), TextConfig(num_tokens=2), null).eval()


def tiny_mae_config():
    return MAEConfig(
        height=SIZE,
        width=SIZE,
        conv_channels=(4, 4, 4),
        dim=8,
        num_heads=2,
        encoder_layers=1,
        decoder_layers=1,
    )


@pytest.fixture(scope="session")
def tiny_text(tmp_path_factory):
    """A BERT with random weights that knows the words of captions about chairs."""
    from transformers import BertConfig, BertModel, BertTokenizer

    folder = tmp_path_factory.mktemp("text")
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", "chair", "left", "front", "right", "outer"]
    words += sorted(set(re.findall(r"\w+|[^\w\s]", " ".join(TEMPLATES).lower())))
    words += ["meter", "meters", "half"]
    words += map(str, range(11))
    (folder / "vocab.txt").write_text("\n".join(words))
    BertTokenizer(str(folder / "vocab.txt")).save_pretrained(folder)
    sizes = {"hidden_size": 8, "num_hidden_layers": 1, "num_attention_heads": 2, "intermediate_size": 8}
    with torch.random.fork_rng():
        torch.manual_seed(0)
        BertModel(BertConfig(vocab_size=len(words), **sizes)).save_pretrained(folder)
    return TextConfig(model=str(folder), num_tokens=6)


@pytest.fixture(scope="session")
def tiny_config(tiny_text):
    """Sizes with which a run takes seconds."""
    net = MLPConfig(layers=1, units=16)
    return AgentConfig(
        steps=60,
        env=EnvConfig(camera=CameraConfig(height=SIZE, width=SIZE)),
        finetune=FinetuneConfig(
            model=tiny_mae_config(),
            text=tiny_text,
            optimizer=OptimConfig(warmup_steps=0),
            batch_frames=6,
            pretrain_updates=3,
        ),
        world_model=WorldModelConfig(
            pooling=PoolingConfig(dim=8, num_heads=2, num_layers=1, mlp_ratio=2),
            pixels=PixelConfig(channels=2),
            vector=net,
            rssm=RSSMConfig(num_latents=4, num_classes=4, deter=16, hidden=16),
            head=net,
            task=TaskConfig(layers=1, units=16),
        ),
        behavior=BehaviorConfig(imag_horizon=4, actor=net, critic=net, slow_critic_every=4),
        oracle_boxes=OracleBoxesConfig(num_objects=2),
        batch_size=3,
        batch_length=5,
        prefill_steps=25,
        log_every=2,
        checkpoint_every=20,
    )
