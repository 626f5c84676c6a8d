import json
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pycocotools import mask as coco_mask

from langwm_data.config import LabelsConfig
from langwm_data.labels.instances import is_eligible, label_frame
from langwm_data.scenes.spec import InstanceName

TABLE = {
    5: InstanceName("door_frame", "door_frame_01", "door frame"),
    1: InstanceName("wall", "study_wall", "wall"),
    2: InstanceName("chair", "chair_01", "chair"),
    3: InstanceName("sofa", "sofa_02", "sofa"),
    4: InstanceName("cup", "cup_01", "cup"),
}
CONFIG = LabelsConfig()


def label(instance, depth=None, config=CONFIG, seed=0):
    depth = np.full(instance.shape, 2.0, np.float32) if depth is None else depth
    return label_frame(instance, depth, TABLE, config, np.random.default_rng(seed))


def image_with(instance, rows, columns, height=100, width=100):
    image = np.zeros((height, width), np.uint16)
    image[rows, columns] = instance
    return image


@settings(max_examples=60)
@given(hnp.arrays(np.uint16, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=st.integers(0, 4)))
def test_boxes_and_areas_agree_with_pycocotools(instance):
    labels = label(instance)
    assert [o.instance for o in labels] == sorted(set(instance.ravel().tolist()) - {0})
    for found in labels:
        encoded = coco_mask.encode(np.asfortranarray(instance == found.instance, dtype=np.uint8))
        x, y, width, height = coco_mask.toBbox(encoded).tolist()
        assert found.bbox_xyxy == (x, y, x + width, y + height)
        assert found.area_px == coco_mask.area(encoded)


def test_centre_is_the_centroid_of_pixel_centres():
    (found,) = label(image_with(2, slice(10, 20), slice(30, 33)))
    assert found.center_px == (31.5, 15.0)
    assert found.bbox_xyxy == (30.0, 10.0, 33.0, 20.0)


def test_distance_is_the_mean_of_clipped_valid_depth():
    instance = image_with(2, slice(0, 20), slice(0, 20))
    depth = np.full(instance.shape, 4.0, np.float32)
    depth[0:10, 0:20] = 30.0
    depth[15:20, 0:20] = 0.0
    (found,) = label(instance, depth)
    assert found.distance_m == pytest.approx((200 * 10.0 + 100 * 4.0) / 300)


def test_no_valid_depth_means_no_caption_and_no_nan():
    instance = image_with(2, slice(0, 20), slice(0, 20))
    (found,) = label(instance, np.zeros(instance.shape, np.float32))
    assert found.distance_m == 0.0
    assert found.captions == ()


@pytest.mark.parametrize(("rows", "is_named"), [(4, False), (5, True)])
def test_small_objects_get_no_caption(rows, is_named):
    (found,) = label(image_with(2, slice(0, rows), slice(0, 10)))
    assert is_eligible(found, 100 * 100, CONFIG) == is_named
    assert len(found.captions) == is_named


def test_walls_get_labels_but_no_captions():
    instance = image_with(1, slice(0, 50), slice(0, 100))
    instance[60:90, 70:90] = 3
    wall, sofa = label(instance)
    assert (wall.category, wall.captions) == ("wall", ())
    assert (sofa.category, sofa.model) == ("sofa", "sofa_02")
    (caption,) = sofa.captions
    assert caption.direction == {1: sofa.direction_rule1, 2: sofa.direction_rule2}[caption.rule]
    assert sofa.direction_rule1 == "right"
    assert caption.distance == "2 meters"


def test_door_frames_are_labelled_as_part_of_the_building():
    (found,) = label(image_with(5, slice(0, 50), slice(0, 50)))
    assert (found.category, found.captions) == ("door_frame", ())


def test_same_seed_same_labels_and_they_are_plain_json():
    instance = image_with(2, slice(0, 30), slice(0, 40))
    first, second = label(instance, seed=3), label(instance, seed=3)
    assert first == second
    values = asdict(first[0])
    assert json.loads(json.dumps(values, allow_nan=False))["bbox_xyxy"] == [0.0, 0.0, 40.0, 30.0]
    assert {type(v) for v in (*values["bbox_xyxy"], *values["center_px"], values["distance_m"])} == {float}
    assert type(values["area_px"]) is type(values["instance"]) is int
