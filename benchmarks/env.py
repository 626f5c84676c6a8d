"""What a step of the environment costs, where its time goes, and how both kinds of contacts agree.

One core: OpenGL in software draws in the process that asks. ``steps`` takes variants in turn and gives
medians of CPU time, and of time by the clock, which says something on a quiet machine only. ``parts`` times
what a step is made of. ``contacts`` drives two worlds, one by PyBullet and one by the map, with the same
actions.

    python -m benchmarks.env steps parts contacts
"""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from agent.config import EnvConfig
from agent.envs.pointnav import PointNavEnv
from agent.envs.sites import load_scene
from agent.systems.controls import make_turn_to_goal
from langwm_data.config import RobotConfig, ScenesConfig
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import SceneSpec
from langwm_data.sim.world import World

FLOORS = ("Alder_0", "Birch_1", "Elm_1", "Cedar_1")
STEPS_KEPT = 100
"""Of an episode in ``contacts``; afterwards the two worlds begin again at one place."""


def drive(env: PointNavEnv, steps: int, seed: int) -> tuple[float, float, float]:
    """CPU and clock ms a step, resets left out, and CPU ms a reset; half at random, half towards goals."""
    rng, cpu, clock, resets, num_resets = np.random.default_rng(seed), 0.0, 0.0, 0.0, 0
    obs, is_over = {}, True
    for i in range(steps):
        if is_over:
            before = time.process_time()
            obs, _ = env.reset(seed=seed + num_resets)
            resets, num_resets = resets + time.process_time() - before, num_resets + 1
        action = rng.uniform(-1, 1, 2) if i < steps // 2 else make_turn_to_goal(EnvConfig())(obs, None)[0]
        at = time.process_time(), time.perf_counter()
        obs, _, terminated, truncated, _ = env.step(action)
        cpu, clock = cpu + time.process_time() - at[0], clock + time.perf_counter() - at[1]
        is_over = terminated or truncated
    return 1e3 * cpu / steps, 1e3 * clock / steps, 1e3 * resets / num_resets


def bench_steps(rounds: int, steps: int) -> None:
    config = EnvConfig()
    scenes = [load_scene(name, config) for name in FLOORS]
    variants = {
        "physics": config,
        "map": replace(config, contacts="map"),
        "map, with labels": replace(config, contacts="map", with_labels=True),
        "blind, physics": replace(config, is_blind=True),
        "blind, map": replace(config, contacts="map", is_blind=True),
    }
    envs = {name: PointNavEnv(c, scenes=scenes) for name, c in variants.items()}
    for env in envs.values():
        drive(env, 400, 0)
    taken = {name: [] for name in envs}
    for number in range(rounds):
        for name, env in envs.items():
            taken[name].append(drive(env, steps, 10 * number))
    for name, times in taken.items():
        cpu, clock, reset = (median(column) for column in zip(*times, strict=True))
        low = min(row[0] for row in times)
        print(
            f"{name:<20}{cpu:6.2f} CPU ms a step (least {low:.2f}: {1e3 / low:.0f} steps/s),"
            f" {clock:6.2f} ms by the clock, {reset:6.1f} CPU ms a reset"
        )
        envs[name].close()


def bench_parts(steps: int) -> None:
    for contacts in ("physics", "map"):
        config = EnvConfig(contacts=contacts)
        env = PointNavEnv(config, scenes=[load_scene(FLOORS[0], config)])
        drive(env, 400, 0)
        spent: dict[str, float] = {}

        def timed(name: str, function: Callable, spent: dict[str, float] = spent) -> Callable:
            def call(*args, **kwargs):
                before = time.process_time()
                result = function(*args, **kwargs)
                spent[name] = spent.get(name, 0.0) + time.process_time() - before
                return result

            return call

        env._renderer.render = timed("rendering", env._renderer.render)
        env._site.world.step = timed("driving and contacts", env._site.world.step)
        env._geodesic = timed("geodesic distance", env._geodesic)
        whole, *_ = drive(env, steps, 0)
        shares = {name: 1e3 * seconds / steps for name, seconds in spent.items()}
        shares["the rest"] = whole - sum(shares.values())
        text = ", ".join(f"{name} {ms:.3f}" for name, ms in shares.items())
        print(f"{contacts}: {whole:.2f} CPU ms a step: {text}")
        env.close()


@dataclass(frozen=True)
class Drives:
    """What two worlds of one scene, by PyBullet and by the map, made of the same actions; a row a step."""

    flags: np.ndarray
    """Whether something was touched, (steps, 2) bool."""
    apart_m: np.ndarray
    """Between the two robots, (steps,)."""
    cpu_s: np.ndarray
    """Of both, together, (2,)."""


def drive_both(scene: SceneSpec, robot: RobotConfig, episodes: int) -> Drives:
    """Drive from random places, by turns at random and to a goal."""
    free = FreeSpace.from_scene(scene, robot=robot)
    worlds = [World(scene, robot, contacts=way) for way in ("physics", "map")]
    rng, cpu, flags, apart = np.random.default_rng(0), np.zeros(2), [], []
    for episode in range(episodes):
        xy, goal = (_place(rng, free, worlds) for _ in range(2))
        for world in worlds:
            world.reset(xy, 0.0)
        state = worlds[0].step(0.0, 0.0)
        for _ in range(STEPS_KEPT):
            speeds = _random(rng) if episode % 2 else _towards(goal, state)
            states = []
            for number, world in enumerate(worlds):
                before = time.process_time()
                states.append(world.step(*speeds))
                cpu[number] += time.process_time() - before
            state, other = states
            flags.append((state.is_collision, other.is_collision))
            apart.append(math.dist(state.xy, other.xy))
    for world in worlds:
        world.close()
    return Drives(np.array(flags), np.array(apart), cpu)


def bench_contacts(episodes: int, furniture: str | None) -> None:
    config = EnvConfig(scenes=ScenesConfig(furniture=furniture))
    for floor in FLOORS:
        drives = drive_both(load_scene(floor, config), config.robot, episodes)
        flags, apart_mm, steps = drives.flags, 1e3 * drives.apart_m, len(drives.flags)
        cpu_ms = 1e3 * drives.cpu_s / steps
        print(
            f"{floor:<9}{steps} steps, {100 * flags[:, 0].mean():.1f} % in contact; flags agree in"
            f" {100 * (flags[:, 0] == flags[:, 1]).mean():.2f} %; poses apart: median"
            f" {np.median(apart_mm):.4f} mm, 95th {np.quantile(apart_mm, 0.95):.2f},"
            f" 99th {np.quantile(apart_mm, 0.99):.1f}, largest {apart_mm.max():.0f};"
            f" CPU ms a step {cpu_ms[0]:.3f} and {cpu_ms[1]:.3f}"
        )


def _place(rng: np.random.Generator, free: FreeSpace, worlds: list[World]) -> tuple[float, float]:
    while True:
        x, y = free.sample(rng).tolist()
        if not any(world.collides((x, y), 0.0) for world in worlds):
            return x, y


def _random(rng: np.random.Generator) -> tuple[float, float]:
    return rng.uniform(-0.5, 0.5), rng.uniform(-math.pi / 2, math.pi / 2)


def _towards(goal: tuple[float, float], state) -> tuple[float, float]:
    angle = math.atan2(goal[1] - state.xy[1], goal[0] - state.xy[0])
    distance, bearing = math.dist(goal, state.xy), math.remainder(angle - state.yaw, 2 * math.pi)
    linear, angular = make_turn_to_goal(EnvConfig())({"task": np.array([distance, bearing])}, None)[
        0
    ].tolist()
    return 0.5 * linear, math.pi / 2 * angular


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", default=["steps", "parts", "contacts"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--episodes", type=int, default=40)
    parser.add_argument("--furniture", help="folder of catalogues, for contacts in furnished homes")
    asked = parser.parse_args()
    benches = {
        "steps": lambda: bench_steps(asked.rounds, asked.steps),
        "parts": lambda: bench_parts(asked.steps),
        "contacts": lambda: bench_contacts(asked.episodes, asked.furniture),
    }
    for name in asked.what:
        benches[name]()


if __name__ == "__main__":
    main()
