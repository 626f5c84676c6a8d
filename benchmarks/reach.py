"""Does DreamerV2 learn to reach a point from pixels? A mass on a line, drawn as a bar on 32 x 32 pixels.

An action pushes the mass, which begins somewhere at rest and must come to stand in the middle. The task
observation is one zero: place and speed must come from the frames. ``--blind`` blackens them.

    python -m benchmarks.reach --system dreamerv2 --steps 3000 --out reach.json
"""

import argparse
import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

from agent.systems.registry import load_agent_config
from benchmarks.pendulum import DREAMER, SIZE, learn, random_returns
from langwm_data.config_io import merge

STEPS = 50
PUSH = 0.04
"""Change of speed by an action of 1, in half widths of the frame per step."""
NETWORKS = {
    "prefill_steps": 500,
    "batch_size": 8,
    "batch_length": 12,
    "world_model": {
        "pixels": {"channels": 4},
        "rssm": {"num_latents": 8, "num_classes": 8, "deter": 64, "hidden": 64},
        "head": {"units": 64},
    },
    "behavior": {
        "imag_horizon": 10,
        "actor": {"units": 64},
        "critic": {"units": 64},
        "actor_learning_rate": 1e-3,
        "critic_learning_rate": 1e-3,
    },
}


class PixelReach(gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
    """The reward is minus ten times the distance from the middle; walls stop the mass."""

    def __init__(self, *, is_blind: bool = False) -> None:
        self.is_blind = is_blind
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.observation_space = gymnasium.spaces.Dict(  # pyright: ignore[reportAttributeAccessIssue]
            rgb=gymnasium.spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8),
            task=gymnasium.spaces.Box(0, 1, (1,), np.float32),
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        super().reset(seed=seed)
        self.place, self.speed, self.num_steps = self.np_random.uniform(-1, 1), 0.0, 0
        return self.draw(), {}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        self.speed += PUSH * float(np.clip(action[0], -1, 1))
        wanted = self.place + self.speed
        self.place = float(np.clip(wanted, -1, 1))
        self.speed *= self.place == wanted
        self.num_steps += 1
        return self.draw(), -10 * abs(self.place), False, self.num_steps >= STEPS, {}

    def draw(self) -> dict[str, np.ndarray]:
        """A bar of six pixels, smooth at its edges."""
        middle = SIZE / 2 + self.place * (SIZE / 2 - 4)
        ink = np.clip(3.5 - np.abs(np.arange(SIZE) + 0.5 - middle), 0, 1) * (not self.is_blind)
        picture = np.zeros((SIZE, SIZE, 3), np.uint8)
        picture[8:24] = (255 * ink).astype(np.uint8)[None, :, None]
        return {"rgb": picture, "task": np.zeros(1, np.float32)}


def best_returns(env: PixelReach, episodes: int) -> float:
    """Of a controller that is told place and speed and brakes in time."""
    returns = []
    for seed in range(10_000, 10_000 + episodes):
        env.reset(seed=seed)
        total, is_over = 0.0, False
        while not is_over:
            action = np.clip(-(env.place + 6 * env.speed) * 4, -1, 1)
            _, reward, _, is_over, _ = env.step(np.array([action]))
            total += reward
        returns.append(total)
    return float(np.mean(returns))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--system", choices=["dreamerv2", "dreamerv2-da"], default="dreamerv2")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--every", type=int, default=500, help="steps between two evaluations")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--blind", action="store_true")
    parser.add_argument("--episodes", type=int, default=10, help="of one evaluation")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    torch.set_num_threads(1)

    overrides = merge(merge(DREAMER, NETWORKS), {"steps": asked.steps, "seed": asked.seed})
    env = PixelReach(is_blind=asked.blind)
    held = {
        "system": asked.system,
        "seed": asked.seed,
        "is_blind": asked.blind,
        "random": float(np.mean(random_returns(env, asked.episodes))),
        "told": best_returns(env, asked.episodes),
    }
    print(json.dumps(held), flush=True)
    held["rows"] = learn(
        env, load_agent_config(asked.system, overrides=overrides), asked.episodes, asked.every
    )
    if asked.out is not None:
        asked.out.write_text(json.dumps(held, indent=1) + "\n")


if __name__ == "__main__":
    main()
