"""A repaired dataset has the bytes of the one that was damaged, or repair refuses and changes nothing."""

import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest

import cli
from langwm_data.png import encode_png
from langwm_data.redraw import redraw_frames
from langwm_data.repair import repair_dataset
from langwm_data.shards.manifest import read_manifest
from langwm_data.shards.sample import DatasetError
from langwm_data.shards.verify import verify_dataset
from langwm_data.shards.writer import sha256_of


def contents(folder):
    return {str(p.relative_to(folder)): sha256_of(p) for p in sorted(folder.rglob("*")) if p.is_file()}


def verify_and_repair(folder):
    return repair_dataset(folder, verify_dataset(folder).findings)


def test_one_damaged_sample_is_rendered_again_and_the_others_keep_their_bytes(vandal, sound, monkeypatch):
    from langwm_data import frames

    rendered, make_sample = [], frames.RenderWorker.make_sample

    def counted(self, plan):
        rendered.append(plan.key)
        return make_sample(self, plan)

    monkeypatch.setattr(frames.RenderWorker, "make_sample", counted)
    vandal.flip(vandal.train, vandal.place("rgb.png").offset + 50)
    assert verify_and_repair(vandal.folder) == [vandal.train]
    assert rendered == [vandal.key]
    assert contents(vandal.folder) == contents(sound)


def test_everything_at_once_is_repaired_to_the_same_bytes(vandal, sound):
    folder = vandal.folder
    vandal.flip(vandal.test, 600)
    (folder / vandal.train).write_bytes((folder / vandal.train).read_bytes()[:20_000])
    (folder / "train/train-000001.tar").unlink()
    (folder / "scenes" / sorted(p.name for p in (folder / "scenes").iterdir())[0]).write_text("{}")
    (folder / "config.yaml").write_text("frames: 1\n")
    (folder / "README.md").unlink()
    pq.write_table(pq.read_table(folder / "index/frames.parquet").slice(1), folder / "index/frames.parquet")
    (folder / "index/objects.parquet").write_bytes(b"")
    made = verify_and_repair(folder)
    assert len(made) == 8
    assert contents(folder) == contents(sound)
    assert verify_dataset(folder).is_sound


def test_pixels_that_no_label_knows_of_are_found_by_drawing_again(vandal, sound):
    vandal.edit("rgb.png", lambda _: encode_png(np.full((48, 60, 3), 7, np.uint8)))
    assert not [f for f in verify_dataset(vandal.folder).findings if f.where == vandal.train]
    repaired = vandal.folder / "index"
    shutil.rmtree(repaired)
    repair_dataset(vandal.folder, verify_dataset(vandal.folder).findings)
    findings = redraw_frames(vandal.folder, 10)
    assert [(f.where, f.key) for f in findings] == [(vandal.train, vandal.key)]
    assert "rgb drawn again differs in 2880 pixels, by up to" in findings[0].what


def test_shares_that_no_silhouette_has_are_found_by_drawing_again(vandal):
    def lie(document):
        obj = next(o for o in document["objects"] if o["captions"])
        obj.update(truncated_fraction=0.5, occluded_fraction=0.5, visible_fraction=0.25)

    vandal.edit_json(lie)
    (vandal.folder / "index/frames.parquet").unlink()
    repair_dataset(vandal.folder, verify_dataset(vandal.folder).findings)
    assert verify_dataset(vandal.folder).is_sound
    findings = redraw_frames(vandal.folder, 10)
    assert [f.key for f in findings] == [vandal.key] * 3
    assert "_fraction is 0." in findings[0].what


def test_drawing_again_agrees_with_a_sound_dataset(sound):
    calls = []
    assert redraw_frames(sound, 3, progress=lambda *a: calls.append(a)) == ()
    assert calls == [(1, 3), (2, 3), (3, 3)]


def test_a_checksum_that_nothing_can_meet_is_refused_and_nothing_changes(vandal):
    vandal.edit(
        "txt", lambda _: b"There is chair in the left 3 meters."
    )  # and the manifest's checksum with it
    before = contents(vandal.folder)
    with pytest.raises(DatasetError, match="made again it has another SHA-256 than the manifest says"):
        verify_and_repair(vandal.folder)
    assert contents(vandal.folder) == before


def test_a_scene_that_comes_out_otherwise_is_refused_and_stays(vandal):
    path = sorted((vandal.folder / "scenes").iterdir())[0]
    path.write_text("{}")
    files = read_manifest(vandal.folder).files
    vandal.edit_manifest(files=files | {f"scenes/{path.name}": "0" * 64})
    before = contents(vandal.folder)
    with pytest.raises(DatasetError, match=r"scenes/\w+\.json: made again it has another SHA-256"):
        verify_and_repair(vandal.folder)
    assert contents(vandal.folder) == before


def test_an_index_that_other_software_writes_gets_its_checksum_into_the_manifest(vandal, monkeypatch):
    (vandal.folder / "index/frames.parquet").unlink()
    monkeypatch.setattr("langwm_data.repair.write_table", lambda path, table: pq.write_table(table, path))
    verify_and_repair(vandal.folder)
    assert verify_dataset(vandal.folder).is_sound


def test_a_dataset_of_another_version_is_refused(vandal):
    vandal.flip(vandal.train, 600)
    vandal.edit_manifest(fingerprint="0" * 64, generator="langwm 0.0.1")
    before = contents(vandal.folder)
    for attempt in (verify_and_repair, lambda folder: redraw_frames(folder, 1)):
        with pytest.raises(DatasetError, match=r"by langwm 0\.0\.1 .* its frames cannot be drawn again"):
            attempt(vandal.folder)
    assert contents(vandal.folder) == before


def test_nothing_is_repaired_behind_a_link(vandal, tmp_path):
    (vandal.folder / "test").rename(tmp_path / "elsewhere")
    (vandal.folder / "test").symlink_to(tmp_path / "elsewhere")
    vandal.flip(vandal.test, 600)
    before = contents(tmp_path)
    with pytest.raises(DatasetError, match="is a link to another folder, in which nothing is repaired"):
        verify_and_repair(vandal.folder)
    assert contents(tmp_path) == before


def test_the_command_line_says_what_is_wrong_and_repairs_it(vandal, sound, capsys):
    command = ["verify", str(vandal.folder)]
    assert cli.run(command) == 0
    assert capsys.readouterr().out == "sound: 10 frames in 3 shards\n"
    vandal.flip(vandal.train, vandal.place("rgb.png").offset + 50)
    assert cli.run(command) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"{vandal.train} {vandal.key}: rgb.png has a wrong checksum in its chunk")
    assert lines[-1] == "damaged: 2 findings in 10 frames in 3 shards"
    assert cli.run([*command, "--repair", "--rerender", "2"]) == 0
    assert capsys.readouterr().out.splitlines()[-2:] == [
        f"repaired: {vandal.train}",
        "sound: 10 frames in 3 shards, 2 drawn again",
    ]
    assert contents(vandal.folder) == contents(sound)


def test_the_command_line_proves_or_fails_loudly(vandal, capsys):
    command = ["verify", str(vandal.folder), "--ood"]
    assert cli.run(command) == 0
    assert "proved: no held-out building, model or texture appears in training" in capsys.readouterr().out
    vandal.edit_json(lambda d: d["palette"].__setitem__(0, "wood/05"))
    assert cli.run(command) == 1
    assert f"{vandal.train} {vandal.key}: texture wood/05 is for test only" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere"], "the folder does not exist"),
        ([".", "--ood", "--repair"], "--ood is a proof of its own"),
        ([".", "--rerender", "-1"], "Invalid value for '--rerender'"),
    ],
)
def test_wrong_requests_are_one_sentence(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["verify", *arguments]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert len(err.strip().splitlines()) == 1
