"""A sound dataset passes, whoever looks and however many look."""

import io

import numpy as np
import pytest
from PIL import Image

from langwm_data import ShardDataset
from langwm_data.png import encode_png
from langwm_data.shards.card import FEATURES
from langwm_data.shards.document import CameraDocument, CaptionDocument, ObjectDocument, SampleDocument
from langwm_data.shards.manifest import MANIFEST_FILE
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.strict_png import read_png
from langwm_data.shards.verify import verify_dataset


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_rendered_dataset_is_sound_and_stays_as_it_is(sound):
    before, calls = contents(sound), []
    report = verify_dataset(sound, progress=lambda *a: calls.append(a))
    assert report.is_sound, report.as_text()
    assert report.as_text() == "sound: 10 frames in 3 shards"
    assert calls == [(n, 10) for n in range(1, 11)]
    assert contents(sound) == before


def test_two_workers_find_the_same(vandal):
    vandal.flip(vandal.test, 600)
    vandal.flip(vandal.train, 600)
    one = verify_dataset(vandal.folder)
    two = verify_dataset(str(vandal.folder), workers=2)
    assert one == two
    assert one.findings[0].where == vandal.train
    assert one.findings[-1].where == vandal.test


def test_what_is_no_dataset_is_a_wrong_request(tmp_path):
    with pytest.raises(DatasetError, match="the folder does not exist"):
        verify_dataset(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match=rf"it has no {MANIFEST_FILE}"):
        verify_dataset(tmp_path)


def test_the_strict_document_has_the_names_that_the_card_declares():
    declared = FEATURES["json"]
    assert list(declared) == list(SampleDocument.__annotations__)
    assert list(declared["camera"]) == list(CameraDocument.__annotations__)
    assert list(declared["objects"][0]) == list(ObjectDocument.__annotations__)
    assert list(declared["objects"][0]["captions"][0]) == list(CaptionDocument.__annotations__)


@pytest.mark.parametrize(
    ("shape", "dtype"), [((24, 32, 3), np.uint8), ((24, 32), np.uint8), ((24, 32), np.uint16)]
)
def test_the_strict_reader_reads_what_the_decoder_reads(shape, dtype):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype)
    np.testing.assert_array_equal(read_png(encode_png(image), shape, dtype), image)


def test_the_strict_reader_reads_filtered_rows(sound):
    for sample in ShardDataset(sound):
        buffer = io.BytesIO()
        Image.fromarray(sample.rgb).save(buffer, "PNG", optimize=True)
        np.testing.assert_array_equal(read_png(buffer.getvalue(), sample.rgb.shape, np.uint8), sample.rgb)


def test_more_findings_than_anyone_reads_end_the_shard(vandal, monkeypatch):
    monkeypatch.setattr("langwm_data.shards.shard_check.MAX_FINDINGS", 2)
    vandal.write([(n, b"{}" if n.endswith("json") else d) for n, d in vandal.files()])
    report = verify_dataset(vandal.folder)
    of_shard = [f.what for f in report.findings if f.where == vandal.train]
    assert len(of_shard) == 3
    assert of_shard[-1] == "more than 2 things are wrong; the rest of it was not looked at"


def test_a_finding_reads_as_one_line(vandal):
    vandal.edit_json(lambda d: d.update(building="a\n\x1b[31mred" + "x" * 500))
    lines = verify_dataset(vandal.folder).as_text().splitlines()
    line = next(line for line in lines if line.startswith(f"{vandal.train} {vandal.key}: "))
    assert "\x1b" not in line
    assert len(line) < 300
    assert lines[-1] == f"damaged: {len(lines) - 1} findings in 10 frames in 3 shards"
