"""The language-grounded masked autoencoder: Eq. 3 from the hidden objects to depth and reward.

Owns the network and its file. Which objects are hidden and what is said about them is decided in
``object_masking``; captions become embeddings in ``language``; losses stand in ``losses``.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from einops import rearrange
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor, nn

from pretrain.batch import MAEBatch, TextTokens
from pretrain.config import MAEConfig, TextConfig
from pretrain.model_file import (
    Intrinsics,
    ModelFile,
    check_bytes,
    check_fit,
    find_model,
    load_model_file,
    save_model_file,
)
from pretrain.supplied import as_tensor, check_frames, check_masks, check_text
from pretrain.transformer import Transformer, grid_positions, sincos_2d

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)
INIT_STD = 0.02
"""Of learned tokens. Source: MAE."""
HEAD_GAIN = 0.01
"""Of the output layers: without it, predictions start as noise at every pixel, and unlearning that noise
takes longer than everything else. Source: ours."""


@dataclass(frozen=True, kw_only=True)
class MAEOutput:
    """What the autoencoder predicts."""

    image: Float[Tensor, "B C H W"]
    """The target: depth in units of ``MAEConfig.max_depth_m``, or colours in ImageNet's units."""
    reward: Float[Tensor, " B"]
    """In the units of ``MAEConfig.reward_loss``."""

    @property
    def depth(self) -> Float[Tensor, "B H W"]:
        """The target of a model of depth."""
        assert self.image.shape[1] == 1, "this model fills in colours"
        return self.image[:, 0]


def random_masking(
    noise: Float[Tensor, "B N"], num_kept: int
) -> tuple[Int[Tensor, "B M"], Int[Tensor, "B N"]]:
    """Choose the visual tokens that stay, for each image on its own.

    Args:
        noise: Uniform; the tokens with the least stay.
        num_kept: How many.

    Returns:
        ``ids_keep``, the tokens that stay, and ``ids_restore``, which puts kept and then removed
        tokens back into their order.

    Source: Eq. 1 (row 2); MAE (random_masking).
    """
    ids_shuffle = noise.argsort(dim=1)
    return ids_shuffle[:, :num_kept], ids_shuffle.argsort(dim=1)


def _take(tokens: Float[Tensor, "B N D"], ids: Int[Tensor, "B M"]) -> Float[Tensor, "B M D"]:
    first = tokens.shape[1] * torch.arange(len(ids), device=ids.device)[:, None]
    return tokens.flatten(0, 1).index_select(0, (first + ids).flatten()).unflatten(0, ids.shape)


class EarlyConvolutions(nn.Sequential):
    """Convolutions of stride 2, then one token per cell (a patchify layer of patch size 1).

    Source: Eq. 3 (row 2), Sec. 4.1, Table 2. "SAME" padding of a kernel of 4 at stride 2 is 1.
    """

    def __init__(self, channels: Sequence[int], dim: int) -> None:
        layers: list[nn.Module] = []
        for before, after in zip((3, *channels[:-1]), channels, strict=True):
            layers += [nn.Conv2d(before, after, kernel_size=4, stride=2, padding=1), nn.ELU(inplace=True)]
        super().__init__(*layers, nn.Conv2d(channels[-1], dim, kernel_size=1))


class LanguageGroundedMAE(nn.Module):
    """RGB with hidden objects and a caption in; depth of the whole frame and reward out.

    Args:
        config: Sizes.
        text: Which text encoder the captions come from; kept with the weights.
        null_text: Embedding of the empty caption, one row; kept with the weights, so that ``encode``
            never needs the text encoder.
    """

    patch_position: Tensor
    reward_position: Tensor
    pixel_mean: Tensor
    pixel_std: Tensor
    null_embed: Tensor
    null_attend: Tensor

    def __init__(self, config: MAEConfig, text: TextConfig, null_text: TextTokens) -> None:
        super().__init__()
        self.config = config
        self.text = text
        self.intrinsics: Intrinsics | None = None
        """Of the camera whose frames it learns from, if that is known; kept with the weights."""
        dim = config.dim
        self.convolutions = EarlyConvolutions(config.conv_channels, dim)
        self.text_proj = nn.Linear(null_text.embed.shape[-1], dim)
        self.cls_token = _token(dim)
        self.mask_token = _token(dim)
        self.reward_token = _token(dim)
        self.image_modality = _token(dim)
        self.text_modality = _token(dim)
        self.pooled_modality = _token(dim)
        self.encoder = _make_transformer(config, config.encoder_layers)
        self.decoder_embed = nn.Linear(dim, dim)
        self.decoder = _make_transformer(config, config.decoder_layers)
        self.image_head = nn.Linear(dim, config.num_channels * config.patch_px**2)
        self.reward_head = nn.Linear(dim, 1)
        for head in (self.image_head, self.reward_head):
            nn.init.xavier_uniform_(head.weight, gain=HEAD_GAIN)
            nn.init.zeros_(head.bias)

        rows, columns = (torch.tensor([size]) for size in config.grid)
        self._constant("patch_position", grid_positions(config.grid, dim))
        self._constant("reward_position", sincos_2d(rows, columns, dim))
        self._constant("pixel_mean", 255 * torch.tensor(IMAGENET_MEAN).repeat(config.width))
        self._constant("pixel_std", 255 * torch.tensor(IMAGENET_STD).repeat(config.width))
        self.register_buffer("null_embed", null_text.embed[:1].float().clone())
        self.register_buffer("null_attend", null_text.attend[:1].clone())

    def _constant(self, name: str, value: Tensor) -> None:
        self.register_buffer(name, value, persistent=False)

    @property
    def device(self) -> torch.device:
        """Where the weights are."""
        return self.cls_token.device

    def null_text(self, batch_size: int) -> TextTokens:
        """The empty caption, once for each image, without unseen places for more sentences."""
        length = self.text.num_tokens + 1
        return TextTokens(
            embed=self.null_embed[:, :length].expand(batch_size, -1, -1),
            attend=self.null_attend[:, :length].expand(batch_size, -1),
        )

    def patchify(
        self, rgb: UInt8[Tensor, "B H W 3"], is_hidden: Bool[Tensor, "B H W"] | None = None
    ) -> Float[Tensor, "B N D"]:
        """Pixels to visual tokens with positions; hidden pixels take the ImageNet mean.

        Source: Eq. 3 (rows 1 and 2).
        """
        rows = rearrange(rgb, "b h w c -> b h (w c)").float()  # whole rows at a time: twice as fast
        pixels = rearrange(rows.sub_(self.pixel_mean).div_(self.pixel_std), "b h (w c) -> b h w c", c=3)
        if is_hidden is not None:
            pixels = pixels.mul_(~is_hidden[..., None])
        tokens = rearrange(self.convolutions(rearrange(pixels, "b h w c -> b c h w")), "b d h w -> b (h w) d")
        assert tokens.shape[1] == self.config.num_patches
        return tokens + (self.patch_position + self.image_modality)

    def encode_tokens(self, visual: Float[Tensor, "B M D"], text: TextTokens) -> Float[Tensor, "B 1+M D"]:
        """CLS, visual and language tokens through the encoder; language is sliced off again.

        Source: Eq. 3 (rows 5 to 7).
        """
        batch_size, num_visual = visual.shape[:2]
        cls = self.cls_token.expand(batch_size, 1, -1)
        # The last token of every sentence's place is its pooled one; there may be fewer places than allowed.
        place = torch.stack([*[self.text_modality] * self.text.num_tokens, self.pooled_modality])
        num_places = text.embed.shape[1] // len(place)
        language = self.text_proj(text.embed) + place.repeat(num_places, 1)
        attend = torch.cat([text.attend.new_ones(batch_size, 1 + num_visual), text.attend], dim=1)
        tokens = self.encoder(torch.cat([cls, visual, language], dim=1), attend)
        return tokens[:, : 1 + num_visual]

    def decode_tokens(
        self, tokens: Float[Tensor, "B cls_and_M D"], ids_restore: Int[Tensor, "B N"]
    ) -> tuple[Float[Tensor, "B C H W"], Float[Tensor, " B"]]:
        """Fill the gaps with mask tokens, append the reward token, and read the target and the reward.

        Source: Eq. 3 (row 8). The reward token has its own head, unlike in MWM's code (decision 33).
        """
        tokens = self.decoder_embed(tokens)
        batch_size, num_patches = ids_restore.shape
        gaps = self.mask_token.to(tokens.dtype).expand(batch_size, num_patches + 1 - tokens.shape[1], -1)
        visual = _take(torch.cat([tokens[:, 1:], gaps], dim=1), ids_restore) + self.patch_position
        reward = (self.reward_token + self.reward_position).expand(batch_size, 1, -1)
        tokens = self.decoder(torch.cat([tokens[:, :1], visual, reward], dim=1))
        rows, columns = self.config.grid
        image = rearrange(
            self.image_head(tokens[:, 1:-1]),
            "b (r c) (k y x) -> b k (r y) (c x)",
            r=rows,
            c=columns,
            k=self.config.num_channels,
            y=self.config.patch_px,
        )
        return image.float(), self.reward_head(tokens[:, -1])[:, 0].float()

    def token_noise(self, num_images: int, generator: torch.Generator) -> Float[Tensor, "B N"]:
        """What decides which tokens are dropped; on the CPU, so that every device drops the same ones."""
        return torch.rand(num_images, self.config.num_patches, generator=generator)

    def forward(self, batch: MAEBatch, noise: Float[Tensor, "B N"]) -> MAEOutput:
        """Predict the target and the reward from a batch, dropping visual tokens at ``mask_ratio``.

        Args:
            batch: On the device of the weights.
            noise: From ``token_noise``.
        """
        return self._predict(
            self.patchify(batch.rgb, batch.is_hidden), batch.text, noise, self.config.num_kept
        )

    def _predict(
        self, visual: Float[Tensor, "B N D"], text: TextTokens, noise: Float[Tensor, "B N"], num_kept: int
    ) -> MAEOutput:
        """The target and the reward from the ``num_kept`` visual tokens with the least noise."""
        ids_keep, ids_restore = random_masking(noise, num_kept)
        ids_keep, ids_restore = ids_keep.to(visual.device), ids_restore.to(visual.device)
        tokens = self.encode_tokens(_take(visual, ids_keep), text)
        image, reward = self.decode_tokens(tokens, ids_restore)
        return MAEOutput(image=image, reward=reward)

    @torch.no_grad()
    def fill_in(
        self,
        rgb: UInt8[Tensor | np.ndarray, "B H W 3"],
        *,
        text: TextTokens | None = None,
        is_hidden: Bool[Tensor | np.ndarray, "B H W"] | None = None,
        is_dropped: Bool[Tensor | np.ndarray, "B N"] | None = None,
    ) -> MAEOutput:
        """Predict the target of frames that somebody masked; dropout is off.

        NumPy arrays go to the device of the weights.

        Args:
            rgb: Frames.
            text: Captions, from ``FrozenText.embed``; the empty caption if not given.
            is_hidden: Pixels that are not to be seen, such as ``supplied.boxes_mask`` gives them.
            is_dropped: Visual tokens that are left out, as many in every frame.

        Raises:
            ValueError: If the frames are not of the type or size this model was trained on, or a mask or the
                captions are of another shape, or another number of tokens is dropped in some frame, or all.
        """
        rgb = as_tensor(rgb, self.device)
        is_hidden = None if is_hidden is None else as_tensor(is_hidden, self.device)
        is_dropped = None if is_dropped is None else as_tensor(is_dropped, self.device)
        check_frames(rgb, self.config)
        check_masks(len(rgb), self.config, is_hidden, is_dropped)
        check_text(len(rgb), self.null_embed, text)
        num_patches = self.config.num_patches
        if is_dropped is None:
            is_dropped = torch.zeros(len(rgb), num_patches, dtype=torch.bool, device=rgb.device)
        num_kept = num_patches - int(is_dropped[:1].sum())
        with evaluating(self):
            # Among the tokens that stay, and among those that go, the order is kept.
            noise = is_dropped.float() + torch.arange(num_patches, device=rgb.device) / (2 * num_patches)
            told = self.null_text(len(rgb)) if text is None else text
            return self._predict(self.patchify(rgb, is_hidden), told, noise, num_kept)

    @torch.no_grad()
    def encode(self, rgb: UInt8[Tensor | np.ndarray, "B H W 3"]) -> Float[Tensor, "B cls_and_N D"]:
        """Features of frames for the world model: CLS first, then one token per cell of the grid.

        Nothing is hidden or dropped, the caption is empty, dropout is off: the same frames give the
        same bytes. NumPy arrays go to the device of the weights.

        Raises:
            ValueError: If the frames are not of the type or size this model was trained on.
        """
        rgb = as_tensor(rgb, self.device)
        check_frames(rgb, self.config)
        with evaluating(self):
            return self.features(rgb)

    def features(self, rgb: UInt8[Tensor, "B H W 3"]) -> Float[Tensor, "B cls_and_N D"]:
        """What ``encode`` gives, as a plain function of tensors: with gradients, in the mode of the model."""
        return self.encode_tokens(self.patchify(rgb), self.null_text(rgb.shape[0])).float()

    def save_pretrained(self, folder: Path) -> None:
        """Write ``config.json`` and ``model.safetensors``."""
        save_model_file(folder, ModelFile(self.config, self.text, self.state_dict(), self.intrinsics))

    @classmethod
    def from_pretrained(cls, folder: Path | str) -> "LanguageGroundedMAE":
        """Read what ``save_pretrained`` wrote, from its folder or from the run that holds it.

        What is no folder here and looks like the name of a repository, such as ``somebody/langwm-homes``, is
        fetched from the Hugging Face hub.

        Raises:
            ValueError: If there is no model, or it is damaged or of another architecture.
        """
        folder = find_model(folder)
        config, text, tensors, intrinsics = load_model_file(folder)
        size = (1, text.num_language_tokens)
        width = tensors.get("null_embed", torch.empty(1)).shape[-1]
        null = TextTokens(embed=torch.empty(*size, width), attend=torch.empty(size, dtype=torch.bool))
        model = cls(config, text, null)
        check_fit(folder, model.state_dict(), tensors)
        check_bytes(folder)
        model.load_state_dict(tensors)
        model.intrinsics = intrinsics
        return model.eval()


@contextmanager
def evaluating(module: nn.Module) -> Iterator[None]:
    """Dropout off for a while; each part of ``module`` is then as it was."""
    training = [part for part in module.modules() if part.training]
    for part in training:
        part.training = False
    try:
        yield
    finally:
        for part in training:
            part.training = True


def _token(dim: int) -> nn.Parameter:
    return nn.Parameter(torch.randn(dim) * INIT_STD)


def _make_transformer(config: MAEConfig, num_layers: int) -> Transformer:
    return Transformer(
        config.dim,
        num_layers,
        config.num_heads,
        mlp_ratio=config.mlp_ratio,
        dropout=config.dropout,
        eps=config.layer_norm_eps,
    )
