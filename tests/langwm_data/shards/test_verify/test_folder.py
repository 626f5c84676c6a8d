"""What is wrong beside the shards is named: manifest, index, card, configuration, scenes, other files."""

import itertools
import json
import os
import re
import subprocess
import sys

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml

from langwm_data import ShardDataset
from langwm_data.shards.manifest import CARD_FILE, FRAMES_FILE, MANIFEST_FILE, OBJECTS_FILE
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.verify import verify_dataset

CONFIG_FILE = "config.yaml"
LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in itertools.pairwise("abcdefghijklmnopq")
)
"""Stands for 9 ** 17 words."""


def said(folder, where):
    """Everything that ``verify`` says of a file, and that it says it of no shard."""
    findings = verify_dataset(folder).findings
    assert not [f for f in findings if f.where.endswith(".tar")], "\n".join(map(str, findings))
    return " | ".join(f"{f.key} {f.what}" for f in findings if f.where == where)


def edit_table(path, change):
    table = pq.read_table(path)
    rows = table.to_pylist()
    change(rows)
    pq.write_table(pa.Table.from_pylist(rows, table.schema), path)


def changed(name, value):
    return lambda m: m.update({name: value})


MANIFESTS = {
    "no JSON": (lambda t: "{", "dataset.json is damaged: it is not JSON"),
    "nested a million times": (lambda t: "[" * 10**6, "."),
    "another version": (lambda t: t.replace('"schema_version": ', '"schema_version": 9'), "schema version"),
    "an unknown field": (lambda t: t.replace("{", '{"x": 1,', 1), "x: Unexpected keyword argument"),
    "a shard elsewhere": (
        lambda t: t.replace("train/train-000000", "../x/train-000000"),
        "is not of the form",
    ),
    "a negative size": (lambda t: t.replace('"bytes": ', '"bytes": -', 1), "."),
}


@pytest.mark.parametrize("case", MANIFESTS, ids=str)
def test_a_manifest_that_cannot_be_trusted_is_named_or_refused(folder, case):
    change, message = MANIFESTS[case]
    path = folder / MANIFEST_FILE
    path.write_text(change(path.read_text()))
    report = verify_dataset(folder)
    assert not report.is_sound
    assert re.search(message, report.as_text())
    assert all(len(str(finding)) < 500 for finding in report.findings)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("frames", lambda n: n + 1, "it has 11 frames; its shards have another number"),
        ("objects", lambda n: n + 1, r"it has \d+ objects; its categories have another number"),
        ("captions", lambda n: n + 1, "captions are not counted as in the manifest"),
        ("camera", lambda c: c | {"height": 49}, "its camera is not that of its configuration"),
        ("camera", lambda c: c | {"depth_unit_m": 0.01}, "its depth_unit_m is 0.01; allowed: 0.001"),
        ("config", lambda c: c | {"frames": "many"}, "its configuration is not one of this program"),
        ("config", lambda c: c | {"exec": "rm"}, "its configuration is not one of this program"),
        ("shards", lambda s: s[:2], "it has 10 frames; its shards have another number"),
        ("shards", lambda s: [s[1], s[0], s[2]], "its shards of train are not numbered from 0 on"),
        ("splits", lambda s: s | {"test": {"frames": 3, "scenes": {}}}, "it counts the frames of test as"),
        (
            "categories",
            lambda c: c | {"wall": c["wall"] - 1, "floor": c["floor"] + 1},
            "categories are not counted",
        ),
        ("fingerprint", lambda f: "0" * 64, "its fingerprint is not that of its config, sources, physics"),
        ("renderer", lambda r: r + "x", "its fingerprint is not that of its config"),
        ("physics", lambda p: "pybullet 9", "its fingerprint is not that of its config"),
        ("generator", lambda g: "langwm 9", "its fingerprint is not that of its config"),
        ("sources", lambda s: {"igibson": "0" * 64}, "its fingerprint is not that of its config"),
        ("category_ids", lambda c: c | {"sofa": 200}, "category_ids gives 'sofa' the number 200; here it"),
        ("files", lambda f: dict(list(f.items())[1:]), "its files are not those of its scenes and index"),
        ("files", lambda f: f | {"../x": "0" * 64}, r"its files are not those of .*: '\.\./x'"),
    ],
)
def test_numbers_that_do_not_fit_are_named(vandal, name, change, message):
    manifest = json.loads((vandal.folder / MANIFEST_FILE).read_text())
    vandal.edit_manifest(**{name: change(manifest[name])})
    report = verify_dataset(vandal.folder)
    assert re.search(message, report.as_text()), report.as_text()


def exchange(rows):
    rows[1], rows[2] = rows[2], rows[1]


FRAMES = {
    "rows exchanged": (exchange, r"its key in the index is '\w+-\d+'; the sample says"),
    "another offset": (
        lambda r: r[1].update(rgb_offset=0),
        "its rgb_offset in the index is 0; the sample says",
    ),
    "another size": (lambda r: r[1].update(json_bytes=1), "its json_bytes in the index is 1"),
    "another shard": (lambda r: r[1].update(shard="test/test-000000.tar"), "its shard in the index is"),
    "another split": (lambda r: r[1].update(split="test"), "its split in the index is 'test'"),
    "another place": (
        lambda r: r[1].update(camera_x=9.5),
        "its camera_x in the index is 9.5; the sample says",
    ),
    "another caption": (
        lambda r: r[1].update(caption="x"),
        "its caption in the index is 'x'; the sample says",
    ),
    "other materials": (lambda r: r[1].update(materials=["wood/05"]), "its materials in the index is"),
    "nothing for a number": (lambda r: r[1].update(yaw_rad=None), "its yaw_rad in the index is None"),
    "a key twice": (lambda r: r[1].update(key=r[0]["key"]), "this key is there 2 times"),
    "a path for a key": (lambda r: r[1].update(key="../../x"), r"its key in the index is '\.\./\.\./x'"),
}
OBJECTS = {
    "another box": (
        lambda r: r[1].update(x1=0.25),
        r"object \d+: its x1 in the index is 0.25; the sample says",
    ),
    "another category": (lambda r: r[1].update(category="tv"), "its category in the index is 'tv'"),
    "another bearing": (lambda r: r[1].update(bearing_rad=3.0), "its bearing_rad in the index is 3.0"),
    "other captions": (lambda r: r[1].update(captions=[]), "."),
    "no such frame": (lambda r: r[1].update(key="Oak_0-000001"), "row 1 belongs to no frame"),
    "rows of frames exchanged": (lambda r: r.reverse(), "is not in the order of the frames"),
}


@pytest.mark.parametrize(("path", "cases"), [(FRAMES_FILE, FRAMES), (OBJECTS_FILE, OBJECTS)])
def test_lies_of_the_index_are_named(folder, path, cases):
    good = (folder / path).read_bytes()
    for change, message in cases.values():
        (folder / path).write_bytes(good)
        edit_table(folder / path, change)
        if message != ".":
            assert re.search(message, said(folder, path)), said(folder, path)


def test_a_damaged_shard_is_no_fault_of_the_index(vandal):
    vandal.write([f for f in vandal.files() if not f[0].startswith(vandal.key)])
    (vandal.folder / "train/train-000001.tar").unlink()
    manifest = json.loads((vandal.folder / MANIFEST_FILE).read_text())
    manifest["shards"][0]["sha256"] = "0" * 64
    vandal.edit_manifest(shards=manifest["shards"])
    where = {f.where for f in verify_dataset(vandal.folder).findings}
    assert where == {vandal.train, "train/train-000001.tar"}


@pytest.mark.parametrize("path", [FRAMES_FILE, OBJECTS_FILE])
def test_an_index_that_cannot_be_read_is_named(folder, path):
    good = (folder / path).read_bytes()
    file = folder / path
    file.write_bytes(good[:-100])
    assert "is missing or is not a parquet file" in said(folder, path)
    pq.write_table(pa.table({"a": [1]}), file)
    assert "has other columns than this program writes" in said(folder, path)
    file.write_bytes(b"")
    assert "is missing or is not a parquet file" in said(folder, path)
    file.unlink()
    assert "is missing or is not a parquet file" in said(folder, path)


@pytest.mark.parametrize("path", [FRAMES_FILE, OBJECTS_FILE])
def test_flipped_bits_of_the_index_are_named(folder, path):
    good = (folder / path).read_bytes()
    for place in range(4, len(good), len(good) // 12):
        data = bytearray(good)
        data[place] ^= 0x10
        (folder / path).write_bytes(data)
        assert "its SHA-256 is not that of the manifest" in said(folder, path)


def test_names_in_the_index_that_are_not_utf8_are_refused(folder):
    path = folder / FRAMES_FILE
    good, refused = path.read_bytes(), []
    for match in re.finditer(b"rgb_offset", good):
        path.write_bytes(good[: match.start()] + b"\xe4" + good[match.start() + 1 :])
        assert "its SHA-256 is not that of the manifest" in said(folder, FRAMES_FILE)
        try:
            ShardDataset(folder)
        except DatasetError as error:
            refused.append(str(error))
    assert any(text.endswith("is missing or is not a parquet file") for text in refused)


EVERY_BYTE = """
import sys
from pathlib import Path
from langwm_data.shards.index import FRAMES_SCHEMA
from langwm_data.shards.index_check import open_index

path, out = map(Path, sys.argv[1:])
good = path.read_bytes()
refused = 0
for place in range(len(good) // 2, len(good), 2):
    out.write_bytes(good[:place] + bytes([good[place] ^ 1 << place // 2 % 8]) + good[place + 1 :])
    try:
        open_index(out, FRAMES_SCHEMA, 10)
    except ValueError:
        refused += 1
print(refused > len(good) // 32)
"""


def test_no_changed_bit_behind_the_rows_of_an_index_ends_the_process(sound, tmp_path):
    """Some versions of pyarrow abort where the metadata of a column is damaged and asked for."""
    command = [sys.executable, "-c", EVERY_BYTE, str(sound / FRAMES_FILE), str(tmp_path / "hurt.parquet")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout == "True\n", done.stderr


def test_fewer_rows_than_an_index_says_are_named(folder, monkeypatch):
    monkeypatch.setattr("langwm_data.shards.index_check._iter_batches", lambda file: iter(()))
    assert "it unpacks to 0 rows and says that it has 10" in said(folder, FRAMES_FILE)


def test_a_manifest_with_added_space_is_named(folder):
    path = folder / MANIFEST_FILE
    path.write_text(path.read_text() + "\n")
    assert "it is not written as the generator writes it" in said(folder, MANIFEST_FILE)


def test_tables_that_unpack_to_gigabytes_are_refused_unread(folder):
    schema = pq.read_schema(folder / FRAMES_FILE)
    rows = pq.read_table(folder / FRAMES_FILE).to_pylist()
    rows[0]["caption"] = "x" * 100_000_000
    pq.write_table(pa.Table.from_pylist(rows, schema), folder / FRAMES_FILE, compression="zstd")
    assert (folder / FRAMES_FILE).stat().st_size < 100_000
    assert re.search(
        r"unpacks to 100\d+ bytes in groups of rows; allowed for 10 rows: 1130496", said(folder, FRAMES_FILE)
    )
    with pytest.raises(DatasetError, match=r"unpacks to 100\d+ bytes in groups of rows"):
        ShardDataset(folder)
    many = pa.Table.from_pylist(rows[1:2], schema).take(pa.array([0] * 100_000))
    pq.write_table(many, folder / FRAMES_FILE, compression="zstd")
    assert "has 100000 rows; the manifest says 10" in said(folder, FRAMES_FILE)
    with pytest.raises(DatasetError, match="has 100000 rows; the manifest says 10"):
        ShardDataset(folder)


def test_the_reader_refuses_rows_that_cannot_be_unpacked(folder):
    for path in (FRAMES_FILE, OBJECTS_FILE):
        good = (folder / path).read_bytes()
        for place in range(4, len(good), len(good) // 8):
            (folder / path).write_bytes(good[:place] + bytes([good[place] ^ 0x10]) + good[place + 1 :])
            try:
                assert len(ShardDataset(folder).objects) > 0
            except DatasetError as error:
                assert path in str(error)  # noqa: PT017
        (folder / path).write_bytes(good)


CARDS = {
    "missing": (None, "is missing"),
    "without a head": (lambda t: "hello", "it has no head of YAML between two lines ---"),
    "no YAML": (lambda t: "---\na: [\n---\n", "it has no head of YAML"),
    "nested a hundred thousand times": (
        lambda t: f"---\n{'[' * 100_000}\n---\n",
        "its head is longer or deeper",
    ),
    "nested a thousand times": (lambda t: f"---\n{'[' * 1000}\n---\n", "its head is longer or deeper"),
    "nested by lists": (lambda t: f"---\n{'- ' * 20_000}x\n---\n", "it has no head of YAML"),
    "that stands for 9 ** 17 words": (lambda t: f"---\n{LAUGHS}---\n", "its head has aliases"),
    "that would run code": (
        lambda t: "---\n!!python/object/apply:os.system ['true']\n---\n",
        "it has no head of YAML",
    ),
    "of 2 MB": (lambda t: t + "x" * (2 << 20), r"has \d+ bytes; allowed: 1048576"),
    "of other files": (lambda t: t.replace("train/*.tar", "data/*.tar"), "its head has another 'configs'"),
    "of other types": (
        lambda t: t.replace("dtype: image", "dtype: string"),
        "its head has another 'dataset_info'",
    ),
    "a list": (lambda t: "---\n- a\n---\n", "its head is not a table"),
    "not UTF-8": (lambda t: "---\n\udcff\n---\n", "it has no head of YAML"),
}


@pytest.mark.parametrize("case", CARDS, ids=str)
def test_a_card_that_hugging_face_would_misread_is_named(folder, case):
    change, message = CARDS[case]
    path = folder / CARD_FILE
    text = path.read_text()
    path.unlink()
    if change is not None:
        path.write_bytes(change(text).encode("utf-8", "surrogateescape"))
    assert re.search(message, said(folder, CARD_FILE)), said(folder, CARD_FILE)


def test_words_of_a_card_may_be_changed(folder):
    text = (folder / CARD_FILE).read_text()
    (folder / CARD_FILE).write_text(
        text.replace("pretty_name: LanGWM homes", "pretty_name: Mine") + "\nThanks.\n"
    )
    assert verify_dataset(folder).is_sound


@pytest.mark.parametrize(
    "text", ["", LAUGHS, "[" * 100_000, "!!python/object/apply:os.system ['true']", "frames: 11\n"]
)
def test_another_configuration_is_named_and_never_parsed(folder, text, monkeypatch):
    (folder / CONFIG_FILE).write_text(text)
    monkeypatch.setattr(yaml, "compose", None)
    assert re.search(r"is not the configuration in dataset.json|allowed: \d+", said(folder, CONFIG_FILE))


def scene_of(folder):
    return sorted((folder / "scenes").iterdir())[0]


SCENES = {
    "missing": (lambda p: p.unlink(), "is missing"),
    "a pipe": (lambda p: [p.unlink(), os.mkfifo(p)], "is not a plain file"),
    "no JSON": (lambda p: p.write_text("{"), "not a scene"),
    "nested a million times": (lambda p: p.write_text("[" * 10**6), "recursion limit exceeded"),
    "another scene": (lambda p: p.write_bytes(sorted(p.parent.iterdir())[1].read_bytes()), "holds scene"),
    "for another split": (
        lambda p: p.write_text(p.read_text().replace('"split":"train"', '"split":"test"')),
        "is marked test; building",
    ),
    "an unknown name": (
        lambda p: p.write_text(p.read_text().replace("{", '{"x":1,', 1)),
        "x: Unexpected keyword",
    ),
    "a moved piece of furniture": (
        lambda p: p.write_text(re.sub(r'"position":\[(\d)', r'"position":[9\1', p.read_text(), count=1)),
        "its SHA-256 is not that of the manifest",
    ),
    "added space": (lambda p: p.write_text(p.read_text() + " "), "is not written as the generator writes it"),
    "a name twice": (
        lambda p: p.write_text(p.read_text().replace('"split":', '"split":"test","split":', 1)),
        "is not written as the generator writes it",
    ),
}


@pytest.mark.parametrize("case", SCENES, ids=str)
def test_a_damaged_scene_is_named(folder, case):
    change, message = SCENES[case]
    path = scene_of(folder)
    change(path)
    findings = [f for f in verify_dataset(folder).findings if f.where == f"scenes/{path.name}"]
    assert any(re.search(message, f.what) for f in findings), findings


@pytest.mark.parametrize(
    "name", ["train/train-000009.tar", "scenes/Oak_0.json", "index/x.parquet", "test/.hidden"]
)
def test_a_file_that_does_not_belong_is_named(folder, name):
    (folder / name).write_bytes(b"")
    report = verify_dataset(folder)
    assert [str(f) for f in report.findings] == [f"{name}: is no part of this dataset"]


def test_a_folder_that_leads_elsewhere_is_named(folder, tmp_path):
    (folder / "train").rename(tmp_path / "elsewhere")
    (folder / "train").symlink_to(tmp_path / "elsewhere")
    assert "train: is a link to another folder" in verify_dataset(folder).as_text()
