"""A model that believes every word, and frames whose objects stand at whole metres."""

import re
from dataclasses import replace

import pytest
import torch

from pretrain.batch import TextTokens
from pretrain.config import ObjectMaskConfig, TextConfig
from pretrain.dataset import open_split
from pretrain.language import FrozenText
from pretrain.mae import LanguageGroundedMAE, MAEOutput
from pretrain.probing.claims import RIGHT
from pretrain.probing.scene import make_probe_scene

SIZE = (32, 48)
OBJECTS = ObjectMaskConfig(max_objects=3, caption_dropout=0.5, box_dropout=0.5)
UNTOLD_M = 8.0
"""What the believer says behind a box of which it was told nothing."""


def said_m(text):
    found = re.search(r"(\d+|half a) meters?", text)
    return 0.0 if found is None else 0.5 if found.group(1) == "half a" else float(found.group(1))


class SayingText(FrozenText):
    """Embeds a caption as the number of metres it says."""

    def __init__(self):
        self.config = TextConfig()

    def embed(self, captions):
        embed = torch.zeros(len(captions), 21, 16)
        embed[:, 0, 0] = torch.tensor([said_m(caption) for caption in captions])
        attend = torch.ones(len(captions), 21, dtype=torch.bool)
        return TextTokens(embed=embed, attend=attend), torch.zeros(len(captions), dtype=torch.bool)


class BelievingMAE(LanguageGroundedMAE):
    """Sees true depth where nothing is hidden, and fills boxes with the distance that it is told."""

    def forward(self, batch, noise):
        told = batch.text.embed[:, 0, 0]
        told = torch.where(told > 0, told, torch.tensor(UNTOLD_M))
        depth = torch.where(batch.is_hidden, told[:, None, None], batch.depth) / self.config.max_depth_m
        return MAEOutput(image=depth[:, None], reward=torch.zeros(len(batch)))


@pytest.fixture
def held_out(data_folder):
    return open_split(data_folder, "test", SIZE, 64)


@pytest.fixture
def train_frames(data_folder):
    return open_split(data_folder, "train", SIZE, 64)


@pytest.fixture
def scene(held_out, text):
    return make_probe_scene(held_out, text, OBJECTS, num_frames=6, seed=0)


@pytest.fixture
def model(mae_config, text):
    torch.manual_seed(0)
    return LanguageGroundedMAE(mae_config, TextConfig(), text.null_text)


@pytest.fixture
def saying_text():
    return SayingText()


@pytest.fixture
def believer(mae_config, saying_text):
    return BelievingMAE(mae_config, TextConfig(), saying_text.embed([""])[0])


@pytest.fixture
def planted(held_out, saying_text):
    """Hidden objects stand exactly where their captions say."""
    scene = make_probe_scene(held_out, saying_text, OBJECTS, num_frames=8, seed=0)
    depth = scene.batch.depth.clone()
    for i, told in enumerate(scene.claims):
        depth[i][scene.is_object[i]] = said_m(told[RIGHT].text)
    return replace(scene, batch=replace(scene.batch, depth=depth))
