"""Does the world model foresee pixels? A square that actions push about on 32 x 32 pixels.

Nothing is random: the first frames and the actions say where the square will be. The model sees ``--context``
frames of sequences that it has never met, and then imagines the rest from the actions alone. Prints the error
of each imagined step beside three guesses: the mean of all frames, the last frame that was seen, and the
frame of another sequence. ``--picture`` shows truth, what the memory tells while it sees, and what
it imagines.

    python -m benchmarks.dreaming --updates 1500 --picture dreaming.png --out dreaming.json
"""

import argparse
import json
import time
from pathlib import Path

import cv2
import numpy as np
import torch
from torch import Tensor

from agent.config import LossScales, MLPConfig, PixelConfig, RSSMConfig, TaskConfig, WorldModelConfig
from agent.models.pixels import PixelModel, as_pixels, as_rgb
from agent.models.rssm import Latent
from agent.models.world_model import ModelBatch, WorldModel, world_model_loss
from langwm_data.seeding import make_rng
from pretrain.config import OptimConfig
from pretrain.optim import Optimizer

SIZE, SQUARE, SPEED = 32, 8, 4
"""Edge of the frame, edge of the square, pixels that an action of 1 pushes it; all in pixels."""
CONFIG = WorldModelConfig(
    pixels=PixelConfig(channels=8),
    rssm=RSSMConfig(num_latents=16, num_classes=16, deter=128, hidden=128),
    head=MLPConfig(layers=1, units=32),
    task=TaskConfig(layers=1, units=8, scale=(1.0,)),
    loss_scales=LossScales(task=0.0),
)


def make_sequences(rng: np.random.Generator, count: int, length: int) -> ModelBatch:
    """Squares that bounce off the edges; the task observation is one zero, the reward how far right it is."""
    room = SIZE - SQUARE
    action = rng.uniform(-1, 1, (count, length, 2)).astype(np.float32)
    action[:, 0] = 0
    rgb = np.full((count, length, SIZE, SIZE, 3), 40, np.uint8)
    place, reward = rng.uniform(0, room, (count, 2)), np.zeros((count, length), np.float32)
    for t in range(length):
        place = np.abs(place + SPEED * action[:, t])
        place = room - np.abs(room - place)
        reward[:, t] = place[:, 0] / room
        for frame, (x, y) in zip(rgb[:, t], place.round().astype(int), strict=True):
            frame[y : y + SQUARE, x : x + SQUARE] = (230, 120, 40)
    is_first = torch.zeros(count, length, dtype=torch.bool)
    is_first[:, 0] = True
    pixels = as_pixels(torch.from_numpy(rgb))
    return ModelBatch(
        visual=pixels,
        target=pixels,
        task=torch.zeros(count, length, 1),
        action=torch.from_numpy(action),
        reward=torch.from_numpy(reward),
        is_first=is_first,
        is_terminal=torch.zeros(count, length, dtype=torch.bool),
    )


def learn(model: WorldModel, updates: int, seed: int, length: int) -> list[dict[str, float]]:
    """Metrics of every hundredth update, each on sequences of its own."""
    optimizer, rows = Optimizer(model, OptimConfig(learning_rate=1e-3, warmup_steps=0)), []
    for index in range(updates):
        batch = make_sequences(make_rng(seed, "train", index), 16, length)
        loss, metrics, _ = world_model_loss(model, batch, torch.Generator().manual_seed(index))
        optimizer.step(loss, index)
        if index % 100 == 0 or index == updates - 1:
            rows.append({"update": index, **{k: round(v, 4) for k, v in metrics.items()}})
            print(json.dumps(rows[-1]), flush=True)
    return rows


@torch.no_grad()
def dream(model: WorldModel, batch: ModelBatch, context: int) -> tuple[Tensor, Tensor, Tensor]:
    """Frames told while all is seen, frames imagined after ``context`` of them, and the rewards imagined."""
    count, length = batch.reward.shape
    generator = torch.Generator().manual_seed(0)
    embed = model.embed(batch.visual.flatten(0, 1), batch.task.flatten(0, 1)).unflatten(0, (count, length))
    post, _ = model.rssm.observe(embed, batch.action, batch.is_first, model.rssm.initial(count), generator)
    state, states = post.at(context - 1), [post.at(t) for t in range(context)]
    for t in range(context, length):
        state = model.rssm.imagine_step(state, batch.action[:, t], generator)
        states.append(state)
    feat = torch.stack([s.feat for s in states], 1)
    return _decode(model, post), _tell(model, feat), model.predict_reward(feat)


def _decode(model: WorldModel, states: Latent) -> Tensor:
    return _tell(model, states.feat)


def _tell(model: WorldModel, feat: Tensor) -> Tensor:
    observation = model.observation
    assert isinstance(observation, PixelModel)
    return observation.decode(feat.flatten(0, 1)).unflatten(0, feat.shape[:2])


def score(batch: ModelBatch, imagined: Tensor, reward: Tensor, context: int) -> dict[str, list[float]]:
    """Half squared error of a frame, summed, after 1, 2, ... imagined steps; and the reward's root mean."""
    truth = batch.target
    guesses = {
        "imagined": imagined,
        "last frame seen": truth[:, context - 1 : context].expand_as(truth),
        "mean frame": truth.mean((0, 1), keepdim=True).expand_as(truth),
        "another sequence": truth.roll(1, 0),
    }
    errors = {k: 0.5 * (v - truth).square().sum((2, 3, 4)).mean(0)[context:] for k, v in guesses.items()}
    errors["reward"] = (reward - batch.reward).square().mean(0).sqrt()[context:]
    return {k: [round(x, 3) for x in v.tolist()] for k, v in errors.items()}


def draw(rows: list[Tensor], path: Path) -> None:
    """Sequences of frames below each other, enlarged."""
    strips = [
        np.concatenate(list(np.pad(as_rgb(row).numpy(), ((0, 0), (1, 1), (1, 1), (0, 0)))), 1) for row in rows
    ]
    picture = np.kron(np.concatenate(strips), np.ones((2, 2, 1), np.uint8))
    cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--updates", type=int, default=1500)
    parser.add_argument("--length", type=int, default=16)
    parser.add_argument("--context", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)

    torch.manual_seed(asked.seed)
    model = WorldModel(CONFIG, PixelModel(CONFIG, height=SIZE, width=SIZE, task_dim=1), action_dim=2)
    start = time.process_time()
    curve = learn(model, asked.updates, asked.seed, asked.length)
    batch = make_sequences(make_rng(asked.seed, "test"), 64, asked.length + 4)
    told, imagined, reward = dream(model.eval(), batch, asked.context)
    errors = score(batch, imagined, reward, asked.context)
    print(json.dumps(errors, indent=1))
    if asked.picture is not None:
        rows = [frames[n] for n in range(3) for frames in (batch.target, told, imagined)]
        draw(rows, asked.picture)
    if asked.out is not None:
        held = {"updates": asked.updates, "cpu_s": round(time.process_time() - start), "errors": errors}
        asked.out.write_text(json.dumps(held | {"curve": curve}, indent=1) + "\n")


if __name__ == "__main__":
    main()
