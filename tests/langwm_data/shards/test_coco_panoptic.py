"""Panoptic images and tables, read back by the rules of COCO's format page."""

import numpy as np

from langwm_data.labels.semantic import CATEGORY_IDS
from langwm_data.shards.coco_panoptic import panoptic_image, segments_info


def described(instance, categories):
    """What a sample's JSON says of these objects, as far as segments need it."""
    objects = []
    for number, category in categories.items():
        rows, columns = np.nonzero(instance == number)
        box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        objects.append(
            {
                "instance": number,
                "category": category,
                "area_px": len(rows),
                "bbox_xyxy": [float(x) for x in box],
            }
        )
    return objects


CATEGORIES = {
    1: "wall",
    2: "wall",
    3: "floor",
    4: "ceiling",
    5: "door_frame",
    300: "chair",
    301: "chair",
    65535: "sofa",
}


def make_instance():
    instance = np.random.default_rng(0).choice([0, *CATEGORIES], (24, 32)).astype(np.uint16)
    instance[:, :3] = 0
    return instance


def read_ids(image):
    return image.astype(int) @ (1, 256, 256**2)


def test_the_segments_of_image_and_table_are_the_same():
    instance = make_instance()
    objects = described(instance, CATEGORIES)
    ids = read_ids(panoptic_image(instance, objects))
    segments = segments_info(objects, CATEGORY_IDS)
    assert {s["id"] for s in segments} == set(ids.ravel().tolist()) - {0}
    assert len({s["id"] for s in segments}) == len(segments)
    for segment in segments:
        rows, columns = np.nonzero(ids == segment["id"])
        width, height = columns.max() + 1 - columns.min(), rows.max() + 1 - rows.min()
        assert segment["area"] == len(rows)
        assert segment["bbox"] == [columns.min(), rows.min(), width, height]
        assert segment["iscrowd"] == 0


def test_stuff_is_one_segment_per_category_and_things_keep_apart():
    instance = make_instance()
    objects = described(instance, CATEGORIES)
    ids = read_ids(panoptic_image(instance, objects))
    np.testing.assert_array_equal(ids == 0, instance == 0)
    np.testing.assert_array_equal(ids == 1, (instance == 1) | (instance == 2))
    for number in (3, 4, 5, 300, 301, 65535):
        np.testing.assert_array_equal(ids == number, instance == number)
    categories = [s["category_id"] for s in segments_info(objects, CATEGORY_IDS)]
    assert categories.count(CATEGORY_IDS["chair"]) == 2
    assert categories.count(CATEGORY_IDS["wall"]) == 1


def test_an_image_of_nothing_is_black():
    nothing = np.zeros((4, 5), np.uint16)
    assert panoptic_image(nothing, []).tolist() == np.zeros((4, 5, 3)).tolist()
    assert segments_info([], CATEGORY_IDS) == []
