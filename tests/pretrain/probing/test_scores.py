"""Scores of features that are known to hold the answers, and of features that hold nothing."""

import numpy as np
import pyarrow as pa
import pytest
import torch

from pretrain.probing.features import PIXELS, TOKENS, SeenFrames, encode_pixels, mae_encoder, random_encoder
from pretrain.probing.scores import (
    BEARING,
    DISTANCE,
    NEXT,
    NEXT_BLIND,
    PRESENT,
    ROOM,
    make_tasks,
    score_dynamics,
    score_features,
)

ROOMS = ("bath", "hall", "study")
KNOWING, IGNORANT = ("knowing", "x"), ("ignorant", "x")


def seen_frames(count, seed, drive_length=10):
    """The knowing features are a mix of all answers; the ignorant ones are noise."""
    rng = np.random.default_rng(seed)
    room = rng.integers(3, size=count)
    has = rng.random((count, 2)) < 0.5
    obstacles = rng.normal(size=(count, 2))
    answers = np.concatenate([np.eye(3)[room], has, obstacles], axis=1)
    mix = np.random.default_rng(99).normal(size=(7, 12))
    table = pa.table(
        {
            "scene": [f"scene_{i // 60}" for i in range(count)],
            "trajectory": [i // drive_length for i in range(count)],
            "step": [i % drive_length for i in range(count)],
            "action": rng.normal(size=(count, 2)).tolist(),
            "key": [f"{seed}-{i}" for i in range(count)],
        }
    )
    return SeenFrames(
        table=table,
        rooms=[ROOMS[i] for i in room],
        categories=[[name for name, is_so in zip(("bed", "sofa"), row, strict=True) if is_so] for row in has],
        obstacles=obstacles,
        features={KNOWING: answers @ mix, IGNORANT: rng.normal(size=(count, 12))},
    )


@pytest.fixture(scope="module")
def scores():
    return score_features(seen_frames(600, 0), seen_frames(300, 1), 0)


def value(scores, encoder, task, reader="linear"):
    (found,) = [s for s in scores if (s.encoder, s.task, s.reader) == (encoder, task, reader)]
    assert found.low <= found.value <= found.high
    return found.value


def test_answers_that_are_in_the_features_are_read(scores):
    assert value(scores, "knowing", ROOM) > 0.98
    assert value(scores, "knowing", PRESENT) > 0.99
    assert value(scores, "knowing", DISTANCE) > 0.99
    assert value(scores, "knowing", BEARING) > 0.99
    assert value(scores, "knowing", ROOM, "kNN") > 0.9


def test_what_knows_nothing_scores_as_not_looking(scores):
    chance = {s.task: s.chance for s in scores}
    for reader in ("linear", "kNN"):
        assert value(scores, "ignorant", ROOM, reader) == pytest.approx(chance[ROOM], abs=0.1)
        assert value(scores, "ignorant", PRESENT, reader) == pytest.approx(0.5, abs=0.08)
        assert value(scores, "ignorant", DISTANCE, reader) == pytest.approx(0, abs=0.1)
    assert chance[PRESENT] == 0.5
    assert chance[DISTANCE] == pytest.approx(0, abs=1e-9)


def test_frames_without_an_answer_are_left_out():
    train, test = seen_frames(100, 0), seen_frames(60, 1)
    train.rooms[:30], test.obstacles[:20] = [""] * 30, np.nan
    test.rooms[:5] = ["garage"] * 5
    tasks = {task.name: task for task in make_tasks(train, test)}
    assert [rows.sum() for rows in tasks[ROOM].has_answer] == [70, 55]
    assert [rows.sum() for rows in tasks[DISTANCE].has_answer] == [100, 40]


def test_questions_with_one_answer_are_not_asked():
    train, test = seen_frames(100, 0), seen_frames(60, 1)
    train.rooms[:] = ["hall"] * 100
    test.obstacles[:] = np.nan
    few = [["bed"]] + [[]] * 99
    train.categories[:] = few
    assert make_tasks(train, test) == []


def moving(count, seed, force):
    """Features that follow linearly from those before and, by ``force``, from the action."""
    frames = seen_frames(count, seed)
    rng, fixed = np.random.default_rng(seed + 50), np.random.default_rng(98)
    turn, push = np.linalg.qr(fixed.normal(size=(6, 6)))[0], force * fixed.normal(size=(2, 6))
    actions = np.array(frames.table["action"].to_pylist())
    values = np.empty((count, 6))
    for i in range(count):
        values[i] = values[i - 1] @ turn + actions[i] @ push if i % 10 else rng.normal(size=6)
    still = np.repeat(rng.normal(size=(count // 10, 6)), 10, axis=0) + rng.normal(size=(count, 6))
    frames.features.update({("moving", "x"): values, ("noise", "x"): still})
    return frames


def test_linear_dynamics_are_foreseen():
    train, test = moving(600, 0, 3.0), moving(300, 1, 3.0)
    known, blind = score_dynamics(train, test, ("moving", "x"), 0)
    assert (known.task, blind.task) == (NEXT, NEXT_BLIND)
    assert known.value > 0.99
    assert 0.3 < blind.value < 0.95
    assert known.num_train == 540
    assert known.num_groups == 30


def test_actions_that_do_nothing_add_nothing():
    known, blind = score_dynamics(moving(600, 0, 0.0), moving(300, 1, 0.0), ("moving", "x"), 0)
    assert known.value == pytest.approx(blind.value, abs=1e-3)


def test_without_drives_there_are_no_dynamics():
    train, test = seen_frames(60, 0, drive_length=1), seen_frames(60, 1)
    assert score_dynamics(train, test, KNOWING, 0) == []


def test_encoders_give_the_features_they_name(model):
    rgb = np.random.default_rng(0).integers(0, 256, (3, 32, 48, 3), dtype=np.uint8)
    tokens = model.encode(torch.from_numpy(rgb)).numpy()
    found = mae_encoder(model)(rgb)
    np.testing.assert_allclose(found["CLS"], tokens[:, 0])
    np.testing.assert_allclose(found[TOKENS], tokens[:, 1:].mean(axis=1), atol=1e-6)
    np.testing.assert_allclose(encode_pixels(rgb)[PIXELS][1, :3], rgb[1, :8, :8].mean(axis=(0, 1)), atol=0.5)


def test_the_random_encoder_is_seeded_and_is_not_the_model(model):
    rgb = np.random.default_rng(0).integers(0, 256, (2, 32, 48, 3), dtype=np.uint8)
    first, again, other = (random_encoder(model, seed)(rgb)["CLS"] for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)
    assert not np.allclose(first, mae_encoder(model)(rgb)["CLS"])
