"""A learner that is not ours on the environment: stable-baselines3's PPO or SAC, with its own defaults.

Needs the package stable-baselines3; nothing else here does. The environment is given to it as it is:
``MultiInputPolicy`` takes the dictionary of observations. Prints the mean return of every tenth of
the steps, and how many of its last episodes, at most 100, succeeded.

    python -m benchmarks.foreign --algorithm ppo --steps 20000 --set env.reward.progress=5
"""

import argparse
from typing import Any

import gymnasium
import numpy as np

from agent.config import AgentConfig
from agent.envs.pointnav import PointNavEnv
from langwm_data.config_io import load_config


def train(algorithm: str, env: gymnasium.Env, *, steps: int, seed: int) -> list[float]:
    """Train for ``steps`` and return the return of every finished episode, in order."""
    learner, monitor = _learner(algorithm, env, seed)
    learner.learn(steps)
    return monitor.get_episode_rewards()


def _learner(algorithm: str, env: gymnasium.Env, seed: int) -> tuple[Any, Any]:
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.monitor import Monitor

    monitor = Monitor(env, info_keywords=("success", "spl"))
    if algorithm == "ppo":
        return PPO("MultiInputPolicy", monitor, seed=seed, n_steps=128, device="cpu"), monitor
    sizes = {"buffer_size": 5000, "learning_starts": 100, "train_freq": 8}
    return SAC("MultiInputPolicy", monitor, seed=seed, device="cpu", **sizes), monitor


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--algorithm", choices=["ppo", "sac"], default="ppo")
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--preset", action="append", default=[])
    parser.add_argument("--set", action="append", default=[], dest="assignments")
    asked = parser.parse_args()
    config = load_config(AgentConfig, "agent", presets=asked.preset, assignments=asked.assignments)
    env = PointNavEnv(config.env)
    learner, monitor = _learner(asked.algorithm, env, asked.seed)
    for part in range(10):
        before = len(monitor.get_episode_rewards())
        learner.learn(asked.steps // 10, reset_num_timesteps=part == 0)
        returns = monitor.get_episode_rewards()[before:]
        mean = np.mean(returns) if returns else float("nan")
        last = [episode["success"] for episode in learner.ep_info_buffer][-len(returns) :] if returns else []
        share = f"  success of the last {len(last)}: {np.mean(last):.0%}" if last else ""
        print(
            f"{learner.num_timesteps:>8} steps  {len(returns):>4} episodes  mean return {mean:8.2f}{share}",
            flush=True,
        )
    env.close()


if __name__ == "__main__":
    main()
