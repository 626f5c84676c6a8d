"""A dataset at a URL: fsspec's own ``file`` and ``memory``, no network."""

import hashlib
import sys
from dataclasses import replace

import fsspec
import pytest

from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import ConfigError, build_config, config_to_yaml
from langwm_data.pipeline import render_range
from langwm_data.remote import RemoteFolder

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 3,
        "camera": {"height": 24, "width": 30},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.0},
        "shards": {"samples_per_shard": 1},
    },
)


def contents(folder):
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    return contents(render_dataset(CONFIG, tmp_path_factory.mktemp("local") / "dataset"))


def test_a_url_holds_the_same_bytes_as_a_folder_after_ranges_and_resumption(expected, tmp_path):
    url = f"file://{tmp_path}/bucket/data"
    assert not render_range(CONFIG, url, range(2, 3))
    (tmp_path / "bucket/data/train/.train-000001.tar.abcd.tmp").write_bytes(b"of a job that was killed")
    calls = []
    assert render_dataset(CONFIG, url, progress=lambda *a: calls.append(a)) == url
    assert calls[0] == (1, 3)
    assert contents(tmp_path / "bucket/data") == expected
    render_dataset(CONFIG, url, progress=lambda *a: calls.append(a))
    assert calls[-1] == (3, 3)
    assert len(calls) == 3


def test_a_shard_that_arrived_short_is_made_again(expected, tmp_path):
    url, folder = f"file://{tmp_path}/data", tmp_path / "data"
    render_range(CONFIG, url, range(2))
    tar = folder / "train/train-000000.tar"
    tar.write_bytes(tar.read_bytes()[:-512])
    calls = []
    render_dataset(CONFIG, url, progress=lambda *a: calls.append(a))
    assert calls[0] == (1, 3)
    assert contents(folder) == expected


def test_work_of_another_version_is_removed_there_too(expected, tmp_path):
    url, folder = f"file://{tmp_path}/data", tmp_path / "data"
    render_range(CONFIG, url, range(2))
    (folder / ".work/fingerprint").write_text("another version")
    calls = []
    render_dataset(CONFIG, url, progress=lambda *a: calls.append(a))
    assert calls[0] == (0, 3)
    assert contents(folder) == expected


def test_what_is_put_appears_whole_and_is_removed_again(tmp_path):
    (tmp_path / "train").mkdir()
    (tmp_path / "train/a.tar").write_bytes(b"0123456789")
    remote = RemoteFolder("memory://bucket/data")
    assert remote.names("train") == {}
    remote.put(tmp_path, "train/a.tar")
    assert remote.names("train") == {"train/a.tar": 10}
    assert fsspec.filesystem("memory").cat("/bucket/data/train/a.tar") == b"0123456789"
    remote.get("train/a.tar", tmp_path / "back")
    assert (tmp_path / "back/train/a.tar").read_bytes() == b"0123456789"
    remote.get("train/b.tar", tmp_path / "back")
    assert sorted(p.name for p in (tmp_path / "back/train").iterdir()) == ["a.tar"]
    remote.remove("train")
    remote.remove("train")
    assert remote.names("train") == {}


def test_an_upload_that_arrives_short_leaves_nothing(tmp_path, monkeypatch):
    memory = fsspec.filesystem("memory")
    monkeypatch.setattr(type(memory), "put_file", lambda self, here, there: self.pipe(there, b"0123"))
    (tmp_path / "short.tar").write_bytes(b"0123456789")
    remote = RemoteFolder("memory://bucket/short")
    with pytest.raises(OSError, match=r"short\.tar: 4 of 10 bytes arrived"):
        remote.put(tmp_path, "short.tar")
    assert remote.names() == {}


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("nothing://bucket", "--out 'nothing://bucket' cannot be opened: .*[Pp]rotocol not known"),
        ("memory://bucket", "is not empty and holds no config.yaml; give a new one"),
        ("memory://bucket/other", "is not empty and holds no config.yaml; give a new one"),
    ],
)
def test_urls_that_cannot_be_written_are_refused(url, message):
    fsspec.filesystem("memory").pipe("/bucket/other/photo.jpg", b"mine")
    with pytest.raises(ConfigError, match=message):
        render_dataset(CONFIG, url)


def test_another_configuration_is_refused_by_the_name_of_the_url(tmp_path):
    url = f"file://{tmp_path}/data"
    (tmp_path / "data").mkdir()
    (tmp_path / "data/config.yaml").write_text(config_to_yaml(replace(CONFIG, frames=99)))
    message = rf"--out '{url}' holds a run of another .*: frames \(99 .* or the same configuration$"
    with pytest.raises(ConfigError, match=message):
        render_dataset(CONFIG, url)


def test_fresh_removes_no_url():
    with pytest.raises(ConfigError, match="--fresh removes no URL; remove 'memory://x' yourself"):
        render_dataset(CONFIG, "memory://x", fresh=True)


def test_without_fsspec_a_url_is_refused_in_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(ConfigError, match="is a URL, which needs the package fsspec: pip install fsspec"):
        RemoteFolder("memory://x")
