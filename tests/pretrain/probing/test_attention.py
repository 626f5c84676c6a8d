"""Recorded attention is the one that the network computes, beside PyTorch's own."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from einops import rearrange
from torch.nn.functional import scaled_dot_product_attention

from pretrain.config import TextConfig
from pretrain.language import POOLED, FrozenText
from pretrain.mae import LanguageGroundedMAE
from pretrain.probing.attention import attend_to_words, cells_inside, record_attention
from pretrain.transformer import Block, Transformer


@pytest.fixture
def attend():
    attend = torch.ones(2, 9, dtype=torch.bool)
    attend[0, 6:] = False
    return attend


def test_weights_are_those_of_pytorch(attend):
    torch.manual_seed(0)
    attention = Block(16, 4, 2, 0.0, 1e-6).attention
    x = torch.randn(2, 9, 16)
    found = attention.weights(x, attend)
    q, k, _ = rearrange(attention.qkv(x), "b n (three h d) -> three b h n d", three=3, h=4)
    one_each = torch.eye(9).expand(2, 4, 9, 9)
    expected = scaled_dot_product_attention(q, k, one_each, attn_mask=attend[:, None, None])
    torch.testing.assert_close(found, expected)
    torch.testing.assert_close(found.sum(dim=-1), torch.ones(2, 4, 9))
    assert (found[0, :, :, 6:] == 0).all()


def test_every_layer_is_recorded_once_and_only_inside_the_block(attend):
    torch.manual_seed(0)
    transformer = Transformer(16, 3, 4, mlp_ratio=2, dropout=0.0, eps=1e-6)
    x = torch.randn(2, 9, 16)
    with record_attention(transformer) as layers:
        inside = transformer(x, attend)
    first = transformer.blocks[0]
    torch.testing.assert_close(layers[0], first.attention.weights(first.norm1(x), attend))
    assert torch.equal(inside, transformer(x, attend))
    assert len(layers) == 3


def test_cells_and_cls_look_at_words_and_not_at_padding(mae_config, text):
    torch.manual_seed(0)
    mae = LanguageGroundedMAE(replace(mae_config, encoder_layers=2), TextConfig(), text.null_text).train()
    rgb = torch.randint(0, 256, (2, 32, 48, 3), dtype=torch.uint8)
    is_hidden = torch.zeros(2, 32, 48, dtype=torch.bool)
    captions = ["There is chair in the left 2 meters.", "There is bed in the front 1 meter."]
    tokens, _ = text.embed(captions)
    found = attend_to_words(mae, rgb, is_hidden, tokens)
    assert mae.training
    assert len(found) == 2
    for i, attention in enumerate(found):
        assert attention.cells.shape == (2, *mae_config.grid, 21)
        padding = ~tokens.attend[i].numpy()
        assert padding.any()
        assert (attention.cells[..., padding] == 0).all()
        assert (attention.cells[..., ~padding] > 0).all()
        assert 0 < attention.cls.sum(axis=1).max() < 1
    again = attend_to_words(mae, rgb[1:], is_hidden[1:], text.embed(captions[1:])[0])
    np.testing.assert_allclose(again[0].cells, found[1].cells, atol=1e-6)


def test_share_is_the_sum_over_words_and_the_mean_over_cells(mae_config, model, text):
    rgb = torch.randint(0, 256, (1, 32, 48, 3), dtype=torch.uint8)
    is_hidden = torch.zeros(1, 32, 48, dtype=torch.bool)
    is_hidden[:, 8:24, 8:24] = True
    (found,) = attend_to_words(model, rgb, is_hidden, text.embed(["There is bed in the left 2 meters."])[0])
    inside = cells_inside(is_hidden[0].numpy(), mae_config.grid)
    assert inside.sum() == 4
    assert inside[1:3, 1:3].all()
    expected = np.mean([found.cells[0, r, c].sum() for r in (1, 2) for c in (1, 2)])
    assert found.share(inside)[0] == pytest.approx(expected, rel=1e-5)
    assert np.isnan(found.share(np.zeros_like(inside))).all()


def test_every_language_token_has_its_word(text):
    words = text.words("There is chair in the left 2 meters.")
    assert len(words) == 21
    assert words[:4] == ["[CLS]", "there", "is", "chair"]
    assert words[-1] == POOLED
    attend = text.embed(["There is chair in the left 2 meters."])[0].attend[0]
    assert [bool(word) for word in words] == attend.tolist()


def test_words_of_several_sentences_stand_in_their_places(bert_folder):
    several = FrozenText(TextConfig(model=str(bert_folder), num_tokens=8, num_sentences=3))
    caption = "There is bed in the left 2 meters. In the right, bed is 1 meter to me."
    words, attend = several.words(caption), several.embed([caption])[0].attend[0]
    assert len(words) == 27
    assert (words[8], words[17], words[26]) == (POOLED, POOLED, "")
    assert words[9:12] == ["[CLS]", "in", "the"]
    assert [bool(word) for word in words] == attend.tolist()
