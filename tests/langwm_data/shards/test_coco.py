"""The export in the eyes of pycocotools, and what happens to requests that cannot be right."""

import contextlib
import json
from dataclasses import asdict

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

import cli
from langwm_data import ShardDataset, atomic
from langwm_data.config import LabelsConfig
from langwm_data.config_io import ConfigError
from langwm_data.labels.instances import label_frame
from langwm_data.labels.semantic import CATEGORY_IDS
from langwm_data.scenes.spec import InstanceName
from langwm_data.scenes.taxonomy import is_structure, phrase
from langwm_data.shards.coco import export_coco, run_lengths
from langwm_data.shards.finish import Origin, finish_dataset
from langwm_data.shards.manifest import CameraRecord
from langwm_data.shards.sample import DatasetError, Sample
from langwm_data.shards.writer import write_shard

HEIGHT, WIDTH = 48, 64
K = [[58.0, 0.0, 32.0], [0.0, 58.0, 24.0], [0.0, 0.0, 1.0]]
TABLE = {
    1: InstanceName("wall", "study_wall", "wall"),
    2: InstanceName("wall", "hall_wall", "wall"),
    3: InstanceName("floor", "study_floor", "floor"),
    4: InstanceName("ceiling", "study_ceiling", "ceiling"),
    5: InstanceName("door_frame", "door_frame_01", "door frame"),
    300: InstanceName("chair", "chair_01", "chair"),
    301: InstanceName("chair", "chair_02", "chair"),
    65535: InstanceName("sofa", "sofa_02", "sofa"),
}
EXTENT = {"visible_fraction": 0.25, "truncated_fraction": 0.5, "occluded_fraction": 0.5}
ANNOTATIONS = ("instances", "captions", "panoptic")


def make_sample(split, number):
    """Blobs before two walls, a floor and a ceiling; some pixels show nothing."""
    rng = np.random.default_rng([number, split == "test"])
    instance = np.full((HEIGHT, WIDTH), 1, np.uint16)
    instance[:, WIDTH // 2 :], instance[30:], instance[:6] = 2, 3, 4
    for obj in (5, 300, 301, 65535, 0):
        if rng.random() < 0.8:
            center = int(rng.integers(WIDTH)), int(rng.integers(HEIGHT))
            axes = int(rng.integers(3, 16)), int(rng.integers(3, 16))
            blob = np.zeros((HEIGHT, WIDTH), np.uint8)
            cv2.ellipse(blob, center, axes, float(rng.uniform(0, 180)), 0, 360, 1, -1)
            instance[(blob > 0) & (rng.random((HEIGHT, WIDTH)) < 0.95)] = obj
    depth = rng.uniform(0.5, 9, (HEIGHT, WIDTH)).astype(np.float32)
    labels = label_frame(instance, depth, TABLE, LabelsConfig(), rng)
    camera = {
        "height": HEIGHT,
        "width": WIDTH,
        "K": K,
        "camera_to_world": np.eye(4).tolist(),
        "yaw_rad": 0.0,
        "pitch_rad": 0.0,
    }
    return Sample(
        key=f"{'Alder' if split == 'train' else 'Rowan'}_0-{number:06d}",
        rgb=rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8),
        depth=depth,
        instance=instance,
        meta={
            "scene": "Alder_0" if split == "train" else "Rowan_0",
            "building": "Alder" if split == "train" else "Rowan",
            "floor": 0,
            "split": split,
            "palette": ["wood/01"],
            "lights": {
                "ambient": [0.5] * 3,
                "sun": [0.25] * 3,
                "lamp": [0.5] * 3,
                "sun_direction": [0.0, 0.0, 1.0],
            },
            "trajectory": -1,
            "step": 0,
            "action": [0.0, 0.0],
            "pose": [0.0, 0.0, 0.0],
            "camera": camera,
            "objects": [asdict(o) | EXTENT for o in labels],
        },
        caption="",
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Twelve training frames in two shards and four test frames."""
    folder = tmp_path_factory.mktemp("blobs")
    shards = [("train", 0, range(6)), ("train", 1, range(6, 12)), ("test", 0, range(4))]
    records = [
        write_shard(folder, split, n, (make_sample(split, i) for i in frames)) for split, n, frames in shards
    ]
    camera = CameraRecord(height=HEIGHT, width=WIDTH, K=K, depth_unit_m=0.001)
    origin = Origin(
        generator="langwm 0",
        fingerprint="1" * 64,
        physics="none",
        renderer="none",
        config={},
        sources={},
        camera=camera,
    )
    for scene in ("Alder_0", "Rowan_0"):
        atomic.write_text(folder / f"scenes/{scene}.json", "{}")
    finish_dataset(folder, records, origin)
    return ShardDataset(folder)


@pytest.fixture(scope="module")
def exported(dataset, tmp_path_factory):
    return export_coco(dataset.path, tmp_path_factory.mktemp("coco") / "out")


def load(path):
    with contextlib.redirect_stdout(None):
        return COCO(str(path))


def pairs(exported, dataset, kind):
    """Every sample with its image entry and annotations, as pycocotools finds them."""
    for split in dataset.manifest.splits:
        coco = load(exported / f"annotations/{kind}_{split}.json")
        image_of = {image["file_name"]: image for image in coco.imgs.values()}
        part = dataset.select(split=split)
        assert sorted(image_of) == sorted(f"{key}.png" for key in part.keys)
        for sample in part:
            image = image_of[f"{sample.key}.png"]
            yield split, coco, sample, image, coco.imgToAnns[image["id"]]


def read_panoptic(exported, split):
    """pycocotools reads no panoptic files: theirs have no category per annotation."""
    return json.loads((exported / f"annotations/panoptic_{split}.json").read_text())


def test_masks_boxes_and_areas_are_those_of_the_dataset(exported, dataset):
    for _, coco, sample, image, annotations in pairs(exported, dataset, "instances"):
        assert (image["height"], image["width"]) == sample.instance.shape
        objects = [o for o in sample.meta["objects"] if not is_structure(o["category"])]
        assert [a["instance"] for a in annotations] == [o["instance"] for o in objects]
        for annotation, obj in zip(annotations, objects, strict=True):
            encoded = coco.annToRLE(annotation)
            mask = sample.instance == obj["instance"]
            np.testing.assert_array_equal(coco_mask.decode(encoded).astype(bool), mask)
            assert annotation["area"] == coco_mask.area(encoded) == mask.sum()
            assert annotation["bbox"] == coco_mask.toBbox(encoded).tolist()
            assert coco.cats[annotation["category_id"]]["name"] == obj["category"]
            assert annotation.items() >= EXTENT.items()


def test_ground_truth_scores_one_against_itself(exported):
    truth = load(exported / "annotations/instances_train.json")
    found = [
        {k: a[k] for k in ("image_id", "category_id", "bbox")}
        | {"segmentation": truth.annToRLE(a), "score": 1.0}
        for a in truth.anns.values()
    ]
    for kind in ("segm", "bbox"):
        with contextlib.redirect_stdout(None):
            judge = COCOeval(truth, truth.loadRes(found), kind)
            judge.evaluate()
            judge.accumulate()
            judge.summarize()
        assert judge.stats[0] == pytest.approx(1.0)


def test_category_ids_are_those_of_semantic_masks(exported, dataset):
    for split in dataset.manifest.splits:
        categories = read_panoptic(exported, split)["categories"]
        assert {c["name"]: c["id"] for c in categories} == CATEGORY_IDS
        assert {c["name"] for c in categories if not c["isthing"]} == {"wall", "floor", "ceiling"}
    for _, coco, *_ in pairs(exported, dataset, "instances"):
        assert {c["name"]: c["id"] for c in coco.cats.values()}.items() < CATEGORY_IDS.items()
        assert not {"wall", "floor", "ceiling"} & {c["name"] for c in coco.cats.values()}


def test_captions_come_with_every_slot(exported, dataset):
    num = 0
    for _, coco, sample, _, annotations in pairs(exported, dataset, "captions"):
        written = [(o, c) for o in sample.meta["objects"] for c in o["captions"]]
        for annotation, (obj, caption) in zip(annotations, written, strict=True):
            assert annotation["caption"] == caption["text"]
            assert {k: annotation[k] for k in caption if k != "text"} == {
                k: v for k, v in caption.items() if k != "text"
            }
            assert annotation["instance"] == obj["instance"]
            assert annotation["object"] == phrase(obj["category"])
            assert all(annotation[slot] in caption["text"] for slot in ("object", "direction", "distance"))
            assert coco.cats[annotation["category_id"]]["name"] == obj["category"]
            num += 1
    assert num == dataset.manifest.captions > 0


def test_ids_are_unique_over_the_splits_images_and_never_zero(exported, dataset):
    images = []
    for kind in ANNOTATIONS:
        documents = [
            json.loads((exported / f"annotations/{kind}_{s}.json").read_text())
            for s in dataset.manifest.splits
        ]
        images.append([image["id"] for document in documents for image in document["images"]])
        assert images[-1] == list(range(1, len(dataset) + 1))
        for document in documents:
            assert document["info"]["version"] == dataset.manifest.fingerprint
            if kind != "panoptic":
                assert [a["id"] for a in document["annotations"]] == list(
                    range(1, len(document["annotations"]) + 1)
                )


def test_colour_images_are_those_of_the_dataset(exported, dataset):
    for split, _, sample, image, _ in pairs(exported, dataset, "captions"):
        picture = cv2.imread(str(exported / split / image["file_name"]), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(picture[..., ::-1], sample.rgb)


@given(hnp.arrays(np.uint16, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 3)))
def test_run_lengths_are_those_of_pycocotools(instance):
    counts = run_lengths(instance)
    assert sorted(counts) == np.unique(instance).tolist()
    for number, lengths in counts.items():
        mask = np.asfortranarray(instance == number, dtype=np.uint8)
        uncompressed = {"size": list(instance.shape), "counts": lengths}
        assert coco_mask.frPyObjects(uncompressed, *instance.shape) == coco_mask.encode(mask)
        assert 0 not in lengths[1:]


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_an_interrupted_export_is_made_again_with_the_same_bytes(exported, dataset, tmp_path):
    out = tmp_path / "coco"

    def stop(done, total):
        assert total == len(dataset)
        if done == 14:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_coco(dataset.path, out, progress=stop)
    assert not (out / "done").exists()
    assert (out / "annotations/instances_train.json").exists()
    assert not (out / "annotations/instances_test.json").exists()
    assert not list(out.rglob("*.tmp"))
    export_coco(dataset.path, out)
    assert files(out) == files(exported)


def test_a_finished_export_is_left_alone_and_fresh_makes_it_again(dataset, tmp_path):
    out = export_coco(dataset.path, tmp_path / "coco")
    image = out / "train/Alder_0-000003.png"
    image.write_bytes(b"mine")
    export_coco(dataset.path, out)
    assert image.read_bytes() == b"mine"
    export_coco(dataset.path, out, fresh=True)
    assert image.read_bytes().startswith(b"\x89PNG")


def test_an_export_of_another_dataset_is_refused(folder, dataset, tmp_path):
    out = export_coco(dataset.path, tmp_path / "coco")
    message = r"holds a run of another configuration: dataset \('.* or --fresh to start over$"
    with pytest.raises(ConfigError, match=message):
        export_coco(folder, out)


@pytest.mark.parametrize("fresh", [False, True])
def test_the_dataset_is_never_written_over(own_folder, fresh):
    before = files(own_folder.parent)
    for out in (own_folder, own_folder.parent):
        with pytest.raises(ConfigError, match="holds the dataset itself; give a new folder"):
            export_coco(own_folder, out, fresh=fresh)
    assert files(own_folder.parent) == before


def test_what_is_no_dataset_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(DatasetError, match="the folder does not exist"):
        export_coco(tmp_path / "nowhere", tmp_path / "coco")
    assert not list(tmp_path.iterdir())


def test_the_command_exports_and_refuses_in_one_sentence(dataset, tmp_path, capsys):
    out = tmp_path / "coco"
    assert cli.run(["export-coco", str(dataset.path), "--out", str(out)]) == 0
    assert str(out) in capsys.readouterr().out
    assert (out / "done").is_file()
    (tmp_path / "file").write_text("mine")
    for wrong in (tmp_path / "file", tmp_path, dataset.path):
        assert cli.run(["export-coco", str(dataset.path), "--out", str(wrong)]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_panoptic_images_hold_the_segments_of_their_tables(exported, dataset):
    for split in dataset.manifest.splits:
        document = read_panoptic(exported, split)
        names = {image["id"]: image["file_name"] for image in document["images"]}
        for annotation, sample in zip(document["annotations"], dataset.select(split=split), strict=True):
            assert annotation["file_name"] == names[annotation["image_id"]] == f"{sample.key}.png"
            path = exported / f"annotations/panoptic_{split}" / annotation["file_name"]
            ids = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(int) @ (1, 256, 256**2)
            np.testing.assert_array_equal(ids == 0, sample.instance == 0)
            segments = annotation["segments_info"]
            assert [s["id"] for s in segments] == np.unique(ids[ids > 0]).tolist()
            for segment in segments:
                encoded = coco_mask.encode(np.asfortranarray(ids == segment["id"], dtype=np.uint8))
                assert segment["area"] == coco_mask.area(encoded)
                assert segment["bbox"] == coco_mask.toBbox(encoded).tolist()
