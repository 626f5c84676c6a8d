"""Do CURL, RAD and DreamerV2 learn from pixels? Gymnasium's Pendulum-v1, drawn as a bar on 32 x 32 pixels.

The task observation is one zero: angle and speed must come from the stack of frames or from memory.
Networks are smaller than the default; CURL and RAD have settings of their own otherwise, DreamerV2 learns
faster, looks at shorter sequences, and is updated every other step. ``--blind`` blackens the frames: what is
left then is what can be learned without seeing.

    python -m benchmarks.pendulum --system curl --steps 10000 --seed 0 --out curl-0.json
    python -m benchmarks.pendulum --plot curves.png --runs curl-0.json rad-0.json
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.wrappers import RescaleAction
from matplotlib.figure import Figure

from agent.config import AgentConfig, ReplayConfig
from agent.replay import Replay, ReplayEpisode
from agent.systems.registry import find_system, load_agent_config
from agent.systems.system import Model, Spaces
from langwm_data.seeding import make_rng
from pretrain.update import torch_seed

SIZE = 32
REWARD_SCALE = 0.1
"""The rewards lie between -16 and 0."""
NETWORKS = {"filters": 16, "hidden": 256, "batch_size": 64}
SMALL = {"layers": 2, "units": 128}
DREAMER = {
    "prefill_steps": 1000,
    "update_every": 2,
    "batch_length": 16,
    "finetune": {"augment": {"padding_px": 2}},
    "world_model": {
        "pixels": {"channels": 8},
        "rssm": {"num_latents": 16, "num_classes": 16, "deter": 128, "hidden": 128},
        "head": SMALL,
        "task": {"layers": 1, "units": 8, "scale": [1.0]},
        "loss_scales": {"task": 0.0, "reward": 10.0},
        "reward_transform": "identity",
        "learning_rate": 1e-3,
    },
    "behavior": {
        "actor": SMALL,
        "critic": SMALL,
        "entropy_scale": 1e-3,
        "actor_learning_rate": 3e-4,
        "critic_learning_rate": 3e-4,
        "slow_critic_every": 50,
    },
}
"""What the systems on pixels change: their networks and how fast they learn."""
EVAL_SEED = 10_000


class PixelPendulum(gymnasium.Env[dict[str, np.ndarray], np.ndarray]):
    """The pendulum as a picture; its goal is to stand."""

    def __init__(self, *, is_blind: bool = False) -> None:
        self.is_blind = is_blind
        limits = np.float32(-1), np.float32(1)
        self._env = RescaleAction(gymnasium.make("Pendulum-v1"), *limits)
        self.action_space = self._env.action_space
        self.observation_space = gymnasium.spaces.Dict(
            rgb=gymnasium.spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8),
            task=gymnasium.spaces.Box(0, 1, (1,), np.float32),
        )
        axis = (np.arange(SIZE) + 0.5) / SIZE * 2 - 1
        self._x, self._y = np.meshgrid(axis, -axis)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        super().reset(seed=seed)
        observation, info = self._env.reset(seed=seed)
        return self.draw(observation), info

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self._env.step(action)
        return self.draw(observation), float(reward), terminated, truncated, info

    def draw(self, observation: np.ndarray) -> dict[str, np.ndarray]:
        """A bar from the middle; upright at angle 0, to the left at a quarter turn."""
        cosine, sine, _ = observation
        along = np.clip(self._y * cosine - self._x * sine, 0, 0.8)
        distance = np.hypot(self._x + along * sine, self._y - along * cosine)
        ink = np.clip((0.2 - distance) * SIZE / 2, 0, 1) * (not self.is_blind)
        picture = np.repeat((255 * ink[..., None]).astype(np.uint8), 3, -1)
        return {"rgb": picture, "task": np.zeros(1, np.float32)}


def play(env: gymnasium.Env, act: Any, seed: int) -> tuple[ReplayEpisode, float]:
    """One episode; what the buffer stores of it, and its return."""
    obs, _ = env.reset(seed=seed)
    observations, actions, rewards, is_over = [obs], [np.zeros(1, np.float32)], [0.0], False
    while not is_over:
        actions.append(act(obs))
        obs, reward, _, is_over, _ = env.step(actions[-1])
        observations.append(obs)
        rewards.append(float(reward))
    episode = ReplayEpisode(
        rgb=np.stack([o["rgb"] for o in observations]),
        task=np.stack([o["task"] for o in observations]),
        action=np.stack(actions),
        reward=np.array(rewards, np.float32) * np.float32(REWARD_SCALE),
        is_terminal=False,
    )
    return episode, sum(rewards)


class Acting:
    """A model with its state, as a function of the observation."""

    def __init__(self, model: Model, seed: int, *, explore: bool) -> None:
        self.model, self.explore = model, explore
        self.state = model.initial_state(seed)

    def __call__(self, obs: dict[str, np.ndarray]) -> np.ndarray:
        action, self.state = self.model.act(obs, self.state, explore=self.explore)
        return action


def evaluate(env: gymnasium.Env, model: Model, episodes: int) -> list[float]:
    """Returns of episodes that are always the same."""
    seeds = range(EVAL_SEED, EVAL_SEED + episodes)
    return [play(env, Acting(model, seed, explore=False), seed)[1] for seed in seeds]


def random_returns(env: gymnasium.Env, episodes: int) -> list[float]:
    seeds = range(EVAL_SEED, EVAL_SEED + episodes)
    rngs = (make_rng(seed, "random") for seed in seeds)
    return [
        play(env, lambda _, rng=rng: rng.uniform(-1, 1, 1).astype(np.float32), seed)[1]
        for seed, rng in zip(seeds, rngs, strict=True)
    ]


def learn(env: gymnasium.Env, config: AgentConfig, episodes: int, every: int) -> list[dict[str, float]]:
    """Whole episodes, then as many updates as they had steps; the scores along the way."""
    system, seed = find_system(config.system), config.seed
    model = system.create(config, Spaces.of(env))
    learner = system.make_learner(model, config)
    rows, step, updates, spent = [], 0, 0, 0.0
    with tempfile.TemporaryDirectory() as folder:
        replay = Replay(ReplayConfig(), Path(folder))
        while step < config.steps:
            number, start = replay.num_episodes, time.process_time()
            if step < config.prefill_steps:
                rng = make_rng(seed, "prefill", number)
                act = lambda _, rng=rng: rng.uniform(-1, 1, 1).astype(np.float32)  # noqa: E731
            else:
                act = Acting(model, torch_seed(seed, "explore", number), explore=True)
            episode, _ = play(env, act, seed * 1000 + number)
            replay.add(episode)
            length = len(episode.reward) - 1
            step += length
            metrics: dict[str, float] = {}
            if step > config.prefill_steps:
                for _ in range(length // config.update_every):
                    metrics |= learner.update(replay, updates)
                    updates += 1
            spent += time.process_time() - start
            if step % every == 0:
                returns = evaluate(env, model, episodes)
                rows.append(
                    {"step": step, "updates": updates, "cpu_s": round(spent, 1)}
                    | {"return": float(np.mean(returns)), "least": min(returns), "most": max(returns)}
                    | {k: round(v, 4) for k, v in metrics.items() if not k.endswith("grad_norm")}
                )
                print(json.dumps(rows[-1]), flush=True)
    return rows


def plot(runs: list[Path], path: Path) -> None:
    """Mean return with the range over episodes, one curve for each run."""
    figure = Figure(figsize=(6, 3.5), layout="constrained")
    axes = figure.subplots()
    held: dict[str, Any] = {}
    for run in runs:
        held = json.loads(run.read_text())
        name = f"{held['system']}{' (blind)' if held['is_blind'] else ''}, seed {held['seed']}"
        step, mean, least, most = ([r[k] for r in held["rows"]] for k in ("step", "return", "least", "most"))
        (line,) = axes.plot(step, mean, marker="o", markersize=3, label=name)
        axes.fill_between(step, least, most, alpha=0.12, color=line.get_color())
    axes.axhline(held["random"], color="gray", linestyle=":", label="random actions")
    axes.set(xlabel="environment steps", ylabel="return")
    axes.legend()
    figure.savefig(path, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--system", choices=["curl", "rad", "dreamerv2", "dreamerv2-da"], default="curl")
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--blind", action="store_true")
    parser.add_argument("--every", type=int, default=1000, help="steps between two evaluations")
    parser.add_argument("--episodes", type=int, default=10, help="of one evaluation")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--plot", type=Path, help="draw the curves of --runs, learn nothing")
    parser.add_argument("--runs", type=Path, nargs="+", default=[])
    asked = parser.parse_args()
    if asked.plot is not None:
        plot(asked.runs, asked.plot)
        return
    torch.set_num_threads(1)

    is_dreamer = asked.system.startswith("dreamer")
    sizes = DREAMER if is_dreamer else {"sac": NETWORKS, "world_model": {"task": {"scale": [1.0]}}}
    overrides = {"steps": asked.steps, "seed": asked.seed, **sizes}
    config = load_agent_config(asked.system, overrides=overrides)
    env = PixelPendulum(is_blind=asked.blind)
    by_chance = float(np.mean(random_returns(env, asked.episodes)))
    print(f"random actions: {by_chance:.0f}")
    rows = learn(env, config, asked.episodes, asked.every)
    if asked.out is not None:
        held = {"system": asked.system, "seed": asked.seed, "is_blind": asked.blind, "random": by_chance}
        asked.out.write_text(json.dumps(held | {"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
