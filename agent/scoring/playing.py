"""Playing what is not played yet, and the rows and summaries that an evaluation leaves in its folder."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium

from agent.envs.episode_file import EpisodeSet
from agent.envs.episodes import EPISODES_VERSION, Episode
from agent.rollout import Policy, run_episode
from agent.scoring.players import Player, PlayerWorker, Turn
from agent.scoring.rows import Journal, Row, key_of, make_row, read_rows, task_of, write_table
from agent.scoring.summary import compare, summarise
from agent.systems.controls import CONTROL_NAMES
from langwm_data import atomic
from langwm_data.workers import WorkerPool

SUMMARY_FILE = "summary.json"

Progress = Callable[[int, int], None]


def play_all(
    players: tuple[Player, ...], episodes: EpisodeSet, workers: int, progress: Progress | None
) -> dict[Player, list[Row]]:
    """The rows of every player, in the order of the episodes.

    Those that stand in a folder already are taken from there; the others are played, and stand in the
    journal of the player's folder as soon as an episode is over.
    """
    done = set(_known(players, columns=("player", "task")))
    turns = [
        Turn(p, number, episode)
        for p, player in enumerate(players)
        for number, episode in numbered(episodes.episodes)
        if (player.identity, task_of(episode)) not in done
    ]
    total = len(players) * len(episodes.episodes)
    count = total - len(turns)

    def report(units: int) -> None:
        nonlocal count
        count += units
        if progress is not None:
            progress(count, total)

    report(0)
    if turns:
        worker = PlayerWorker(players=players, split=episodes.split)
        with WorkerPool(worker, min(workers, len(turns))) as pool:
            pool.run(turns, report)
    held, names = _known(players), {"split": episodes.split}
    return {
        player: [
            held[player.identity, task_of(episode)] | names | {"system": player.system, "episode": number}
            for number, episode in numbered(episodes.episodes)
        ]
        for player in players
    }


def keep_rows(out: Path, players: Sequence[Player], rows: Sequence[Row], episodes: EpisodeSet) -> None:
    """Write the rows of an evaluation beside the older ones that are still true.

    Those of a player that has learned since are not, and those of other episodes of the split would make one
    score of two sets. A longer list that begins with these episodes stays, and so does its checksum. Systems
    come in the order of the players, in one split as in the other.
    """
    identities = {player.system: player.identity for player in players}
    order = {name: place for place, name in enumerate(identities)}
    older = [*read_rows(out), *Journal(out).read()]
    kept = {key_of(r): r for r in older if r.get("player") == identities.get(r["system"], r.get("player"))}
    tasks = {(e.scene, number): task_of(e) for number, e in numbered(episodes.episodes)}
    same_split = [r for r in kept.values() if r["split"] == episodes.split]
    if any(tasks.get(_place_of(r), r.get("task")) != r.get("task") for r in same_split):
        kept = {key: r for key, r in kept.items() if r["split"] != episodes.split}
        same_split = []
    new = {key_of(row): row for row in rows}
    others = sorted(set(kept) - set(new), key=lambda key: (order.get(key[0], len(order)), key))
    is_longest = all(_place_of(r) in tasks for r in same_split)
    write_rows(out, [*new.values(), *(kept[key] for key in others)], episodes if is_longest else None)
    Journal(out).remove()


def write_rows(out: Path, rows: Sequence[Row], episodes: EpisodeSet | None = None) -> None:
    """Write ``episodes.parquet`` and, rebuilt from it, ``summary.json``.

    Args:
        out: Folder of the evaluation.
        rows: All that is to stand there.
        episodes: Where some of them were taken from; its checksum goes into the summary.
    """
    write_table(out, rows)
    taken = _read_sources(out)
    if episodes is not None:
        taken |= {episodes.split: {"sha256": episodes.sha256, "counts": episodes.counts()}}
    scores = [score.to_dict() for score in summarise(rows).scores]
    systems = list(dict.fromkeys(row["system"] for row in rows))
    pairs = [(a, b) for a in systems if a not in CONTROL_NAMES for b in systems if b in CONTROL_NAMES]
    differences = [d.to_dict() for a, b in pairs for d in compare(rows, a, b)]
    head = {"episodes_version": EPISODES_VERSION, "episodes": taken}
    atomic.write_json(out / SUMMARY_FILE, head | {"scores": scores, "differences": differences})


def play(
    system: str,
    policy: Policy,
    env: gymnasium.Env,
    episodes: Sequence[Episode],
    *,
    split: str,
    tick: Callable[[int], None] | None = None,
) -> list[Row]:
    """Play every episode once; ``tick`` is called with how many are done."""
    rows = []
    for number, episode in numbered(episodes):
        record = run_episode(env, policy, episode=episode)
        names = {"system": system, "split": split, "episode": number}
        rows.append(make_row(record, **names, task=task_of(episode), player=""))
        if tick is not None:
            tick(len(rows))
    return rows


def numbered(episodes: Sequence[Episode]) -> list[tuple[int, Episode]]:
    """Episodes with their number on their floor, which is the same however many are played."""
    taken: dict[str, int] = {}
    result = []
    for episode in episodes:
        number = taken.get(episode.scene, 0)
        taken[episode.scene] = number + 1
        result.append((number, episode))
    return result


def _place_of(row: Row) -> tuple[str, int]:
    return row["scene"], row["episode"]


def _known(
    players: Sequence[Player], columns: Sequence[str] | None = None
) -> dict[tuple[str | None, str | None], Row]:
    """Rows that stand in the players' folders, by who played what."""
    outs = dict.fromkeys(player.out for player in players)
    held = [row for out in outs for row in (*read_rows(out, columns), *Journal(out).read())]
    return {(row.get("player"), row.get("task")): row for row in held}


def _read_sources(out: Path) -> dict[str, Any]:
    try:
        return dict(json.loads((out / SUMMARY_FILE).read_text("utf-8"))["episodes"])
    except (OSError, ValueError, KeyError, TypeError):
        return {}
