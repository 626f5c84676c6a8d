"""Things small enough to train in seconds: frames of coloured boxes, a random BERT, a narrow autoencoder."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
import torch

from langwm_data import atomic
from langwm_data.config import LabelsConfig
from langwm_data.labels.captions import TEMPLATES
from langwm_data.labels.instances import label_frame
from langwm_data.scenes.spec import InstanceName
from langwm_data.scenes.taxonomy import phrase
from langwm_data.seeding import make_rng
from langwm_data.shards.finish import Origin, finish_dataset
from langwm_data.shards.manifest import CameraRecord
from langwm_data.shards.sample import Sample
from langwm_data.shards.writer import write_shard
from pretrain.batch import MAEBatch, TextTokens
from pretrain.config import MAEConfig, ObjectMaskConfig, OptimConfig, PretrainConfig, TextConfig
from pretrain.frames import FrameBatch, FrameObject
from pretrain.language import FrozenText

HEIGHT, WIDTH = 32, 48
CATEGORIES = {1: "chair", 2: "sofa", 3: "bed"}
TEXT_WIDTH = 16


def draw_frame(rng):
    """A wall with up to two flat objects before it: colours, depth in metres, instance ids."""
    depth = np.full((HEIGHT, WIDTH), rng.uniform(5, 9), dtype=np.float32)
    instance = np.zeros((HEIGHT, WIDTH), dtype=np.uint16)
    rgb = np.full((HEIGHT, WIDTH, 3), 200, dtype=np.uint8)
    for number in rng.permutation([1, 2, 3])[: rng.integers(1, 3)].tolist():
        x, y = int(rng.integers(0, WIDTH - 16)), int(rng.integers(0, HEIGHT - 12))
        where = np.s_[y : y + int(rng.integers(6, 12)), x : x + int(rng.integers(8, 16))]
        depth[where], instance[where] = rng.uniform(1, 5), number
        rgb[where] = (60 * number, 250 - 60 * number, 30 * number)
    rgb = np.clip(rgb * (1 - depth[..., None] / 20), 0, 255).astype(np.uint8)
    return rgb, np.round(depth, 3).astype(np.float32), instance


def make_sample(split, number):
    rng = make_rng(0, split, number)
    rgb, depth, instance = draw_frame(rng)
    table = {i: InstanceName(c, f"{c}_01", phrase(c)) for i, c in CATEGORIES.items()}
    labels = label_frame(instance, depth, table, LabelsConfig(), rng)
    pose = np.eye(4).tolist()
    meta = {
        "scene": f"{split}_0",
        "building": split,
        "floor": 0,
        "split": split,
        "palette": [],
        "lights": {
            "ambient": [0.5] * 3,
            "sun": [0.25] * 3,
            "lamp": [0.5] * 3,
            "sun_direction": [0.0, 0.0, 1.0],
        },
        "trajectory": -1,
        "step": 0,
        "action": [0.0, 0.0],
        "pose": [0.0, 0.0, 0.0],
        "camera": {"K": [[30.0, 0.0, 24.0], [0.0, 30.0, 16.0], [0.0, 0.0, 1.0]], "camera_to_world": pose}
        | {"height": HEIGHT, "width": WIDTH, "yaw_rad": 0.0, "pitch_rad": 0.0},
        "objects": [dataclasses.asdict(label) for label in labels],
    }
    return Sample(
        key=f"{split}_0-{number:06d}", rgb=rgb, depth=depth, instance=instance, meta=meta, caption=""
    )


def write_dataset(folder, num_train=12, num_test=8, fingerprint="a"):
    """Shards as stage one writes them, of drawn frames."""
    camera = CameraRecord(
        height=HEIGHT, width=WIDTH, K=make_sample("train", 0).meta["camera"]["K"], depth_unit_m=0.001
    )
    origin = Origin(
        generator="test",
        fingerprint=fingerprint,
        physics="none",
        renderer="none",
        config={},
        sources={},
        camera=camera,
    )
    counts = {"train": num_train, "test": num_test}
    records = [
        write_shard(folder, split, 0, [make_sample(split, n) for n in range(count)])
        for split, count in counts.items()
        if count
    ]
    for split in counts:
        atomic.write_text(folder / f"scenes/{split}_0.json", "{}")
    finish_dataset(folder, records, origin)
    return folder


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Models this small gain nothing from a second one, and lose much where others use it."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def data_folder(tmp_path_factory):
    """A dataset of 12 training and 8 test frames of 32x48."""
    return write_dataset(tmp_path_factory.mktemp("data") / "small")


@pytest.fixture(scope="session")
def bert_folder(tmp_path_factory):
    """A BERT of two narrow layers with random weights and a vocabulary of the words in captions."""
    from transformers import BertConfig, BertModel, BertTokenizer

    folder = tmp_path_factory.mktemp("bert")
    words = " ".join(TEMPLATES) + " meter meters half a left right front outer chair sofa bed"
    for sign in "{}.,":
        words = words.replace(sign, f" {sign} ")
    vocabulary = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *map(str, range(11))]
    vocabulary += sorted(set(words.lower().split()))
    (folder / "vocab.txt").write_text("\n".join(vocabulary))
    BertTokenizer(vocab={word: i for i, word in enumerate(vocabulary)}).save_pretrained(folder)
    config = BertConfig(
        vocab_size=len(vocabulary),
        hidden_size=TEXT_WIDTH,
        num_hidden_layers=2,
        num_attention_heads=2,
        intermediate_size=32,
    )
    with torch.random.fork_rng([]):
        torch.manual_seed(0)
        BertModel(config).save_pretrained(folder)
    return folder


@pytest.fixture(scope="session")
def text(bert_folder):
    return FrozenText(TextConfig(model=str(bert_folder)))


@pytest.fixture(scope="session")
def mae_config():
    return MAEConfig(
        height=HEIGHT,
        width=WIDTH,
        conv_channels=(8, 16, 16),
        dim=32,
        encoder_layers=1,
        decoder_layers=1,
        mask_ratio=0.5,
        dropout=0.0,
    )


@pytest.fixture
def pretrain_config(mae_config, bert_folder):
    return PretrainConfig(
        steps=4,
        batch_size=4,
        mae=replace(mae_config, dropout=0.1),
        text=TextConfig(model=str(bert_folder)),
        objects=ObjectMaskConfig(max_objects=2, caption_dropout=0.2, box_dropout=0.2),
        optimizer=OptimConfig(learning_rate=1e-3, warmup_steps=2),
        log_every=1,
        valid_every=2,
        valid_frames=4,
        checkpoint_every=2,
    )


def random_text(batch_size=1, num_words=20, width=TEXT_WIDTH, seed=0):
    """Language tokens of captions of random length."""
    generator = torch.Generator().manual_seed(seed)
    lengths = torch.randint(2, num_words + 1, (batch_size, 1), generator=generator)
    attend = torch.arange(num_words) < lengths
    return TextTokens(
        embed=torch.randn(batch_size, num_words + 1, width, generator=generator),
        attend=torch.cat([attend, torch.ones(batch_size, 1, dtype=torch.bool)], dim=1),
    )


def random_batch(config, batch_size=2, seed=0, text_width=TEXT_WIDTH):
    """A batch of noise, each frame with a box, every second with a reward."""
    generator = torch.Generator().manual_seed(seed)
    size = (batch_size, config.height, config.width)
    is_hidden = torch.zeros(size, dtype=torch.bool)
    is_hidden[:, 8:20, 10:30] = True
    return MAEBatch(
        rgb=torch.randint(0, 256, (*size, 3), generator=generator, dtype=torch.uint8),
        is_hidden=is_hidden,
        depth=torch.rand(size, generator=generator) * 12,
        text=random_text(batch_size, width=text_width),
        captions=("",) * batch_size,
        is_truncated=torch.zeros(batch_size, dtype=torch.bool),
        reward=torch.randn(batch_size, generator=generator) * 10,
        has_reward=torch.arange(batch_size) % 2 == 0,
    )


def drawn_frames(count, seed=0):
    """Frames as replay would hold them."""
    drawn = [draw_frame(make_rng(seed, n)) for n in range(count)]
    objects = [
        [object_of(instance == i, depth, CATEGORIES[i]) for i in np.unique(instance[instance > 0]).tolist()]
        for _, depth, instance in drawn
    ]
    return FrameBatch(
        rgb=np.stack([rgb for rgb, _, _ in drawn]),
        depth=np.stack([depth for _, depth, _ in drawn]),
        objects=objects,
        reward=np.linspace(-1, 10, count, dtype=np.float32),
        has_reward=np.ones(count, dtype=np.bool_),
    )


def object_of(mask, depth, category):
    ys, xs = np.nonzero(mask)
    box = (float(xs.min()), float(ys.min()), float(xs.max() + 1), float(ys.max() + 1))
    return FrameObject(
        category=category,
        bbox_xyxy=box,
        center_x=float(xs.mean() + 0.5),
        distance_m=float(depth[mask].mean()),
    )


@pytest.fixture(scope="session")
def make_text():
    return random_text


@pytest.fixture(scope="session")
def make_batch():
    return random_batch


@pytest.fixture(scope="session")
def make_frames():
    return drawn_frames


@pytest.fixture(scope="session")
def make_dataset():
    return write_dataset
