"""Assets are found by their content, in any of several folders, and never anything else."""

import hashlib

import numpy as np
import pytest
from mesh_scenes import QUADRANTS, board_mesh, png, with_meshes

from langwm_data.scenes.assets import NO_ASSETS, Assets, cache_folder


@pytest.fixture
def assets(tmp_path):
    return Assets(tmp_path / "assets")


def test_a_mesh_comes_back_and_is_read_once(assets):
    name = assets.add_mesh(board_mesh())
    again = assets.mesh(name)
    assert np.array_equal(again.vertices, board_mesh().vertices)
    assert again.materials == board_mesh().materials
    assert assets.mesh(name) is again


def test_a_picture_is_named_by_its_bytes_and_comes_in_the_size_asked_for(assets):
    data = png(QUADRANTS)
    name = assets.add_picture(data)
    assert name == hashlib.sha256(data).hexdigest()
    assert np.array_equal(assets.picture(name, 2), QUADRANTS)
    assert assets.picture(name, 128).shape == (128, 128, 3)
    assert np.array_equal(assets.picture(name, 128)[10, 100], QUADRANTS[0, 1])


def test_all_that_a_scene_needs_is_copied_and_nothing_else(small_scene, assets, tmp_path):
    scene = with_meshes(small_scene, assets)
    assets.add_picture(png(QUADRANTS))
    assets.copy_to(tmp_path / "other", scene)
    assert tuple(sorted(p.name for p in (tmp_path / "other").iterdir())) == scene.assets()
    assert len(scene.assets()) == 2
    both = Assets(tmp_path / "empty", tmp_path / "other")
    assert both.mesh(scene.objects[0].mesh.name).sizes == (2,)


def test_procedural_scenes_need_none(small_scene):
    assert small_scene.assets() == ()


@pytest.mark.parametrize(
    ("file", "sentence"),
    [
        ("../../etc/passwd", "is no name of an asset"),
        ("0" * 64 + ".npz", "is missing; looked for in: "),
        ("0" * 64 + ".pkl", "is no name of an asset"),
        ("0" * 63 + ".png", "is no name of an asset"),
    ],
)
def test_other_names_are_refused(assets, file, sentence):
    with pytest.raises(ValueError, match=sentence):
        assets.read(file)
    with pytest.raises(ValueError, match=sentence):
        NO_ASSETS.read(file)


def test_other_content_than_the_name_says_is_refused(assets):
    mesh, picture = assets.add_mesh(board_mesh()), assets.add_picture(png(QUADRANTS))
    for file in assets.folders[0].iterdir():
        data = bytearray(file.read_bytes())
        data[len(data) // 2] ^= 1
        file.write_bytes(data)
    with pytest.raises(ValueError, match="its content does not match its name"):
        assets.mesh(mesh)
    with pytest.raises(ValueError, match="its content does not match its name"):
        assets.picture(picture, 4)


def test_pictures_that_are_none_or_too_large_are_refused(assets):
    with pytest.raises(ValueError, match="neither PNG nor JPEG"):
        assets.picture(assets.add_picture(b"GIF89a"), 4)
    with pytest.raises(ValueError, match="a side of more than 512 pixels"):
        assets.picture(assets.add_picture(png(QUADRANTS, size=513)), 4)
    with pytest.raises(ValueError, match="a damaged picture"):
        assets.picture(assets.add_picture(png(QUADRANTS)[:40]), 4)


def test_files_that_are_too_large_are_refused_unread(assets, monkeypatch):
    name = assets.add_picture(png(QUADRANTS))
    monkeypatch.setattr("langwm_data.scenes.assets.MAX_FILE_BYTES", 10)
    with pytest.raises(ValueError, match="at most 10 are read"):
        assets.read(f"{name}.png")


def test_the_cache_lies_where_the_desktop_says(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "langwm"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "langwm"
