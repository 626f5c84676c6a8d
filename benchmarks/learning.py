"""Does the agent learn? A blind agent at the `tiny` preset in one home without furniture.

The frames are black and the MAE is untrained, so what is learned comes from the goal's distance and
bearing alone; walls and doors remain. Prints the score of agent and controls on the same episodes.

    python benchmarks/learning.py --steps 4000 --seed 0 --out runs/learning
"""

import argparse
import dataclasses
import json
from pathlib import Path

import torch

from agent.config import AgentConfig
from agent.envs.episodes import fixed_episodes
from agent.envs.pointnav import PointNavEnv
from agent.evaluate import play, summarise
from agent.systems.agent import Agent
from agent.systems.controls import CONTROLS
from agent.train import train_agent
from langwm_data.baking import open_scenes
from langwm_data.config import ScenesConfig
from langwm_data.config_io import load_config
from pretrain.batch import TextTokens
from pretrain.config import MAEConfig, TextConfig
from pretrain.mae import LanguageGroundedMAE
from pretrain.metrics import read_metrics

SCENE = "Alder_0"
FRAME_PX = 16
EPISODES = 50


def write_untrained_mae(folder: Path) -> None:
    torch.manual_seed(0)
    null = TextTokens(embed=torch.zeros(1, 3, 8), attend=torch.ones(1, 3, dtype=torch.bool))
    config = MAEConfig(
        height=FRAME_PX,
        width=FRAME_PX,
        conv_channels=(4, 4, 4),
        dim=8,
        num_heads=2,
        encoder_layers=1,
        decoder_layers=1,
    )
    LanguageGroundedMAE(config, TextConfig(num_tokens=2), null).save_pretrained(folder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/learning"))
    asked = parser.parse_args()

    mae = asked.out / "untrained-mae"
    write_untrained_mae(mae)
    env = {"is_blind": True, "camera": {"height": FRAME_PX, "width": FRAME_PX}}
    overrides = {"steps": asked.steps, "seed": asked.seed, "mae": str(mae), "env": env}
    config = load_config(AgentConfig, "agent", presets=["tiny"], overrides=overrides)
    scene = dataclasses.replace(open_scenes(ScenesConfig()).load(SCENE), objects=())
    run = train_agent(config, asked.out / "run", env=PointNavEnv(config.env, scenes=[scene]))

    episodes = [row for row in read_metrics(run) if "env/return" in row]
    for start in range(0, len(episodes), 10):
        part = episodes[start : start + 10]
        success, total = (sum(row[k] for row in part) / len(part) for k in ("env/success", "env/return"))
        print(f"step {part[-1]['step']:6d}: success {success:.2f}, return {total:6.2f}")
    world = PointNavEnv(config.env, scenes=[scene])
    fixed = fixed_episodes(config.env, "train", EPISODES, scenes=[scene])
    policies = {"langwm": Agent.from_pretrained(run).act, **CONTROLS}
    rows = [row for name, act in policies.items() for row in play(name, act, world, fixed, split="train")]
    world.close()
    print(summarise(rows).as_text())
    print(json.dumps({"steps": asked.steps, "seed": asked.seed, "scene": SCENE, "episodes": EPISODES}))


if __name__ == "__main__":
    main()
