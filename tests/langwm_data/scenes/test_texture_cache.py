"""Kept pictures are those that would be drawn; damage and folders that cannot be written change nothing."""

import numpy as np
import pytest

from langwm_data import atomic
from langwm_data.scenes import texture_cache
from langwm_data.scenes.spec import MaterialRef
from langwm_data.scenes.texture_cache import TEXTURES_DIR, kept_picture
from langwm_data.scenes.textures import texture_image

PICTURE = np.arange(4 * 4 * 3, dtype=np.uint8).reshape(4, 4, 3)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "langwm" / TEXTURES_DIR


def never():
    raise AssertionError("drawn again")


def test_a_picture_is_drawn_once(folder):
    drawn = kept_picture("wood-1", 4, lambda: PICTURE)
    np.testing.assert_array_equal(drawn, PICTURE)
    np.testing.assert_array_equal(kept_picture("wood-1", 4, never), PICTURE)
    assert not drawn.flags.writeable
    assert len([p for p in folder.rglob("*") if p.is_file()]) == 1


def test_names_sizes_and_recipes_are_kept_apart(monkeypatch):
    kept_picture("wood-1", 4, lambda: PICTURE)
    monkeypatch.setattr(texture_cache, "_recipes_digest", lambda: "other")
    for name, size in (("wood-1", 4), ("wood-2", 4)):
        with pytest.raises(AssertionError, match="drawn again"):
            kept_picture(name, size, never)


@pytest.mark.parametrize("damage", [lambda d: d[:-1], lambda d: d + b"x", lambda d: d[:40] + b"x" + d[41:]])
def test_a_damaged_picture_is_drawn_again(folder, damage):
    kept_picture("wood-1", 4, lambda: PICTURE)
    (file,) = (p for p in folder.rglob("*") if p.is_file())
    file.write_bytes(damage(file.read_bytes()))
    np.testing.assert_array_equal(kept_picture("wood-1", 4, lambda: PICTURE), PICTURE)
    np.testing.assert_array_equal(kept_picture("wood-1", 4, never), PICTURE)


def test_a_folder_that_cannot_be_written_is_done_without(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    np.testing.assert_array_equal(kept_picture("wood-1", 4, lambda: PICTURE), PICTURE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def full(*_, **__):
        raise OSError("No space left on device")

    monkeypatch.setattr(atomic, "write_bytes", full)
    np.testing.assert_array_equal(kept_picture("wood-1", 4, lambda: PICTURE), PICTURE)


def test_textures_read_back_are_those_drawn():
    material = MaterialRef(category="marble", id=3)
    drawn = texture_image.__wrapped__(material, 32)
    np.testing.assert_array_equal(texture_image.__wrapped__(material, 32), drawn)
