import io
import stat
import struct
import zipfile

import pytest

from langwm_data.scenes.catalogue import archive
from langwm_data.scenes.catalogue.archive import ArchiveError, open_archive


def write_zip(path, *entries, compression=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, data in entries:
            file.writestr(name, data)
    return path


def zip_bytes(*entries):
    buffer = io.BytesIO()
    write_zip(buffer, *entries)
    return buffer.getvalue()


def refuse(path):
    with open_archive(path):
        pass


def test_files_are_listed_without_folders_and_read(tmp_path):
    path = write_zip(tmp_path / "a.sh3f", ("x/", b""), ("x/one.txt", b"1"), ("two.txt", b"22"))
    with open_archive(path) as opened:
        assert opened.names() == ("x/one.txt", "two.txt")
        assert opened.read("x/one.txt") == b"1"
        assert "two.txt" in opened
        assert "x/" not in opened
        assert opened.checksum("two.txt") == (zipfile.crc32(b"22"), 2)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("../out.txt", "leads out of the archive"),
        ("a/../../out.txt", "leads out of the archive"),
        ("/etc/passwd", "has an absolute name"),
        ("C:/boot.ini", "has an absolute name"),
        ("a\\b.txt", "has a name that is no plain path"),
        ("a\nb.txt", "has a name that is no plain path"),
    ],
)
def test_names_that_are_no_plain_paths_are_refused(tmp_path, name, sentence):
    path = write_zip(tmp_path / "evil.sh3f", (name, b"x"))
    with pytest.raises(ArchiveError, match=rf"^evil.sh3f: entry .* {sentence}$"):
        refuse(path)


def test_symbolic_links_are_refused(tmp_path):
    link = zipfile.ZipInfo("model.obj")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    path = write_zip(tmp_path / "link.sh3f", (link, b"/etc/passwd"))
    with pytest.raises(ArchiveError, match=r"link.sh3f: entry 'model.obj' is a link or a device"):
        refuse(path)


def test_a_zip_bomb_is_refused_unread(tmp_path):
    path = write_zip(tmp_path / "bomb.sh3f", ("bomb.obj", bytes(2**24)))
    with pytest.raises(
        ArchiveError, match=r"bomb.sh3f: entry 'bomb.obj' is 16777216 bytes packed into \d+; "
    ):
        refuse(path)


@pytest.mark.parametrize(
    ("limit", "value", "sentence"),
    [
        ("MAX_ENTRIES", 1, "2 entries; at most 1 are read"),
        ("MAX_ENTRY_BYTES", 3, "entry 'a' has 4 bytes; at most 3 are read"),
        ("MAX_TOTAL_BYTES", 7, "8 bytes unpacked; at most 7 are read"),
        ("MAX_ARCHIVE_BYTES", 10, r"\d+ bytes; at most 10 are read"),
    ],
)
def test_limits_on_number_and_size(tmp_path, monkeypatch, limit, value, sentence):
    path = write_zip(tmp_path / "big.sh3f", ("a", b"1234"), ("b", b"1234"))
    monkeypatch.setattr(archive, limit, value)
    with pytest.raises(ArchiveError, match=f"big.sh3f: {sentence}"):
        refuse(path)


def test_a_file_that_lies_about_its_size_is_refused(tmp_path):
    path = write_zip(tmp_path / "lie.sh3f", ("a.txt", b"1234567890"), compression=zipfile.ZIP_STORED)
    data = bytearray(path.read_bytes())
    at = data.rindex(b"PK\x01\x02")
    data[at + 24 : at + 28] = struct.pack("<I", 1_000_000)  # uncompressed size in the directory
    path.write_bytes(data)
    with pytest.raises(ArchiveError, match=r"lie.sh3f: 'a.txt' "), open_archive(path) as opened:
        opened.read("a.txt")


def test_damage_is_noticed(tmp_path):
    path = write_zip(tmp_path / "hurt.sh3f", ("a.txt", b"1234567890"), compression=zipfile.ZIP_STORED)
    path.write_bytes(path.read_bytes().replace(b"1234567890", b"1234567899"))
    with (
        open_archive(path) as opened,
        pytest.raises(ArchiveError, match=r"hurt.sh3f: 'a.txt' cannot be read"),
    ):
        opened.read("a.txt")


def test_whatever_is_changed_is_read_or_refused_in_a_sentence(tmp_path):
    good = write_zip(
        tmp_path / "good.sh3f", ("a.txt", b"1234567890"), ("b/c.obj", b"v 0 0 0\n" * 20)
    ).read_bytes()
    refused = 0
    for place in range(len(good)):
        for damaged in (
            good[:place] + bytes([good[place] ^ 1 << place % 8]) + good[place + 1 :],
            good[:place],
        ):
            path = tmp_path / "hurt.sh3f"
            path.write_bytes(damaged)
            try:
                with open_archive(path) as opened:
                    for name in opened.names():
                        opened.read(name)
            except ArchiveError as error:
                assert str(error).startswith("hurt.sh3f: ")  # noqa: PT017
                refused += 1
    assert refused > len(good)


def test_encrypted_entries_and_odd_methods_are_refused(tmp_path):
    path = write_zip(tmp_path / "locked.sh3f", ("a.txt", b"1"))
    data = bytearray(path.read_bytes())
    at = data.rindex(b"PK\x01\x02")
    data[at + 8] |= 1
    path.write_bytes(data)
    with pytest.raises(ArchiveError, match="is encrypted"):
        refuse(path)
    path = write_zip(tmp_path / "odd.sh3f", ("a.txt", b"1" * 99), compression=zipfile.ZIP_LZMA)
    with pytest.raises(ArchiveError, match="is compressed by method 14; allowed: stored, deflated"):
        refuse(path)


def test_a_name_that_stands_twice_is_refused(tmp_path):
    with pytest.warns(UserWarning, match="Duplicate name"):
        path = write_zip(tmp_path / "twice.sh3f", ("a.txt", b"1"), ("a.txt", b"2"))
    with pytest.raises(ArchiveError, match=r"entry 'a.txt' stands twice in the directory"):
        refuse(path)


def test_what_is_no_zip_and_what_is_missing(tmp_path):
    path = tmp_path / "text.sh3f"
    path.write_text("hello")
    with pytest.raises(ArchiveError, match=r"text.sh3f: not a zip archive"):
        refuse(path)
    with (
        open_archive(write_zip(tmp_path / "a.sh3f", ("a", b""))) as opened,
        pytest.raises(ArchiveError, match=r"a.sh3f: no file 'b' in it"),
    ):
        opened.read("b")


def test_archives_in_archives_are_read_one_deep(tmp_path):
    inner = zip_bytes(("deepest.zip", zip_bytes(("a.txt", b"1"))), ("b.txt", b"2"))
    path = write_zip(tmp_path / "outer.sh3f", ("inner.zip", inner))
    with open_archive(path) as outer, outer.nested("inner.zip") as opened:
        assert opened.read("b.txt") == b"2"
        with (
            pytest.raises(ArchiveError, match=r"outer.sh3f!inner.zip!deepest.zip: archives lie more than 1"),
            opened.nested("deepest.zip"),
        ):
            pass


def test_nested_archives_are_checked_as_well(tmp_path):
    inner = zip_bytes(("../../x", b""))
    path = write_zip(tmp_path / "outer.sh3f", ("inner.zip", inner))
    with (
        open_archive(path) as outer,
        pytest.raises(ArchiveError, match=r"outer.sh3f!inner.zip: entry '../../x' leads out"),
        outer.nested("inner.zip"),
    ):
        pass
