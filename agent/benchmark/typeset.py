"""Tables as data, and how they are written in Markdown and in LaTeX. Knows nothing of what they say."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Entry:
    """One place in a table: a value, and its interval where it has one."""

    value: str
    interval: str = ""


@dataclass(frozen=True, kw_only=True)
class Line:
    """One row. A ``group`` has one entry, a heading over the rows that follow."""

    entries: tuple[Entry, ...]
    kind: Literal["plain", "cited", "group"] = "plain"
    """``cited``: somebody else's numbers, set apart."""
    mark: str = ""
    """Letter of the note on the first entry."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table with the notes below it."""

    title: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]
    spans: tuple[tuple[str, int], ...] = ()
    """Headings over several columns, from the left; none where empty."""
    notes: tuple[tuple[str, str], ...] = ()
    """Letter, empty for what concerns the whole table, and text."""


def to_markdown(table: Table) -> str:
    """The table as GitHub shows it; headings over columns are put before their names."""
    columns = _flat_columns(table)
    lines = [f"### {_md(table.title)}", "", _md_row([_md(c) for c in columns])]
    lines.append(_md_row(["---"] + ["---:"] * (len(columns) - 1)))
    for line in table.lines:
        cells = [_md_entry(entry) for entry in line.entries]
        if line.mark:
            cells[0] += f" [{line.mark}]"
        if line.kind == "group":
            cells = [f"**{cells[0]}**"] + [""] * (len(columns) - 1)
        if line.kind == "cited":
            cells = [f"*{cell}*" if cell else "" for cell in cells]
        lines.append(_md_row(cells))
    for mark, text in table.notes:
        lines += ["", f"[{mark}] {_md(text)}" if mark else _md(text)]
    return "\n".join(lines) + "\n"


def to_latex(table: Table) -> str:
    """A ``tabular`` that needs no package; notes stand in its last rows."""
    width = len(table.columns)
    lines = [f"% {_one_line(table.title)}", rf"\begin{{tabular}}{{l{'r' * (width - 1)}}}", r"\hline"]
    if table.spans:
        heads = [rf"\multicolumn{{{n}}}{{c}}{{{_tex(text)}}}" for text, n in table.spans]
        lines.append(_tex_row(heads))
    lines += [_tex_row([_tex(c) for c in table.columns]), r"\hline"]
    for line in table.lines:
        cells = [_tex_entry(entry) for entry in line.entries]
        if line.mark:
            cells[0] += rf"$^{{\mathrm{{{line.mark}}}}}$"
        if line.kind == "group":
            lines.append(r"\hline")
            cells = [rf"\multicolumn{{{width}}}{{l}}{{\textbf{{{cells[0]}}}}}"]
        if line.kind == "cited":
            cells = [rf"\textit{{{cell}}}" if cell else "" for cell in cells]
        lines.append(_tex_row(cells))
    lines.append(r"\hline")
    for mark, text in table.notes:
        sign = rf"$^{{\mathrm{{{mark}}}}}$ " if mark else ""
        note = rf"\footnotesize {sign}{_tex(text)}"
        lines.append(_tex_row([rf"\multicolumn{{{width}}}{{p{{0.9\textwidth}}}}{{{note}}}"]))
    return "\n".join([*lines, r"\end{tabular}"]) + "\n"


def _flat_columns(table: Table) -> list[str]:
    if not table.spans:
        return list(table.columns)
    over = [text for text, count in table.spans for _ in range(count)]
    return [f"{head} {name}".strip() for head, name in zip(over, table.columns, strict=True)]


def _md_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _md_entry(entry: Entry) -> str:
    return _md(f"{entry.value} {entry.interval}".strip())


def _md(text: str) -> str:
    """Text that no Markdown is read into; the brackets of intervals cannot become links without a target."""
    return re.sub(r"([\\`*_|<>#~])", r"\\\1", _one_line(text))


def _tex_row(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _tex_entry(entry: Entry) -> str:
    if not entry.interval:
        return _tex(entry.value)
    return rf"{_tex(entry.value)} {{\scriptsize {_tex(entry.interval)}}}"


_TEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "[": "{[}",
    "]": "{]}",
} | {sign: f"\\{sign}" for sign in "&%$#_"}


def _tex(text: str) -> str:
    """Text as LaTeX prints it; a bare bracket would be taken for an argument of the end of a row."""
    return "".join(_TEX.get(sign, sign) for sign in _one_line(text))


def _one_line(text: str) -> str:
    return " ".join(text.split())
