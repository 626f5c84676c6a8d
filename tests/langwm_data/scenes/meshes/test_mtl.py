import pytest

from langwm_data.scenes.meshes import mtl
from langwm_data.scenes.meshes.mtl import MtlMaterial, parse_mtl

TEXT = b"""
# made by hand
Kd 9 9 9
newmtl dark wood
\tKa 1 1 1
\tKd 0.2\t0.1 0.05
d 0.5
illum 2
map_Kd C:/My Pictures/oak 1.jpg
newmtl glass
Tr 0.75
Kd 2 -1 0.5
newmtl tiled
map_Kd -s 2 2 1 -clamp on tiles.png
newmtl plain
"""


def test_colours_opacity_and_textures():
    assert parse_mtl(TEXT, "x.mtl") == {
        "dark wood": MtlMaterial(color=(0.2, 0.1, 0.05), opacity=0.5, texture="C:/My Pictures/oak 1.jpg"),
        "glass": MtlMaterial(color=(1.0, 0.0, 0.5), opacity=0.25),
        "tiled": MtlMaterial(texture="tiles.png"),
        "plain": MtlMaterial(),
    }


@pytest.mark.parametrize("line", ["Kd red", "Kd", "d nan", "Tr"])
def test_what_is_no_number_is_refused(line):
    with pytest.raises(ValueError, match=r"^x.mtl: \w+ '.*' of material 'a' is no number"):
        parse_mtl(f"newmtl a\n{line}\n".encode(), "x.mtl")


def test_a_huge_file_is_refused(monkeypatch):
    monkeypatch.setattr(mtl, "MAX_BYTES", 3)
    with pytest.raises(ValueError, match=r"x.mtl: \d+ bytes of materials; at most 3 are read"):
        parse_mtl(TEXT, "x.mtl")
