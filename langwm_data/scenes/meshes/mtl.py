"""MTL text: colours, opacity and texture names of the materials of an OBJ file.

Source: the Wavefront material format: ``newmtl`` begins a material; ``Kd`` is its diffuse colour, ``d`` its
opacity and ``Tr`` the contrary, ``map_Kd`` its colour texture. Everything else is passed over.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

MAX_BYTES = 2**22

_NUM_OPTION_WORDS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-o": 3,
    "-s": 3,
    "-t": 3,
    "-texres": 1,
}
"""Options before a texture's name and their arguments; none of the Debian catalogues' colours uses one."""


@dataclass(frozen=True, kw_only=True)
class MtlMaterial:
    """What a file says of one material."""

    color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    """Source: Wavefront's default for Kd."""
    opacity: float = 1.0
    texture: str | None = None
    """As written: a name, or a path of the machine that it was made on."""


def parse_mtl(data: bytes, label: str) -> dict[str, MtlMaterial]:
    """All materials by name; of a name that stands twice the last counts.

    Raises:
        ValueError: If the file is too large or a value is no number.
    """
    if len(data) > MAX_BYTES:
        raise ValueError(f"{label}: {len(data)} bytes of materials; at most {MAX_BYTES} are read")
    materials: dict[str, MtlMaterial] = {}
    current = None
    for keyword, rest in _statements(data):
        if keyword == "newmtl":
            current = rest
            materials[current] = MtlMaterial()
        elif current is not None:
            try:
                materials[current] = _with(materials[current], keyword, rest)
            except (ValueError, IndexError) as error:
                raise ValueError(
                    f"{label}: {keyword} {rest!r} of material {current!r} is no number"
                ) from error
    return materials


def _statements(data: bytes) -> Iterator[tuple[str, str]]:
    for line in data.decode("utf-8", "replace").splitlines():
        keyword, _, rest = line.strip().replace("\t", " ").partition(" ")
        if keyword and not keyword.startswith("#"):
            yield keyword, rest.strip()


def _with(material: MtlMaterial, keyword: str, rest: str) -> MtlMaterial:
    if keyword == "Kd":
        red, green, blue = (_share(word) for word in (rest.split() * 3)[:3])
        return replace(material, color=(red, green, blue))
    if keyword == "d":
        return replace(material, opacity=_share(rest.split()[-1]))
    if keyword == "Tr":
        return replace(material, opacity=1 - _share(rest.split()[-1]))
    if keyword == "map_Kd":
        return replace(material, texture=_texture_name(rest) or None)
    return material


def _share(word: str) -> float:
    value = float(word)
    if not math.isfinite(value):
        raise ValueError(word)
    return min(max(value, 0.0), 1.0)


def _texture_name(rest: str) -> str:
    """The name after the options; it may hold blanks."""
    while rest.startswith("-"):
        option = rest.split(maxsplit=1)[0]
        num_words = _NUM_OPTION_WORDS.get(option)
        if num_words is None:
            break
        rest = " ".join(rest.split(" ")[1 + num_words :]).strip()
    return rest
