"""A small rendered dataset, and tools to damage a copy of it and to make the checksums fit the damage."""

import dataclasses
import io
import json
import re
import shutil
import tarfile
from types import SimpleNamespace

import pytest

from langwm_data import render_dataset
from langwm_data.config import DatasetConfig
from langwm_data.config_io import build_config
from langwm_data.shards.manifest import MANIFEST_FILE, read_manifest
from langwm_data.shards.verify import verify_dataset
from langwm_data.shards.writer import TarWriter, sha256_of

CONFIG = build_config(
    DatasetConfig,
    {
        "frames": 10,
        "seed": 3,
        "camera": {"height": 48, "width": 60},
        "render": {"texture_px": 16},
        "splits": {"test_fraction": 0.2},
        "cameras": {"frames_per_palette": 8},
        "shards": {"samples_per_shard": 4},
    },
)


@pytest.fixture(scope="session")
def sound(tmp_path_factory):
    """Eight training frames of a floor, two test frames of another, in three shards. Do not write into it."""
    return render_dataset(CONFIG, tmp_path_factory.mktemp("verify") / "dataset")


@pytest.fixture
def folder(sound, tmp_path):
    """The same, to damage."""
    shutil.copytree(sound, tmp_path / "dataset")
    return tmp_path / "dataset"


@pytest.fixture
def vandal(folder):
    return Vandal(folder)


@pytest.fixture
def vandal_of():
    """For a dataset of one's own."""
    return Vandal


class Vandal:
    """Damages a dataset, and hides it from the checksums so that only the damage itself can be found."""

    train, test = "train/train-000000.tar", "test/test-000000.tar"

    def __init__(self, folder):
        self.folder = folder
        self.keys = self.keys_of(self.train)
        self.key = self.keys[1]
        """A frame in the middle of the first shard; it has a caption."""

    def keys_of(self, shard):
        with tarfile.open(self.folder / shard) as tar:
            return list(dict.fromkeys(name.partition(".")[0] for name in tar.getnames()))

    def files(self, shard=train):
        """All files of a shard as a list of (name, bytes)."""
        with tarfile.open(self.folder / shard) as tar:
            return [(m.name, tar.extractfile(m).read()) for m in tar]

    def write(self, files, shard=train):
        """A shard of these files, and a manifest that fits it."""
        with (self.folder / shard).open("wb") as file:
            tar = TarWriter(file)
            for name, data in files:
                tar.add(name, data)
            tar.finish()
        self.reseal()

    def write_infos(self, change, shard=train):
        """A shard of the same files by ``tarfile``, after ``change`` saw the header of ``key``'s rgb.png."""
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
            for name, data in self.files(shard):
                info = tarfile.TarInfo(name)
                info.size, info.mode = len(data), 0o444
                if name == f"{self.key}.rgb.png":
                    change(info)
                tar.addfile(info, io.BytesIO(data) if info.isreg() else None)
        (self.folder / shard).write_bytes(buffer.getvalue())
        self.reseal()

    def edit(self, name, change, shard=train):
        """Replace the bytes of one file of ``key``."""
        target = f"{self.key}.{name}"
        files = self.files(shard)
        assert target in dict(files)
        self.write([(n, change(d) if n == target else d) for n, d in files], shard)

    def edit_json(self, change, shard=train):
        """Change the document of ``key`` in place and write it as the generator does."""

        def edited(data):
            document = json.loads(data)
            change(document)
            return json.dumps(document, separators=(",", ":")).encode()

        self.edit("json", edited, shard)

    def captioned(self, document):
        """The first object with a caption."""
        return next(o for o in document["objects"] if o["captions"])

    def edit_manifest(self, **changes):
        path = self.folder / MANIFEST_FILE
        path.write_text(json.dumps(json.loads(path.read_text()) | changes, indent=2) + "\n")

    def reseal(self):
        """Make sizes and checksums in the manifest those of the shards."""
        shards = [
            dataclasses.asdict(record)
            | {
                "bytes": (self.folder / record.path).stat().st_size,
                "sha256": sha256_of(self.folder / record.path),
            }
            for record in read_manifest(self.folder).shards
        ]
        self.edit_manifest(shards=shards)

    def flip(self, path, offset, mask=1):
        """Flip bits of one byte; the checksum is left as it was."""
        data = bytearray((self.folder / path).read_bytes())
        data[offset] ^= mask
        (self.folder / path).write_bytes(data)

    def assert_found(self, message, *, where=train, key=None, also=""):
        """``verify`` says it of this file and key, and of the shard's other keys only of ``also``."""
        key = self.key if key is None else key
        findings = verify_dataset(self.folder).findings
        said = [f.what for f in findings if (f.where, f.key) == (where, key)]
        assert any(re.search(message, what) for what in said), "\n".join(map(str, findings))
        if key and where == self.train:
            assert {f.key for f in findings if f.where == where} <= {key, also, ""}

    def place(self, name, shard=train):
        """Offset and size of a file's bytes."""
        with tarfile.open(self.folder / shard) as tar:
            info = tar.getmember(f"{self.key}.{name}")
            return SimpleNamespace(offset=info.offset_data, size=info.size, header=info.offset)
