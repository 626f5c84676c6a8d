"""The autoencoder: sizes of the paper, masking, what may and may not reach the output."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.nn import functional as F

from langwm_data.config_io import load_config
from pretrain.batch import TextTokens
from pretrain.config import MAEConfig, PretrainConfig, TextConfig
from pretrain.losses import mae_loss
from pretrain.mae import IMAGENET_MEAN, IMAGENET_STD, LanguageGroundedMAE, random_masking


@pytest.fixture
def mae(mae_config, make_text):
    torch.manual_seed(0)
    return LanguageGroundedMAE(mae_config, TextConfig(), make_text(1)).eval()


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


@given(num_patches=st.integers(1, 90), data=st.data(), seed=st.integers(0, 2**32))
@settings(max_examples=40, deadline=None)
def test_ids_restore_inverts_the_shuffle(num_patches, data, seed):
    num_kept = data.draw(st.integers(1, num_patches))
    ids_keep, ids_restore = random_masking(torch.rand(3, num_patches, generator=generator(seed)), num_kept)
    tokens = torch.arange(num_patches).expand(3, -1)
    kept = tokens.gather(1, ids_keep)
    filled = torch.cat([kept, torch.full((3, num_patches - num_kept), -1)], dim=1).gather(1, ids_restore)
    is_kept = ids_restore < num_kept
    assert torch.equal(filled, torch.where(is_kept, tokens, -1))
    assert torch.equal(is_kept.sum(dim=1), torch.full((3,), num_kept))


def test_masks_differ_between_images_and_repeat_with_the_seed():
    first, _ = random_masking(torch.rand(2, 80, generator=generator(1)), 20)
    again, _ = random_masking(torch.rand(2, 80, generator=generator(1)), 20)
    assert torch.equal(first, again)
    assert not torch.equal(first[0], first[1])


def test_token_counts_of_the_paper(make_text, make_batch):
    config = MAEConfig()
    model = LanguageGroundedMAE(config, TextConfig(), make_text(1, width=768)).eval()
    seen = []
    for name in ("encoder", "decoder"):
        getattr(model, name).register_forward_pre_hook(
            lambda _, arguments, name=name: seen.append((name, arguments[0].shape[1]))
        )
    batch = make_batch(config, batch_size=1, text_width=768)
    with torch.no_grad():
        model(batch, model.token_noise(1, generator()))
    features = model.encode(batch.rgb)
    assert seen == [("encoder", 1 + 20 + 21), ("decoder", 1 + 80 + 1), ("encoder", 1 + 80 + 21)]
    assert features.shape == (1, 1 + 80, 256)
    assert config.grid == (8, 10)
    assert config.patch_px**2 == 16 * 16


def test_parameters_are_as_many_as_the_papers_table_makes(make_text):
    config = load_config(PretrainConfig, "pretrain", presets=["paper"])
    mae = LanguageGroundedMAE(config.mae, config.text, make_text(1, width=768))
    convolutions = 16 * (3 * 32 + 32 * 64 + 64 * 128 + 128 * 256) + 32 + 64 + 128 + 256
    block = 4 * (256 * 256 + 256) + 2 * 4 * 256 * 256 + 5 * 256 + 4 * 256
    patchify, language, norms = 256 * 256 + 256, 768 * 256 + 256, 2 * 2 * 256
    decoder_embed, heads, tokens = 256 * 256 + 256, 256 * 256 + 256 + 257, 6 * 256
    counted = convolutions + patchify + language + 7 * block + norms + decoder_embed + heads + tokens
    assert sum(p.numel() for p in mae.parameters()) == counted
    assert counted == pytest.approx(6.6e6, rel=0.02)


def test_forward_agrees_with_the_equations_written_out(mae, make_batch):
    """Row by row of Eq. 3 with PyTorch's functions, for one image and known masks."""
    batch, config = make_batch(mae.config, batch_size=1), mae.config
    with torch.no_grad():
        output = mae(batch, mae.token_noise(1, generator(4)))
    ids_keep, _ = random_masking(mae.token_noise(1, generator(4)), config.num_kept)

    pixels = batch.rgb[0].permute(2, 0, 1) / 255
    for c in range(3):
        pixels[c] = (pixels[c] - IMAGENET_MEAN[c]) / IMAGENET_STD[c]
    pixels[:, batch.is_hidden[0]] = 0
    x = pixels[None]
    for i in range(len(config.conv_channels)):
        layer = mae.convolutions[2 * i]
        x = F.elu(F.conv2d(x, layer.weight, layer.bias, stride=2, padding=1))
    x = F.conv2d(x, mae.convolutions[-1].weight, mae.convolutions[-1].bias).flatten(2)[0].T
    kept = (x + mae.patch_position + mae.image_modality)[ids_keep[0]]
    words = F.linear(batch.text.embed[0, :20], mae.text_proj.weight, mae.text_proj.bias) + mae.text_modality
    pooled = (
        F.linear(batch.text.embed[0, 20:], mae.text_proj.weight, mae.text_proj.bias) + mae.pooled_modality
    )
    is_word = batch.text.attend[0, :20]
    sequence = torch.cat([mae.cls_token[None], kept, words[is_word], pooled])[None]
    states = mae.encoder(sequence)[0, : 1 + config.num_kept]

    tokens = F.linear(states, mae.decoder_embed.weight, mae.decoder_embed.bias)
    grid = mae.mask_token.expand(config.num_patches, -1).clone()
    grid[ids_keep[0]] = tokens[1:]
    reward = (mae.reward_token + mae.reward_position[0])[None]
    decoded = mae.decoder(torch.cat([tokens[:1], grid + mae.patch_position, reward])[None])[0]
    patches = F.linear(decoded[1:-1], mae.image_head.weight, mae.image_head.bias)
    p, (rows, columns) = config.patch_px, config.grid
    for n in range(config.num_patches):
        row, column = divmod(n, columns)
        patch = output.depth[0, row * p : (row + 1) * p, column * p : (column + 1) * p]
        torch.testing.assert_close(patch, patches[n].reshape(p, p), rtol=1e-4, atol=1e-5)
    expected = F.linear(decoded[-1], mae.reward_head.weight, mae.reward_head.bias)
    torch.testing.assert_close(output.reward, expected, rtol=1e-4, atol=1e-5)
    assert rows * columns == len(patches)


def test_hidden_pixels_do_not_reach_the_output(mae, make_batch):
    batch = make_batch(mae.config)
    noise = torch.randint_like(batch.rgb, 256)
    changed = replace(batch, rgb=torch.where(batch.is_hidden[..., None], noise, batch.rgb))
    with torch.no_grad():
        assert torch.equal(
            mae(batch, mae.token_noise(2, generator())).depth,
            mae(changed, mae.token_noise(2, generator())).depth,
        )


def test_depth_and_reward_targets_do_not_reach_the_output(mae, make_batch):
    batch = make_batch(mae.config)
    changed = replace(batch, depth=batch.depth + 1, reward=batch.reward + 1)
    with torch.no_grad():
        assert torch.equal(
            mae(batch, mae.token_noise(2, generator())).depth,
            mae(changed, mae.token_noise(2, generator())).depth,
        )


def test_captions_reach_the_output_but_their_padding_does_not(mae, make_batch):
    batch = make_batch(mae.config)
    padded = torch.where(batch.text.attend[..., None], batch.text.embed, 7.0)
    same = replace(batch, text=replace(batch.text, embed=padded))
    other = replace(batch, text=replace(batch.text, embed=batch.text.embed.flip(0)))
    with torch.no_grad():
        depth = mae(batch, mae.token_noise(2, generator())).depth
        assert torch.equal(depth, mae(same, mae.token_noise(2, generator())).depth)
        assert not torch.equal(depth, mae(other, mae.token_noise(2, generator())).depth)


def test_every_weight_is_trained(mae, make_batch):
    loss, _ = mae_loss(
        mae(batch := make_batch(mae.config), mae.token_noise(2, generator())), batch, mae.config
    )
    loss.backward()
    assert [name for name, p in mae.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_encode_is_deterministic_and_ignores_the_mode(mae_config, make_text):
    torch.manual_seed(0)
    model = LanguageGroundedMAE(replace(mae_config, dropout=0.5), TextConfig(), make_text(1)).train()
    rgb = torch.randint(0, 256, (2, mae_config.height, mae_config.width, 3), dtype=torch.uint8)
    features = model.encode(rgb)
    assert model.training
    assert torch.equal(features, model.eval().encode(rgb))
    assert features.shape == (2, 1 + mae_config.num_patches, mae_config.dim)
    assert not features.requires_grad


def test_encode_leaves_a_part_that_alone_is_trained_as_it_was(mae_config, make_text):
    model = LanguageGroundedMAE(replace(mae_config, dropout=0.5), TextConfig(), make_text(1)).eval()
    rgb = torch.randint(0, 256, (1, mae_config.height, mae_config.width, 3), dtype=torch.uint8)
    expected = model.encode(rgb)
    model.encoder.train()
    assert torch.equal(model.encode(rgb), expected)
    assert model.encoder.training
    assert not model.training


def test_encode_equals_the_unmasked_encoder_with_the_empty_caption(mae, make_batch):
    batch = make_batch(mae.config)
    null = TextTokens(embed=mae.null_embed, attend=mae.null_attend)
    with torch.no_grad():
        expected = mae.encode_tokens(mae.patchify(batch.rgb[:1]), null)
    torch.testing.assert_close(mae.encode(batch.rgb)[:1], expected, rtol=1e-5, atol=1e-6)


def test_encode_refuses_frames_of_another_size(mae):
    with pytest.raises(ValueError, match=r"frames of shape \(8, 8, 3\); this model reads \(32, 48, 3\)"):
        mae.encode(torch.zeros(1, 8, 8, 3, dtype=torch.uint8))
