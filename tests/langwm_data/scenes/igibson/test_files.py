"""Files of the dataset are read within its folder and within limits; digests follow what is in them."""

import os

import pytest

from langwm_data.scenes.igibson import files
from langwm_data.scenes.igibson.files import DataFolder, plain_name


@pytest.fixture
def data(tmp_path):
    root = tmp_path / "data"
    (root / "inner").mkdir(parents=True)
    (root / "inner/a.json").write_text('{"x": 1}')
    (tmp_path / "secret.json").write_text("{}")
    return DataFolder(root)


@pytest.mark.parametrize(
    "path", ["../secret.json", "inner/../../secret.json", "/etc/passwd", "C:/x.json", "a\0b"]
)
def test_paths_that_lead_out_are_refused(data, path):
    with pytest.raises(ValueError, match="leads out of the dataset"):
        data.read(path)


@pytest.mark.parametrize("name", ["../../secret.json", "..\\..\\secret.json", "/etc/passwd", "a/../../../x"])
def test_names_in_files_that_lead_out_are_refused(data, name):
    with pytest.raises(ValueError, match=r"inner/a\.json: names .* leads out of the dataset"):
        data.beside("inner/a.json", name)


def test_names_in_files_may_climb_within_the_dataset(data):
    assert data.beside("inner/deep/a.mtl", "../../b/c.png") == "b/c.png"


def test_links_that_lead_out_are_refused(data, tmp_path):
    (data.root / "link.json").symlink_to(tmp_path / "secret.json")
    with pytest.raises(ValueError, match=r"link\.json: a link that leads out"):
        data.read("link.json")
    with pytest.raises(ValueError, match=r"link\.json: a link that leads out"):
        data.digest("inner/a.json")


def test_what_is_not_there_is_named(data):
    with pytest.raises(ValueError, match=r"inner/b\.json: no such file"):
        data.read_json("inner/b.json")
    with pytest.raises(ValueError, match=r"inner/b\.json: no such file"):
        data.digest("inner/b.json")
    with pytest.raises(ValueError, match="outer: no such folder"):
        data.folders("outer")


def test_large_files_are_refused(data):
    with pytest.raises(ValueError, match=r"inner/a\.json: 8 bytes; at most 7"):
        data.read("inner/a.json", 7)


@pytest.mark.parametrize("text", ["{", "[" * 100_000, '{"x": NaN}', "\xff", ""])
def test_damaged_json_is_refused(data, text):
    (data.root / "bad.json").write_bytes(text.encode("latin1"))
    with pytest.raises(ValueError, match=r"bad\.json: damaged JSON"):
        data.read_json("bad.json")


def test_text_that_is_no_text_is_refused(data):
    (data.root / "bad.txt").write_bytes(b"a\xff")
    with pytest.raises(ValueError, match=r"bad\.txt: not UTF-8"):
        data.read_lines("bad.txt")


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "a\\b", "c:d", "a\nb"])
def test_names_that_are_paths_are_refused(name):
    with pytest.raises(ValueError, match=r"scene: .* is no plain name"):
        plain_name(name, "scene")


def test_too_many_files_are_refused(data, monkeypatch):
    monkeypatch.setattr(files, "MAX_FILES", 0)
    with pytest.raises(ValueError, match="more than 0 files"):
        data.digest("inner/a.json")


def test_the_identity_follows_contents_and_names_but_not_dates_or_place(data, tmp_path):
    first = data.identity
    copy = tmp_path / "copy"
    (copy / "inner").mkdir(parents=True)
    (copy / "inner/a.json").write_text('{"x": 1}')
    os.utime(copy / "inner/a.json", (0, 0))
    assert DataFolder(copy).identity == first
    (copy / "inner/a.json").write_text('{"x": 2}')
    assert DataFolder(copy).identity != first
    (copy / "inner/a.json").rename(copy / "inner/b.json")
    (copy / "inner/b.json").write_text('{"x": 1}')
    assert DataFolder(copy).identity != first


def test_what_was_hashed_before_is_not_read_again(data, monkeypatch):
    first = data.identity
    monkeypatch.setattr(files, "_sha256", lambda place: pytest.fail(f"{place} is read again"))
    assert DataFolder(data.root).identity == first


def test_a_damaged_note_of_digests_is_made_again(data, caplog):
    first = data.identity
    for note in (files.cache_folder() / "digests").iterdir():
        note.write_text("[1]")
    assert DataFolder(data.root).identity == first
    assert "damaged" in caplog.text
