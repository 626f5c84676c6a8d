r"""Java's ``.properties`` text: keys and values, one pair to a logical line.

Source: java.util.Properties.load, Java SE 8 API documentation: ISO 8859-1, ``#`` or ``!`` begins a comment,
a backslash at the end continues the line, ``=``, ``:`` or blanks end the key, ``\uXXXX`` and ``\t\n\r\f`` are
escapes, and a backslash before any other character stands for that character.
"""

import re
from collections.abc import Iterator

MAX_BYTES = 2**24

_BLANKS = " \t\f"
_ESCAPES = {"t": "\t", "n": "\n", "r": "\r", "f": "\f"}
_KEY_END = re.compile(r"(?<!\\)(?:\\\\)*([=: \t\f])")
_ESCAPE = re.compile(r"\\(u.{0,4}|.)", re.DOTALL)


def parse_properties(data: bytes, label: str) -> dict[str, str]:
    """All pairs; of a key that stands twice the last value counts.

    Args:
        data: The file.
        label: What messages call it.

    Raises:
        ValueError: If the file is too large or an escape has no four hexadecimal digits.
    """
    if len(data) > MAX_BYTES:
        raise ValueError(f"{label}: {len(data)} bytes of properties; at most {MAX_BYTES} are read")
    pairs = {}
    for line in _logical_lines(data.decode("latin-1")):
        key, value = _split(line)
        pairs[_unescape(key, label)] = _unescape(value, label)
    return pairs


def _logical_lines(text: str) -> Iterator[str]:
    """Lines with content, continuations joined, leading blanks and comments removed."""
    pieces: list[str] = []
    for raw in re.split(r"\r\n|\r|\n", text):
        line = raw.lstrip(_BLANKS)
        if not pieces and (not line or line[0] in "#!"):
            continue
        backslashes = len(line) - len(line.rstrip("\\"))
        is_continued = backslashes % 2 == 1
        pieces.append(line[:-1] if is_continued else line)
        if not is_continued:
            yield "".join(pieces)
            pieces = []
    if pieces:
        yield "".join(pieces)


def _split(line: str) -> tuple[str, str]:
    end = _KEY_END.search(line)
    if end is None:
        return line, ""
    rest = line[end.start(1) :].lstrip(_BLANKS)
    if rest[:1] in ("=", ":"):
        rest = rest[1:].lstrip(_BLANKS)
    return line[: end.start(1)], rest


def _unescape(text: str, label: str) -> str:
    def plain(match: re.Match[str]) -> str:
        code = match[1]
        if code[0] != "u":
            return _ESCAPES.get(code, code)
        if not re.fullmatch("u[0-9A-Fa-f]{4}", code):
            raise ValueError(f"{label}: escape {match[0]!r} is not \\u and four hexadecimal digits")
        return chr(int(code[1:], 16))

    # Two escapes may make one character outside of the first 65,536.
    return _ESCAPE.sub(plain, text).encode("utf-16", "surrogatepass").decode("utf-16", "replace")
