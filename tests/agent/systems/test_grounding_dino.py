import dataclasses
import json
import math

import numpy as np
import pytest
import torch

from agent.config import AgentConfig, GroundingDinoConfig
from agent.systems.agent import Agent
from agent.systems.grounding_dino import GroundingDino, load_grounding_dino, make_prompt, wrap_env
from agent.train import train_agent
from langwm_data.config import ScenesConfig
from langwm_data.config_io import ConfigError
from langwm_data.scenes.taxonomy import CATEGORIES
from pretrain.metrics import read_metrics

PROMPT = "chair. office chair. bed."
SMALL = {"d_model": 32, "encoder_layers": 1, "decoder_layers": 2, "num_queries": 9}
HEADS = {"encoder_attention_heads": 2, "decoder_attention_heads": 2}
WIDTHS = {"encoder_ffn_dim": 16, "decoder_ffn_dim": 16}


def write_dino(folder, patch_size=4, **changes):
    """A Grounding DINO with random weights that knows a handful of words."""
    from transformers import BertConfig, BertTokenizer, SwinConfig
    from transformers import GroundingDinoConfig as Sizes
    from transformers import GroundingDinoForObjectDetection as Detector

    folder.mkdir()
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "chair", "office", "bed"]
    (folder / "vocab.txt").write_text("\n".join(words))
    BertTokenizer(str(folder / "vocab.txt")).save_pretrained(folder)
    bert = {"hidden_size": 8, "num_hidden_layers": 1, "num_attention_heads": 2, "intermediate_size": 8}
    text = BertConfig(vocab_size=1030, **bert)
    backbone = SwinConfig(
        embed_dim=8,
        depths=[1, 1, 1, 1],
        num_heads=[1, 1, 1, 1],
        window_size=4,
        patch_size=patch_size,
        out_features=["stage2", "stage3", "stage4"],
    )
    sizes = Sizes(backbone_config=backbone, text_config=text, **SMALL, **HEADS, **WIDTHS, **changes)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        Detector(sizes).save_pretrained(folder)
    return str(folder)


@pytest.fixture(scope="module")
def tiny_dino(tmp_path_factory):
    return write_dino(tmp_path_factory.mktemp("dino") / "model")


def make_config(name, **changes):
    return GroundingDinoConfig(model=name, **({"short_side_px": 96, "num_objects": 4} | changes))


def make_frame(seed=0, height=32, width=40):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_vector_holds_what_transformers_own_processor_and_model_give(tiny_dino):
    """Levels cut out by the encoder's own account of their sizes, detections by their own scores."""
    dino = GroundingDino(make_config(tiny_dino), PROMPT)
    vector = dino.describe(make_frame())
    tokenizer, model = load_grounding_dino(tiny_dino)
    shapes = []
    model.model.encoder.register_forward_pre_hook(
        lambda module, args, kwargs: shapes.extend(kwargs["spatial_shapes_list"]), with_kwargs=True
    )
    with torch.no_grad():
        out = model.eval()(pixel_values=dino._prepare(make_frame()), **tokenizer(PROMPT, return_tensors="pt"))
    assert shapes == [(12, 15), (6, 8), (3, 4), (2, 2)]
    tokens, levels = out.encoder_last_hidden_state_vision[0], []
    for height, width in shapes:
        levels.append(tokens[: height * width].mean(0))
        tokens = tokens[height * width :]
    assert len(tokens) == 0
    score = out.logits[0].sigmoid().max(-1).values
    order = torch.argsort(score, descending=True)[:4]
    found = torch.cat([out.last_hidden_state[0], out.pred_boxes[0], score[:, None]], -1)[order]
    expected = torch.cat([*levels, found.mean(0), found.max(0).values])
    assert dino.feature_dim == len(vector) == 4 * 32 + 2 * (32 + 5)
    np.testing.assert_allclose(vector, expected.numpy(), atol=1e-5)


@pytest.mark.parametrize(("height", "width"), [(33, 50), (64, 64), (40, 200)])
def test_frames_of_any_shape_are_read(tiny_dino, height, width):
    dino = GroundingDino(make_config(tiny_dino, short_side_px=90), PROMPT)
    vector = dino.describe(make_frame(0, height, width))
    assert vector.shape == (dino.feature_dim,)
    assert np.isfinite(vector).all()


@pytest.mark.parametrize(("height", "width"), [(128, 160), (100, 400)])
def test_frames_are_enlarged_and_normalised_as_by_transformers_own_processor(tiny_dino, height, width):
    from transformers.models.grounding_dino.image_processing_pil_grounding_dino import (
        GroundingDinoImageProcessorPil,
    )

    frame = make_frame(0, height, width)
    ours = GroundingDino(make_config(tiny_dino, short_side_px=800), PROMPT)._prepare(frame)
    theirs = GroundingDinoImageProcessorPil()(images=frame, return_tensors="pt")["pixel_values"]
    torch.testing.assert_close(ours, theirs, atol=0.02, rtol=0)


def test_places_of_the_papers_frame_are_counted_as_published():
    """16,658 visual tokens at 800 x 1000 pixels."""
    counts = [math.prod(math.ceil(edge / stride) for edge in (800, 1000)) for stride in (8, 16, 32, 64)]
    assert sum(counts) == 16_658


def test_the_same_frame_gives_the_same_vector(tiny_dino):
    dino = GroundingDino(make_config(tiny_dino), PROMPT)
    first, other = dino.describe(make_frame()), dino.describe(make_frame(1))
    np.testing.assert_array_equal(first, dino.describe(make_frame()))
    assert np.abs(first - other).max() > 1e-3


def test_the_prompt_has_all_categories_of_furniture_and_no_walls():
    prompt = make_prompt(ScenesConfig())
    parts = prompt.removesuffix(".").split(". ")
    assert set(parts) == {c.phrase.lower() for n, c in CATEGORIES.items() if n != "door_frame"}
    assert len(parts) == len(set(parts)) >= 50
    assert not {"wall", "floor", "ceiling"} & set(parts)
    assert "treadmill" in make_prompt(ScenesConfig(igibson="somewhere"))


def test_the_environment_shows_the_vector(tiny_dino, make_room):
    scenes = AgentConfig()
    config = dataclasses.replace(scenes, grounding_dino=make_config(tiny_dino))
    env = wrap_env(config, make_room())
    obs, _ = env.reset(seed=0)
    assert obs["features"].shape == (4 * 32 + 2 * 37,)
    assert env.observation_space.contains(obs | {"task": obs["task"]})


def test_a_run_learns_from_the_vector_and_hands_on_an_agent(tiny_dino, tiny_config, make_room, tmp_path):
    config = dataclasses.replace(
        tiny_config, system="dreamerv2-grounding-dino", grounding_dino=make_config(tiny_dino), steps=30
    )
    run = train_agent(config, tmp_path / "run", env=make_room(max_steps=9))
    assert any("wm/vector_loss" in row for row in read_metrics(run))
    agent = Agent.from_pretrained(run)
    assert agent.spaces.feature_dim == 4 * 32 + 2 * 37
    assert agent.act(agent.wrap_env(make_room()).reset(seed=0)[0])[0].shape == (2,)


def test_weights_out_of_reach_are_one_sentence(tmp_path):
    for name in (str(tmp_path), str(tmp_path / "nowhere")):
        with pytest.raises(ConfigError, match=r"grounding_dino\.model .* cannot be loaded; give the name"):
            load_grounding_dino(name)


def test_another_kind_of_model_is_refused(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "bert"}))
    with pytest.raises(
        ConfigError, match=r"grounding_dino\.model .* is no Grounding DINO but of type 'bert'"
    ):
        load_grounding_dino(str(tmp_path))


def test_a_model_that_cannot_read_all_categories_is_refused(tmp_path):
    name = write_dino(tmp_path / "short", max_text_len=5)
    with pytest.raises(ConfigError, match=r"reads 5 tokens but the categories of all training floors are 9"):
        GroundingDino(make_config(name), PROMPT)


def test_a_model_of_other_levels_is_refused(tmp_path):
    name = write_dino(tmp_path / "coarse", patch_size=8)
    with pytest.raises(ConfigError, match=r"has 108 visual tokens for a frame of 128 x 160 pixels; 426 are"):
        GroundingDino(make_config(name, short_side_px=128), PROMPT).describe(make_frame())


def test_damaged_weights_are_refused(tmp_path):
    name = write_dino(tmp_path / "damaged")
    path = tmp_path / "damaged" / "model.safetensors"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ConfigError, match=r"grounding_dino\.model .* cannot be loaded"):
        load_grounding_dino(name)
