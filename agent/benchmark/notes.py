"""What a reader must know before two rows are compared: where their training differs, and from the paper's.

Owns sentences. Facts are read from the runs' configurations.
"""

from collections.abc import Sequence

from agent.benchmark.results import CellResult, Results
from agent.benchmark.rows import row_of
from agent.config import AgentConfig, EnvConfig
from agent.envs.protocols import success_radius
from agent.systems.registry import SYSTEMS

LETTERS = "abcdefghijklmnopqrstuvwxyz"


def system_notes(results: Results, systems: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Letter and text by system, for those of which there is something to say."""
    texts = {system: _text(system, results.of(system)) for system in systems}
    said = [system for system in systems if texts[system]]
    return {system: (_letter(number), texts[system]) for number, system in enumerate(said)}


def table_notes(results: Results) -> list[str]:
    """What concerns the whole table of test floors."""
    base = results.base
    edges = base.env.distance_edges_m
    notes = [
        f"Ours: {base.steps:,} environment steps,"
        f" {base.env.camera.height} x {base.env.camera.width} pixels,"
        f" scored on goals {edges[0]:g} to {edges[-1]:g} m away on floors and textures never trained on."
        " Rows in italics are the paper's: 100,000 steps, 128 x 160 pixels, goals 1 to 10 m away, in another"
        " simulator, without intervals. The order of systems may be compared, numbers of the two may not.",
        _task(base.env),
        "SR: success rate in per cent. SPL: success weighted by path length. All intervals at 95 %: of rates"
        " of one seed Wilson's; else from a bootstrap over seeds and over the episodes, which are the same"
        " for all seeds, of rates never narrower than Wilson's of as many episodes as those are worth.",
    ]
    if len(counts := {len(played.task) for played in results.played["test"].values()}) > 1:
        notes.append(
            f"Not all systems have played as many episodes yet: {min(counts)} to {max(counts)} with every"
            " seed. Differences are of those that both played."
        )
    seeds = {len(played.seeds) for played in _learners(results)}
    if 1 in seeds:
        notes.append(
            "Where a system has one seed, its interval says how well this one trained agent was measured,"
            " nothing about what another seed would have become."
        )
    if missing := [r.cell.name for r in results.cells if r.record.state != "done"]:
        notes.append(f"Not finished, and counted as far as scored: {', '.join(missing)}.")
    return notes


def _task(env: EnvConfig) -> str:
    """What is asked of an agent, and how far away its goals were in training."""
    edges = env.distance_edges_m
    farthest = edges[-1] if env.drawn_tiers is None else edges[env.drawn_tiers]
    end = "a stop" if env.protocol == "habitat" else "arriving"
    return (
        f"Task: protocol {env.protocol} ({end} within {success_radius(env)[1]:g} m of the goal), actions"
        f" {env.action}, contacts {env.contacts}, at most {env.max_steps} steps; trained on goals"
        f" {edges[0]:g} to {farthest:g} m away."
    )


def _learners(results: Results) -> list:
    return [p for name, p in results.played["test"].items() if row_of(name).group != "control"]


def _text(system: str, cells: Sequence[CellResult]) -> str:
    facts = [SYSTEMS[system].note if system in SYSTEMS else row_of(system).note]
    configs = [result.config for result in cells if result.config is not None]
    if configs:
        facts += _facts(configs[0])
    return " ".join(_as_sentence(fact) for fact in facts if fact)


def _as_sentence(text: str) -> str:
    return text[0].upper() + text[1:] + ("" if text.endswith(".") else ".")


def _facts(config: AgentConfig) -> list[str]:
    every = config.update_every
    facts = ["An update every step." if every == 1 else f"An update every {every} steps."]
    if config.mae is not None:
        facts.append(
            "Its autoencoder was pretrained on rendered frames, beside the environment steps counted here,"
            f" and is {'held fixed' if config.features == 'frozen' else 'trained on'}."
        )
    return facts


def _letter(number: int) -> str:
    first, second = divmod(number, len(LETTERS))
    return (LETTERS[first - 1] if first else "") + LETTERS[second]
