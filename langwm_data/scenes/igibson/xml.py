"""XML from strangers: elements and attributes, nothing else.

A document that declares anything (DOCTYPE, entities) is refused, so nothing can grow, and nothing outside of
the document can be named. Text between elements is passed over: URDF has none.
"""

from dataclasses import dataclass, field
from xml.parsers import expat

MAX_ELEMENTS = 200_000
MAX_DEPTH = 30


@dataclass(kw_only=True)
class Element:
    """One element."""

    tag: str
    attributes: dict[str, str]
    children: list["Element"] = field(default_factory=list)

    def all(self, tag: str) -> list["Element"]:
        """The children of this tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> "Element | None":
        """The first child of this tag."""
        return next((child for child in self.children if child.tag == tag), None)


def parse_xml(data: bytes, label: str) -> Element:
    """The root of a document.

    Raises:
        ValueError: If it is damaged, declares something, or is too large.
    """
    builder = _Builder(label)
    parser = expat.ParserCreate()
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.StartDoctypeDeclHandler = builder.declare
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise ValueError(f"{label}: damaged XML: {error}") from error
    assert builder.root is not None, "expat refuses a document without an element"
    return builder.root


class _Builder:
    def __init__(self, label: str) -> None:
        self.root: Element | None = None
        self._label = label
        self._open: list[Element] = []
        self._count = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MAX_ELEMENTS or len(self._open) >= MAX_DEPTH:
            raise ValueError(
                f"{self._label}: more than {MAX_ELEMENTS} elements, or more than {MAX_DEPTH} in each other"
            )
        element = Element(tag=tag, attributes=attributes)
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def end(self, tag: str) -> None:
        assert self._open.pop().tag == tag

    def declare(self, *_: object) -> None:
        raise ValueError(f"{self._label}: declares a document type or entities; allowed: plain elements")
