"""Every way to damage a shard is named by shard and key, also where the checksums were made to fit."""

import io
import os
import struct
import tarfile
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

from langwm_data.png import encode_png
from langwm_data.shards.sample import FILE_KEYS
from langwm_data.shards.verify import verify_dataset

HEIGHT, WIDTH = 48, 60


def png(image, **options):
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG", **options)
    return buffer.getvalue()


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def raw_png(header, stream):
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", stream) + chunk(b"IEND", b"")


def header(height=HEIGHT, width=WIDTH, bits=8, color=2, interlaced=0):
    return struct.pack(">IIBBBBB", width, height, bits, color, 0, 0, interlaced)


def with_chunk(data, kind, body):
    """A PNG with one more chunk behind its header."""
    return data[:33] + chunk(kind, body) + data[33:]


def nested(depth):
    return b"[" * depth + b"]" * depth


# What is done to the shard, and what verify says of (shard, key).

BYTES = {
    "a bit flipped in a picture": (
        lambda v: v.flip(v.train, v.place("rgb.png").offset + 100),
        "rgb.png has a wrong checksum in its chunk",
    ),
    "a bit flipped in a document": (
        lambda v: v.flip(v.train, v.place("json").offset + 3, 0x80),
        "json: Invalid JSON",
    ),
    "a bit flipped in a caption": (
        lambda v: v.flip(v.train, v.place("txt").offset + 4),
        "is not the caption of the largest captioned object",
    ),
    "a byte in the space after a file": (
        lambda v: v.flip(v.train, v.place("txt").offset + v.place("txt").size + 5),
        "txt: the space after it is not empty",
    ),
    "the last byte of a file": (
        lambda v: v.flip(v.train, v.place("depth.png").offset + v.place("depth.png").size - 1),
        "depth.png has a wrong checksum in its chunk b'IEND'",
    ),
}

WHOLE = {
    "a bit flipped in a tar header": (
        lambda v: v.flip(v.train, v.place("json").header + 3),
        r"the tar header at byte \d+ is damaged: bad checksum",
    ),
    "cut off in the middle": (
        lambda v: os.truncate(v.folder / v.train, v.place("depth.png").offset + 7),
        r"the tar is cut off at byte \d+",
    ),
    "cut off at the end": (
        lambda v: os.truncate(v.folder / v.train, (v.folder / v.train).stat().st_size - 512),
        "the tar is cut off at byte",
    ),
    "cut off to nothing": (lambda v: os.truncate(v.folder / v.train, 0), "the tar is cut off at byte 0"),
    "something behind its end": (
        lambda v: (v.folder / v.train).open("ab").write(b"\0" * 10239 + b"x"),
        "something stands after the end of the tar",
    ),
    "a second tar behind its end": (
        lambda v: (v.folder / v.train).open("ab").write((v.folder / v.test).read_bytes()),
        "something stands after the end of the tar",
    ),
    "missing": (lambda v: (v.folder / v.train).unlink(), "is missing"),
    "a folder": (
        lambda v: [(v.folder / v.train).unlink(), (v.folder / v.train).mkdir()],
        "is not a plain file",
    ),
    "a pipe": (
        lambda v: [(v.folder / v.train).unlink(), os.mkfifo(v.folder / v.train)],
        "is not a plain file",
    ),
    "exchanged with another": (
        lambda v: (v.folder / v.test).replace(v.folder / v.train),
        "its SHA-256 is not that of the manifest",
    ),
    "of another size": (
        lambda v: os.truncate(v.folder / v.train, 1 << 20),
        r"has 1048576 bytes; the manifest says \d+",
    ),
    "no tar": (
        lambda v: (v.folder / v.train).write_bytes(b"PK\3\4" * 4096),
        "the tar header at byte 0 is damaged",
    ),
    "a sample left out": (
        lambda v: v.write([f for f in v.files() if not f[0].startswith(v.key)]),
        "has 3 samples; the manifest says 4",
    ),
    "a file that claims terabytes": (
        lambda v: claim_terabytes(v),
        r"file '.*rgb\.png' claims 2199023255552 bytes; allowed: 16777216",
    ),
}


def claim_terabytes(vandal):
    path, place = vandal.folder / vandal.train, vandal.place("rgb.png")
    info = tarfile.TarInfo(f"{vandal.key}.rgb.png")
    info.size, info.mode = 1 << 41, 0o444
    data = bytearray(path.read_bytes())
    data[place.header : place.header + 512] = info.tobuf(tarfile.GNU_FORMAT)
    path.write_bytes(data)
    vandal.reseal()


def set_fields(info, **fields):
    for name, value in fields.items():
        setattr(info, name, value)


def reorder(vandal):
    files = vandal.files()
    i = next(i for i, (name, _) in enumerate(files) if name == f"{vandal.key}.depth.png")
    files[i], files[i + 1] = files[i + 1], files[i]
    vandal.write(files)


def interleave(vandal):
    files = vandal.files()
    i = next(i for i, (name, _) in enumerate(files) if name == f"{vandal.key}.txt")
    vandal.write([*files[:i], *files[i + 1 :], files[i]])


def rename(vandal, old, new):
    vandal.write([(new if n == f"{vandal.key}.{old}" else n, d) for n, d in vandal.files()])


def add(vandal, name, data=b"{}"):
    """One more file, behind those of ``key``."""
    files = vandal.files()
    i = next(i for i, (n, _) in enumerate(files) if n == f"{vandal.key}.txt")
    vandal.write([*files[: i + 1], (name.format(key=vandal.key), data), *files[i + 1 :]])


def swap(vandal, a, b):
    files = dict(vandal.files())
    ours, theirs = f"{vandal.key}.{a}", f"{vandal.key}.{b}"
    files[ours], files[theirs] = files[theirs], files[ours]
    vandal.write(list(files.items()))


def swap_with_next(vandal, *names):
    """Exchange files of ``key`` with those of the following sample."""
    files, other = dict(vandal.files()), vandal.keys[2]
    for name in names:
        ours, theirs = f"{vandal.key}.{name}", f"{other}.{name}"
        files[ours], files[theirs] = files[theirs], files[ours]
    vandal.write(list(files.items()))


TAR = {
    "files in another order": (reorder, "its files lie in the order rgb.png, instance.png, depth.png"),
    "files of a sample apart": (interleave, "its files are not next to each other, or it is there twice"),
    "a file left out": (
        lambda v: v.write([f for f in v.files() if f[0] != f"{v.key}.instance.png"]),
        "it lacks instance.png",
    ),
    "a file twice": (lambda v: add(v, "{key}.txt"), "txt is there twice"),
    "a sample twice": (lambda v: v.write([*v.files(), *v.files()[5:10]]), "or it is there twice"),
    "an unknown file": (lambda v: add(v, "{key}.pkl", b"cos\nsystem\n"), r"name '.*\.pkl' is not allowed"),
    "a name in capitals": (lambda v: rename(v, "txt", f"{v.key}.TXT"), "it lacks txt"),
    "a link": (
        lambda v: v.write_infos(
            lambda i: set_fields(i, type=tarfile.SYMTYPE, linkname="/etc/passwd", size=0)
        ),
        "rgb.png: it is a symbolic link",
    ),
    "a hard link": (
        lambda v: v.write_infos(lambda i: set_fields(i, type=tarfile.LNKTYPE, linkname="../x", size=0)),
        "rgb.png: it is a hard link",
    ),
    "a device": (
        lambda v: v.write_infos(lambda i: set_fields(i, type=tarfile.CHRTYPE, size=0)),
        "rgb.png: it is a device",
    ),
    "a folder for a file": (
        lambda v: v.write_infos(lambda i: set_fields(i, type=tarfile.DIRTYPE, size=0)),
        "rgb.png: it is a folder",
    ),
    "the right to run": (
        lambda v: v.write_infos(lambda i: set_fields(i, mode=0o4755)),
        "rgb.png: its tar header is not what the writer writes",
    ),
    "a date": (
        lambda v: v.write_infos(lambda i: set_fields(i, mtime=10**9)),
        "rgb.png: its tar header is not what the writer writes",
    ),
    "an owner": (
        lambda v: v.write_infos(lambda i: set_fields(i, uname="root")),
        "rgb.png: its tar header is not what the writer writes",
    ),
}

PICTURES = {
    "depth of 8 bits": (
        "depth.png",
        lambda d: encode_png(np.zeros((HEIGHT, WIDTH), np.uint8)),
        "depth.png is 8-bit gray; allowed: 16-bit gray",
    ),
    "instances of 8 bits": (
        "instance.png",
        lambda d: encode_png(np.ones((HEIGHT, WIDTH), np.uint8)),
        "instance.png is 8-bit gray; allowed: 16-bit gray",
    ),
    "instances in colour": (
        "instance.png",
        lambda d: encode_png(np.ones((HEIGHT, WIDTH, 3), np.uint8)),
        "instance.png is 8-bit RGB; allowed: 16-bit gray",
    ),
    "colour as gray": (
        "rgb.png",
        lambda d: encode_png(np.zeros((HEIGHT, WIDTH), np.uint8)),
        "rgb.png is 8-bit gray; allowed: 8-bit RGB",
    ),
    "colour with alpha": (
        "rgb.png",
        lambda d: png(np.zeros((HEIGHT, WIDTH, 4), np.uint8)),
        "rgb.png is 8-bit RGB with alpha",
    ),
    "another size": (
        "rgb.png",
        lambda d: encode_png(np.zeros((WIDTH, HEIGHT, 3), np.uint8)),
        "rgb.png is 60 x 48 pixels; allowed: 48 x 60",
    ),
    "no picture": ("rgb.png", lambda d: b"", "rgb.png is not a PNG"),
    "a JPEG": (
        "rgb.png",
        lambda d: cv2.imencode(".jpg", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes(),
        "rgb.png is not a PNG",
    ),
    "a header alone": ("rgb.png", lambda d: d[:8], "rgb.png is cut off"),
    "half a picture": ("rgb.png", lambda d: d[: len(d) // 2], "rgb.png is cut off"),
    "something behind its end": ("rgb.png", lambda d: d + b"PK", "something behind its end"),
    "a picture that claims gigapixels": (
        "rgb.png",
        lambda d: raw_png(header(65535, 65535), zlib.compress(bytes(100))),
        "rgb.png is 65535 x 65535 pixels",
    ),
    "a picture that unpacks to 200 MB": (
        "rgb.png",
        lambda d: raw_png(header(), zlib.compress(bytes(200_000_000))),
        r"rgb.png does not unpack to the \d+ bytes of its image",
    ),
    "too few rows": (
        "rgb.png",
        lambda d: raw_png(header(), zlib.compress(bytes(HEIGHT * (WIDTH * 3 + 1) - 1))),
        "rgb.png does not unpack to",
    ),
    "a broken stream": (
        "rgb.png",
        lambda d: raw_png(header(), b"\x78\x9cgarbage"),
        "rgb.png does not unpack",
    ),
    "an unknown filter": (
        "rgb.png",
        lambda d: raw_png(header(), zlib.compress(bytes([9]) * (HEIGHT * (WIDTH * 3 + 1)))),
        "rgb.png has a row with filter 9",
    ),
    "a text that unpacks to 50 MB": (
        "depth.png",
        lambda d: with_chunk(d, b"zTXt", b"k\0\0" + zlib.compress(bytes(50_000_000))),
        r"depth.png has the chunks .*zTXt.*; allowed: IHDR, IDAT, IEND",
    ),
    "an animation": ("rgb.png", lambda d: with_chunk(d, b"acTL", bytes(8)), r"rgb.png has the chunks .*acTL"),
    "interlaced": (
        "rgb.png",
        lambda d: raw_png(header(interlaced=1), zlib.compress(bytes(HEIGHT * (WIDTH * 3 + 1)))),
        "rgb.png is compressed, filtered or interlaced in an unknown way",
    ),
    "a long header": (
        "rgb.png",
        lambda d: raw_png(header() + b"\0", zlib.compress(b"")),
        "rgb.png has a damaged header",
    ),
}

DOCUMENTS = {
    "empty": (lambda d: b"", "json: Invalid JSON"),
    "not JSON": (lambda d: b"import os", "json: Invalid JSON"),
    "not UTF-8": (lambda d: b'{"scene":"\xff"}', "json: Invalid JSON"),
    "nested a million times": (lambda d: nested(10**6), "json: Invalid JSON: recursion limit exceeded"),
    "of 5 MB": (lambda d: d[:-1] + b" " * (5 << 20) + b"}", r"json has \d+ bytes; allowed: 4194304"),
    "a name of 2 MB": (
        lambda d: d.replace(b'"scene":"', b'"scene":"' + b"x" * (2 << 20), 1),
        "json: scene: String should have at most 1000 characters",
    ),
    "a list": (lambda d: b"[]", "json: Input should be an object"),
    "not a number": (
        lambda d: d.replace(b'"yaw_rad":', b'"yaw_rad":NaN,"x":', 1),
        "json: camera.yaw_rad: Input should be a finite number",
    ),
    "an infinite number": (
        lambda d: d.replace(b'"yaw_rad":', b'"yaw_rad":1e999,"x":', 1),
        "json: camera.yaw_rad: Input should be a finite number",
    ),
    "a number of 5000 digits": (
        lambda d: d.replace(b'"floor":', b'"floor":' + b"9" * 5000 + b',"x":', 1),
        "json: ",
    ),
    "nothing for a text": (
        lambda d: d.replace(b'"split":"train"', b'"split":null', 1),
        "json: split: Input should be a valid string",
    ),
    "a text for a number": (
        lambda d: d.replace(b'"floor":', b'"floor":"0","x":', 1),
        "json: floor: Input should be a valid integer",
    ),
    "a name twice": (
        lambda d: d.replace(b'{"scene"', b'{"split":"test","scene"', 1),
        "json is not written as the generator writes it",
    ),
    "a whole number for a real one": (
        lambda d: d.replace(b"[0.0,0.0,0.0,1.0]", b"[0.0,0.0,0.0,1]", 1),
        "json is not written as the generator writes it",
    ),
    "added space": (lambda d: d.replace(b",", b", ", 1), "json is not written as the generator writes it"),
    "an unknown name": (
        lambda d: d.replace(b'{"scene"', b'{"__reduce__":1,"scene"', 1),
        "json: __reduce__: Extra inputs are not permitted",
    ),
    "a name left out": (lambda d: d.replace(b'"floor":', b'"flor":', 1), "json: floor: Field required"),
}


@pytest.mark.parametrize("case", BYTES, ids=str)
def test_flipped_bits_are_named_by_shard_and_key(vandal, case):
    damage, message = BYTES[case]
    damage(vandal)
    vandal.assert_found(message)
    vandal.assert_found("its SHA-256 is not that of the manifest", key="")


@pytest.mark.parametrize("case", WHOLE, ids=str)
def test_a_shard_that_is_damaged_as_a_whole_is_named(vandal, case):
    damage, message = WHOLE[case]
    damage(vandal)
    vandal.assert_found(message, key="")


@pytest.mark.parametrize("case", TAR, ids=str)
def test_what_does_not_belong_in_a_tar_is_named(vandal, case):
    damage, message = TAR[case]
    damage(vandal)
    vandal.assert_found(message)


@pytest.mark.parametrize(
    "name",
    [
        "../../evil.json",
        "/etc/cron.d/evil.json",
        "..",
        "a/b.json",
        "C:\\evil.json",
        "{key}.json/../../evil.json",
        "a.b.json",
        "a b.json",
        "ключ.json",
        ".json",
        "\x1b[2Jevil.json",
    ],
)
def test_tricks_in_names_are_named_and_nothing_is_written(vandal, name, tmp_path):
    add(vandal, name)
    before = sorted(tmp_path.rglob("*"))
    findings = verify_dataset(vandal.folder).findings
    said = [
        f.what
        for f in findings
        if f.where == vandal.train and "is not allowed; allowed: <key>.rgb.png" in f.what
    ]
    assert len(said) == 1
    assert all(character.isprintable() for character in said[0])
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("case", PICTURES, ids=str)
def test_a_wrong_picture_is_named(vandal, case):
    name, change, message = PICTURES[case]
    vandal.edit(name, change)
    vandal.assert_found(message)


def test_pictures_exchanged_are_named(vandal):
    swap(vandal, "depth.png", "rgb.png")
    vandal.assert_found("rgb.png is 16-bit gray; allowed: 8-bit RGB")


@pytest.mark.parametrize("case", DOCUMENTS, ids=str)
def test_a_hostile_document_is_named(vandal, case):
    change, message = DOCUMENTS[case]
    vandal.edit("json", change)
    vandal.assert_found(message)


@pytest.mark.parametrize("name", ["depth.png", "instance.png", "txt"])
def test_files_of_another_sample_are_named(vandal, name):
    swap_with_next(vandal, name)
    assert any(
        f.key == vandal.key and f.where == vandal.train for f in verify_dataset(vandal.folder).findings
    )


def test_a_whole_sample_under_another_key_is_named(vandal):
    swap_with_next(vandal, *FILE_KEYS)
    findings = [f for f in verify_dataset(vandal.folder).findings if f.key == vandal.key]
    assert "in the index is" in findings[0].what


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\xff\xfe", "txt is not UTF-8"),
        (b"x" * 2000, "txt has 2000 bytes; allowed: 1000"),
        (b"", "txt '' is not the caption of the largest captioned object"),
        (b"There is chair in the left 3 meters.\n", "is not the caption of the largest captioned object"),
    ],
)
def test_a_wrong_text_is_named(vandal, data, message):
    vandal.edit("txt", lambda _: data)
    vandal.assert_found(message)
