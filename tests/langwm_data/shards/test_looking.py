"""What a person sees of a dataset: the summary and the gallery."""

import base64
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from langwm_data import ShardDataset
from langwm_data.shards.frame_picture import describe_frame, write_frame_picture
from langwm_data.shards.gallery import draw_depth, draw_instances, instance_color, write_gallery
from langwm_data.shards.plots import furniture_by_split, write_plots
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.summary import summarise


def test_summary_counts_what_is_there(folder):
    summary = summarise(folder)
    samples = list(ShardDataset(folder))
    captions = [c for s in samples for o in s.meta["objects"] for c in o["captions"]]
    assert summary.frames == {"train": 13, "test": 2}
    assert summary.scenes == {"train": {"Alder_0": 13}, "test": {"Rowan_0": 2}}
    assert summary.categories == {"sofa": 7, "chair": 4}
    assert summary.captions == len(captions) == 11
    assert summary.frames_without_caption == 4
    assert sum(summary.distances.values()) == 11
    assert summary.bytes_total == sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())
    assert summary.shards == 4


def test_summary_reads_well(folder):
    text = summarise(folder).as_text()
    assert "15 frames of 24 x 32 px, 4 shards" in text
    assert re.search(r"^train: 13 frames on 1 floor$", text, re.MULTILINE)
    assert re.search(r"^  sofa   7  █{30}$", text, re.MULTILINE)
    assert max(map(len, text.splitlines()[1:])) <= 80


def test_gallery_is_one_file_with_images_and_captions(folder, tmp_path):
    page = tmp_path / "gallery.html"
    write_gallery(folder, page, count=8)
    html = page.read_text()
    HTMLParser().feed(html)
    assert html.count('<section class="frame">') == 8
    images = re.findall(r'(?:src|href)="data:image/png;base64,([^"]+)"', html)
    assert len(images) == 4 + 3 * 8
    assert cv2.imdecode(np.frombuffer(base64.b64decode(images[4]), np.uint8), 1).shape == (24, 32, 3)
    assert not re.search(r'(?:src|href)="(?!data:)', html)
    captions = [s.caption for s in ShardDataset(folder) if s.caption]
    assert sum(caption in html for caption in captions) >= 4
    assert "Rowan_0-000000" in html


def test_gallery_shows_all_frames_of_a_smaller_dataset(folder, tmp_path):
    write_gallery(folder, tmp_path / "gallery.html", count=99)
    assert (tmp_path / "gallery.html").read_text().count('<section class="frame">') == 15


def test_gallery_of_nothing_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="the folder does not exist"):
        write_gallery(tmp_path / "nowhere", tmp_path / "gallery.html")
    assert not (tmp_path / "gallery.html").exists()


def test_objects_are_tinted_and_walls_are_not(folder):
    sample = ShardDataset(folder)[1]
    image = draw_instances(sample)
    wall = sample.instance == 1
    np.testing.assert_array_equal(image[wall], sample.rgb[wall])
    towards = np.array(instance_color(3)) - sample.rgb[~wall]
    assert ((image[~wall] - sample.rgb[~wall].astype(int)) * towards >= 0).all()


def test_depth_colours_run_with_depth_and_mark_invalid():
    depth = np.array([[0.0, 0.5, 2.0, 4.0, 9.0]], np.float32)
    image = draw_depth(depth, 4.0)
    assert image[0, 0].tolist() == [128, 128, 128]
    brightness = image[0, 1:].astype(int).sum(axis=1)
    assert (np.diff(brightness)[:2] > 0).all()
    assert image[0, 3].tolist() == image[0, 4].tolist()


def decode(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


def test_plots_are_pictures_named_for_what_they_show(folder, tmp_path):
    paths = write_plots(folder, tmp_path / "plots")
    names = {"distances.png", "areas.png", "visible_fractions.png", "categories.png"}
    assert {p.name for p in paths} == {p.name for p in (tmp_path / "plots").iterdir()} == names
    assert len({decode(p.read_bytes()).tobytes() for p in paths}) == 4


def test_plots_leave_out_the_structure_and_keep_all_furniture(folder):
    tables = furniture_by_split(ShardDataset(folder))
    counts = {split: sorted(set(table["category"].to_pylist())) for split, table in tables.items()}
    assert counts == {"train": ["chair", "sofa"], "test": ["sofa"]}
    assert sum(map(len, tables.values())) == sum(summarise(folder).categories.values())


def test_one_frame_is_described_by_its_objects_and_captions(folder):
    sample = ShardDataset(folder)["Alder_0-000003"]
    text = describe_frame(sample)
    assert text.startswith(
        "Alder_0-000003: train split, floor Alder_0, 2 materials\ncamera at (1.50, 2.50, 0.30) m"
    )
    rows = [line.split()[:2] for line in text.splitlines()[4:]]
    assert rows == [["1", "wall"], ["2", "chair"]]
    assert text.endswith(sample.caption)


def test_one_frame_is_drawn_with_its_own_pixels(folder, tmp_path):
    sample = ShardDataset(folder)["Alder_0-000003"]
    write_frame_picture(sample, tmp_path / "frame.png")
    drawn = decode((tmp_path / "frame.png").read_bytes())[..., ::-1]
    colors = set(map(tuple, drawn.reshape(-1, 3).tolist()))
    assert set(map(tuple, sample.rgb.reshape(-1, 3).tolist())) <= colors
    assert instance_color(2) in colors
    assert instance_color(3) not in colors
