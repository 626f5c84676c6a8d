import errno
import hashlib
import io
import subprocess
import tarfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from langwm_data.shards.writer import TarWriter, complete_shard, make_header, sha256_of, write_shard


@settings(max_examples=40)
@given(st.lists(st.binary(max_size=1500), min_size=1, max_size=5))
def test_python_reads_the_tar_and_offsets_are_right(contents):
    buffer = io.BytesIO()
    tar = TarWriter(buffer)
    places = [tar.add(f"a-{i:06d}.rgb.png", data) for i, data in enumerate(contents)]
    assert tar.finish() == hashlib.sha256(buffer.getvalue()).hexdigest()
    with tarfile.open(fileobj=io.BytesIO(buffer.getvalue())) as archive:
        members = archive.getmembers()
        assert [archive.extractfile(m).read() for m in members] == contents
        assert {(m.mtime, m.uid, m.gid, m.uname, m.gname) for m in members} == {(0, 0, 0, "", "")}
    for (offset, size), data in zip(places, contents, strict=True):
        assert buffer.getvalue()[offset : offset + size] == data


@given(st.from_regex(r"[A-Za-z0-9_.-]{1,100}", fullmatch=True), st.integers(0, 8**11 - 1))
def test_headers_are_those_of_tarfile(name, size):
    info = tarfile.TarInfo(name)
    info.size, info.mode = size, 0o444
    assert make_header(name, size) == info.tobuf(tarfile.USTAR_FORMAT)


def test_gnu_tar_lists_the_files_of_a_sample_together(folder):
    listing = subprocess.run(
        ["tar", "-tf", folder / "test/test-000000.tar"], capture_output=True, text=True, check=True
    )
    files = listing.stdout.split()
    assert [f.split(".")[0] for f in files] == ["Rowan_0-000000"] * 5 + ["Rowan_0-000001"] * 5
    assert [f.split(".", 1)[1] for f in files[:5]] == ["rgb.png", "depth.png", "instance.png", "json", "txt"]


def test_same_samples_give_the_same_bytes(tmp_path, sample_at):
    shas = {
        write_shard(tmp_path / name, "train", 0, (sample_at("train", n) for n in range(3))).sha256
        for name in ("a", "b")
    }
    assert len(shas) == 1


def test_a_shard_is_complete_only_with_its_record_and_its_bytes(tmp_path, sample_at):
    assert complete_shard(tmp_path, "train/train-000000.tar") is None
    record = write_shard(tmp_path, "train", 0, [sample_at("train", 0)])
    tar = tmp_path / record.path
    assert complete_shard(tmp_path, record.path) == record
    assert record.sha256 == sha256_of(tar)
    data = bytearray(tar.read_bytes())
    data[700] ^= 1
    tar.write_bytes(data)
    assert complete_shard(tmp_path, record.path) is None
    tar.write_bytes(data[:-512])
    assert complete_shard(tmp_path, record.path) is None
    tar.unlink()
    assert complete_shard(tmp_path, record.path) is None


def test_an_error_half_way_leaves_nothing_behind(tmp_path, sample_at):
    def samples():
        yield sample_at("train", 0)
        raise RuntimeError("renderer")

    with pytest.raises(RuntimeError, match="renderer"):
        write_shard(tmp_path, "train", 0, samples())
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []
    assert complete_shard(tmp_path, "train/train-000000.tar") is None


def test_a_full_disk_leaves_nothing_behind(tmp_path, sample_at, monkeypatch):
    def no_space(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(TarWriter, "_write", no_space)
    with pytest.raises(OSError, match="No space left"):
        write_shard(tmp_path, "train", 0, [sample_at("train", 0)])
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []
