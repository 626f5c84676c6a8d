"""Damage a finished dataset at random and count what `verify` does not find.

Three kinds of damage, each undone before the next: one bit of any file; one value of a sample's document,
with checksums made to fit; the same, with the index made to fit as well. What nobody finds is listed.

python benchmarks/fuzz.py DATA [--flips 500] [--documents 3] [--seed 0], with DATA from
``langwm render-dataset --out DATA --frames 10 --set camera.height=48 --set camera.width=60 --set
shards.samples_per_shard=4``.
"""

import argparse
import dataclasses
import io
import json
import shutil
import tarfile
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from langwm_data.repair import rewrite_index
from langwm_data.shards.manifest import CARD_FILE, MANIFEST_FILE, read_manifest
from langwm_data.shards.sample import META_KEY
from langwm_data.shards.verify import verify_dataset
from langwm_data.shards.writer import TarWriter, sha256_of

Path_ = tuple[str | int, ...]
"""Where a value stands in a document."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Attempt:
    """One damage and what ``verify`` said of it."""

    file: str
    what: str
    said: tuple[str, ...]
    """Findings; none where it found nothing."""
    crash: str = ""

    @property
    def is_found(self) -> bool:
        """Whether it was found, by a sentence and not by a crash."""
        return bool(self.said) and not self.crash


def look(folder: Path, file: str, what: str) -> Attempt:
    """What ``verify`` says now."""
    try:
        findings = verify_dataset(folder).findings
    except Exception:  # any at all is what is looked for
        return Attempt(file=file, what=what, said=(), crash=traceback.format_exc())
    return Attempt(file=file, what=what, said=tuple(map(str, findings)))


def flip_bits(folder: Path, rng: np.random.Generator, count: int) -> Iterator[Attempt]:
    """Flip one bit of one file, ``count`` times; all kinds of files come equally often."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    for n in range(count):
        path = files[n % len(files)]
        good = path.read_bytes()
        place, bit = int(rng.integers(len(good))), int(rng.integers(8))
        damaged = bytearray(good)
        damaged[place] ^= 1 << bit
        path.write_bytes(damaged)
        yield look(folder, str(path.relative_to(folder)), f"byte {place}, bit {bit}")
        path.write_bytes(good)


def is_harmless(folder: Path, attempt: Attempt) -> bool:
    """Whether only words of the data card were changed, which are for people and may be."""
    if attempt.file != CARD_FILE or attempt.crash or attempt.is_found:
        return False
    text = (folder / CARD_FILE).read_bytes()
    return int(attempt.what.split()[1].strip(",")) >= text.index(b"---\n", 4)


def change_documents(
    folder: Path, rng: np.random.Generator, *, shard: str, key: str, with_index: bool, every: int = 1
) -> Iterator[Attempt]:
    """Change values of one sample's document in turn, all or one in ``every``; checksums are made to fit, and
    the index where that is asked for.
    """
    kept = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    document = json.loads(dict(read_files(folder / shard))[f"{key}.{META_KEY}"])
    for where, value in list(_values(document))[::every]:
        _put(document, where, _other(rng, value))
        _replace(folder / shard, f"{key}.{META_KEY}", json.dumps(document, separators=(",", ":")).encode())
        _put(document, where, value)
        reseal(folder)
        if with_index:
            rewrite_index(folder, read_manifest(folder))
        yield look(folder, shard, ".".join(map(str, where)))
        for path, data in kept.items():
            path.write_bytes(data)


def reseal(folder: Path) -> None:
    """Make sizes and checksums of shards in the manifest those of the files that are there."""
    path = folder / MANIFEST_FILE
    manifest = json.loads(path.read_text("utf-8"))
    for record in manifest["shards"]:
        tar = folder / record["path"]
        record |= {"bytes": tar.stat().st_size, "sha256": sha256_of(tar)}
    path.write_text(json.dumps(manifest, indent=2) + "\n")


def read_files(shard: Path) -> list[tuple[str, bytes]]:
    """Name and bytes of all files of a shard."""
    with tarfile.open(fileobj=io.BytesIO(shard.read_bytes())) as tar:
        return [(info.name, tar.extractfile(info).read()) for info in tar]  # pyright: ignore[reportOptionalMemberAccess]


def _replace(shard: Path, name: str, data: bytes) -> None:
    files = [(n, data if n == name else d) for n, d in read_files(shard)]
    with shard.open("wb") as file:
        tar = TarWriter(file)
        for each, content in files:
            tar.add(each, content)
        tar.finish()


def _values(value: Any, where: Path_ = ()) -> Iterator[tuple[Path_, Any]]:
    """Every number, text and switch in a document, and where it stands."""
    if isinstance(value, dict | list):
        for name, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _values(inner, (*where, name))
    else:
        yield where, value


def _put(document: Any, where: Path_, value: object) -> None:
    for name in where[:-1]:
        document = document[name]
    document[where[-1]] = value


def _other(rng: np.random.Generator, value: object) -> object:
    """Another value of the same type, not far away."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, float):
        return value + float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.001, 0.2))
    if isinstance(value, int):
        return value + int(rng.choice([-1, 1]))
    text = str(value)
    place = int(rng.integers(len(text))) if text else 0
    return text[:place] + chr(ord(text[place]) ^ 1) + text[place + 1 :] if text else "x"


def _report(name: str, attempts: list[Attempt], is_fine: Callable[[Attempt], bool]) -> bool:
    missed = [a for a in attempts if not a.is_found and not is_fine(a)]
    by_file = Counter(a.file for a in attempts)
    print(
        f"{name}: {len(attempts)} in {len(by_file)} files, {sum(a.is_found for a in attempts)} found,"
        f" {sum(map(is_fine, attempts))} harmless, {len(missed)} missed"
    )
    for attempt in missed:
        print(f"  {attempt.file}: {attempt.what} {attempt.crash}")
    return not missed


def main() -> None:
    """Damage a copy of the dataset in all three ways."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--flips", type=int, default=500)
    parser.add_argument("--documents", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    with tempfile.TemporaryDirectory(prefix="langwm-fuzz-") as scratch:
        folder = shutil.copytree(options.data, Path(scratch, "dataset"))
        is_fine = lambda attempt: is_harmless(folder, attempt)  # noqa: E731
        verdicts = [_report("bits", list(flip_bits(folder, rng, options.flips)), is_fine)]
        shards = [record.path for record in read_manifest(folder).shards]
        for with_index in (False, True):
            attempts = []
            for n in range(options.documents):
                shard = shards[n % len(shards)]
                key = read_files(folder / shard)[0][0].partition(".")[0]
                attempts += change_documents(folder, rng, shard=shard, key=key, with_index=with_index)
            name = f"documents, checksums{' and index' * with_index} made to fit"
            verdicts.append(_report(name, attempts, lambda _: False))
    raise SystemExit(0 if all(verdicts) else 1)


if __name__ == "__main__":
    main()
