"""The map from the paper to the code leads to what exists, and leaves out no row."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "paper_map.md").read_text("utf-8")

TABLE_2 = {
    "Data Augmentation": [
        ("Padding range", "10"),
        ("Hue delta", "0.1"),
        ("Brightness delta", "0.4"),
        ("Contrast delta", "0.4"),
        ("Saturation delta", "0.2"),
        ("Gaussian blur sigma min, max", "0.1, 2.0"),
    ],
    "(Object) Masked Autoencoder": [
        ("Dataset size (FIFO)", "3·10⁵"),
        ("iGibson visual observation size", "128x160"),
        ("Batch episode size", "16"),
        ("Episode sequence length", "50"),
        ("Batch size", "16x50"),
        ("Early conv kernels sizes", "4, 4, 4, 4"),
        ("Early conv feature maps", "32, 64, 128, 256"),
        ("Early conv strides", "2, 2, 2, 2"),
        ("Early conv activation", "ELU"),
        ("Visual tokenization", "(8x10)x256"),
        ("Language tokenization (BERT): 20 + global pool", "21"),
        ("CLS token", "1"),
        ("Encoder/decoder embed/token size/dim", "256"),
        ("Total num tokens", "102"),
        ("mask p", "0.75"),
        ("Encoder/decoder heads", "4"),
        ("Encoder/decoder MLP ratio", "4"),
        ("Encoder layers", "4"),
        ("Decoder layers", "3"),
        ("Encoder/decoder layer norm epsilon", "1⁻⁶"),
        ("Encoder/decoder dropout", "0.1"),
        ("Transformer MLP activation", "GELU"),
        ("Decode reward", "True"),
        ("Loss", "MSE"),
        ("Learning rate", "1·10⁻⁴"),
        ("Adam epsilon", "10⁻⁵"),
    ],
    "Task Observation Autoencoder": [("MLP encoder sizes", "256, 256, 256, 256"), ("Activation", "ELU")],
}
TABLE_3 = {
    "Multimodal Average Feature Pooling Transformer Autoencoder": [
        ("Encoder/decoder embed/token size/dim", "256"),
        ("Visual num tokens", "81"),
        ("Task obs num tokens", "1"),
        ("Total num tokens", "82"),
        ("Encoder/decoder heads", "4"),
        ("Encoder/decoder MLP ratio", "4"),
        ("Encoder/decoder layers", "2"),
        ("Decoder input", "avg(tokens)"),
        ("Encoder/decoder layer norm epsilon", "1⁻⁶"),
        ("Encoder/decoder dropout", "0.1"),
        ("Loss", "MSE"),
    ],
    "World Model": [
        ("Discrete latent dimensions", "32"),
        ("Discrete latent classes", "32"),
        ("RSSM number of units", "1024"),
        ("KL loss scale", "1.0"),
        ("World model learning rate", "3·10⁻⁴"),
        ("Key encoder exponential moving average", "0.999"),
    ],
    "Behavior: Actor-Critics": [
        ("Imagination horizon", "15"),
        ("Actor learning rate", "1·10⁻⁴"),
        ("Critic learning rate", "1·10⁻⁴"),
        ("Slow critic update interval", "100"),
    ],
    "Common": [
        ("Policy steps per gradient step", "4"),
        ("Policy and reward MLP number of layers", "4"),
        ("Policy and reward MLP number of units", "400"),
        ("Gradient clipping", "100"),
        ("Adam epsilon", "10⁻⁵"),
    ],
}
EQUATION_ROWS = {1: 2, 2: 2, 3: 8, 4: 2, 5: 1, 6: 2}
NUM_DECISIONS = 35


def rows_under(title):
    """The cells of the first table under a heading."""
    part = re.split(rf"^#+ {re.escape(title)}$", TEXT, flags=re.MULTILINE)[1]
    part = re.split(r"^#", part, flags=re.MULTILINE)[0]
    lines = [line for line in part.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]


def links(cell):
    return re.findall(r"`([\w/]+\.(?:py|yaml)(?::[\w.]+)?)`", cell)


@cache
def module(path):
    return ast.parse((ROOT / path).read_text("utf-8"))


def names_in(node):
    """What a module or class defines by name, each with its node."""
    found = {}
    for child in node.body:
        if isinstance(child, ast.ClassDef | ast.FunctionDef):
            found[child.name] = child
        elif isinstance(child, ast.AnnAssign) and isinstance(child.target, ast.Name):
            found[child.target.id] = child
        elif isinstance(child, ast.Assign):
            found |= {target.id: child for target in child.targets if isinstance(target, ast.Name)}
    return found


@pytest.mark.parametrize("link", sorted(set(links(TEXT))))
def test_every_link_leads_somewhere(link):
    path, _, symbol = link.partition(":")
    assert (ROOT / path).is_file()
    node = module(path) if symbol else None
    for name in symbol.split(".") if symbol else ():
        assert name in names_in(node), f"{path} has no {symbol}"
        node = names_in(node)[name]


def test_names_in_backticks_that_look_like_code_are_links():
    found = re.findall(r"`([^`]*(?:/|\.py)[^`]*)`", TEXT)
    assert [name for name in found if not links(f"`{name}`")] == []


@pytest.mark.parametrize(
    ("title", "expected"), [(title, rows) for table in (TABLE_2, TABLE_3) for title, rows in table.items()]
)
def test_every_row_of_the_papers_tables_is_there(title, expected):
    rows = rows_under(title)
    assert [(name, value) for name, value, _ in rows] == expected
    assert all(links(where) or "not built" in where for _, _, where in rows)


def test_every_row_of_every_equation_is_there():
    covered = {}
    for name, _, where in rows_under("Equations"):
        assert links(where)
        number, *numbers = map(int, re.findall(r"\d+", name))
        first, last = (numbers[0], numbers[-1]) if numbers else (1, 1)
        covered.setdefault(number, []).extend(range(first, last + 1))
    assert covered == {number: list(range(1, count + 1)) for number, count in EQUATION_ROWS.items()}


def test_every_decision_is_there():
    rows = rows_under("Decisions where the paper is silent or contradicts itself")
    assert [int(number) for number, *_ in rows] == list(range(1, NUM_DECISIONS + 1))
    assert all(links(where) or "not built" in decided for _, _, decided, where in rows)
