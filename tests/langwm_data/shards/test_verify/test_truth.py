"""What a document, a caption or a mask says falsely is named, though every file is well formed."""

import cv2
import numpy as np
import pytest

from langwm_data.labels.captions import TEMPLATES
from langwm_data.png import encode_png


def captioned(document):
    return next(o for o in document["objects"] if o["captions"])


def in_object(**values):
    return lambda d: captioned(d).update(values)


def in_caption(**values):
    return lambda d: captioned(d)["captions"][0].update(values)


def shift_box(document):
    box = captioned(document)["bbox_xyxy"]
    box[0] += 1.0
    box[2] += 1.0


def lie(**words):
    """Fill the caption's own template with other words, in text and slots alike."""

    def change(document):
        obj = captioned(document)
        caption = obj["captions"][0]
        slots = {name: caption[name] for name in ("direction", "distance")}
        slots["object"] = obj["category"].replace("_", " ")
        slots |= words
        text = TEMPLATES[caption["template"] - 1].format(**slots)
        caption.update(text=text, direction=slots["direction"], distance=slots["distance"])

    return change


def turn_around(document):
    said = captioned(document)["captions"][0]["direction"]
    lie(direction="right" if "left" in said else "left")(document)


def other_template(document):
    caption = captioned(document)["captions"][0]
    caption["template"] = caption["template"] % 7 + 1


def first_texture(name):
    return lambda d: d["palette"].__setitem__(0, name)


def caption_the_wall(document):
    caption = captioned(document)["captions"][0]
    next(o for o in document["objects"] if o["category"] == "wall")["captions"].append(caption)


LIES = {
    "a moved box": (shift_box, r"object \d+: bbox_xyxy is .*; the mask says"),
    "a moved centre": (in_object(center_px=[1.0, 2.0]), "center_px is"),
    "another area": (in_object(area_px=7), "area_px is 7; the mask says"),
    "another distance": (in_object(distance_m=3.21), "distance_m is 3.21; mask and depth say"),
    "another category": (in_object(category="unicorn"), "category is 'unicorn'; the mask says"),
    "another model": (in_object(model="chair_99"), "model is 'chair_99'; the mask says"),
    "another direction": (in_object(direction_rule2="behind"), "direction_rule2 is 'behind'; the mask says"),
    "an object that is not there": (
        lambda d: d["objects"].append({**d["objects"][-1], "instance": 900}),
        r"objects \[900\] are listed but not in the mask, or in the mask but not listed",
    ),
    "an object not listed": (lambda d: d["objects"].pop(), "or in the mask but not listed"),
    "an object twice": (lambda d: d["objects"].append(d["objects"][-1]), "listed twice or not in the order"),
    "objects in another order": (lambda d: d["objects"].reverse(), "listed twice or not in the order"),
    "a caption to the other side": (turn_around, r"caption says \w+; by rule \d it is"),
    "a caption of another distance": (lie(distance="9 meters"), "caption says 9 meters; by its depth it is"),
    "a caption in decimals": (lie(distance="2.2 meters"), "caption says 2.2 meters; by its depth it is"),
    "a caption of another thing": (lie(object="toy car"), "caption says 'toy car'; the mask shows"),
    "a caption of no thing": (lie(object="unicorn"), "caption says 'unicorn'; the mask shows"),
    "a caption in free words": (in_caption(text="Behind you."), "follows none of the 7 templates"),
    "another template": (other_template, "is not of the template, rule and slots beside it"),
    "a rule that does not exist": (in_caption(rule=3), "is not of the template, rule and slots beside it"),
    "slots that the text does not say": (
        in_caption(distance="8 meters"),
        "is not of the template, rule and slots",
    ),
    "no caption": (in_object(captions=[]), "it has 0 captions; by its size and category 1"),
    "a caption of a wall": (caption_the_wall, "it has 1 captions; by its size and category 0"),
    "another split": (lambda d: d.update(split="test"), "split is 'test' in a shard of train"),
    "another building": (lambda d: d.update(building="Rowan"), "building and floor are 'Rowan, "),
    "another floor": (lambda d: d.update(floor=7), "building and floor are"),
    "a scene that does not exist": (
        lambda d: d.update(scene="Oak_0"),
        "scene 'Oak_0' is no scene of the train split",
    ),
    "a path for a scene": (
        lambda d: d.update(scene="../x"),
        r"scene '\.\./x' is no scene of the train split",
    ),
    "too few materials": (
        lambda d: d["palette"].pop(),
        r"palette has \d+ materials; the scene has \d+ slots",
    ),
    "a held-out texture": (first_texture("marble/02"), "texture marble/02 is for test only"),
    "an unknown texture": (first_texture("gold/01"), "texture 'gold/01' is in no table"),
    "a texture that is no number": (first_texture("wood/x"), "is not of the form wood/05"),
    "a texture spelled otherwise": (first_texture("wood/1"), "texture 'wood/1' is in no table"),
    "a texture for another slot": (first_texture("moss/05"), "holds 'moss/05'; allowed categories"),
    "another focal length": (
        lambda d: d["camera"]["K"][0].__setitem__(0, 99.0),
        "camera size or K is not that of",
    ),
    "another image size": (
        lambda d: d["camera"].update(width=61),
        "camera size or K is not that of the dataset",
    ),
    "a pose that is not the camera's": (
        lambda d: d["pose"].__setitem__(0, 9.0),
        "pose is not the place and yaw",
    ),
    "more visible than there is": (in_object(visible_fraction=1.5), r"fractions 1\.5, .* do not fit"),
    "less than nothing occluded": (in_object(occluded_fraction=-0.5), "do not fit"),
    "a turned camera": (lambda d: d["camera"].update(yaw_rad=0.123), "camera_to_world is not the pose of"),
    "a mirrored camera": (
        lambda d: [row.__setitem__(0, -row[0]) for row in d["camera"]["camera_to_world"][:3]],
        "camera_to_world is not the pose of",
    ),
}


@pytest.mark.parametrize("case", LIES, ids=str)
def test_a_lie_in_a_document_is_named(vandal, case):
    change, message = LIES[case]
    vandal.edit_json(change)
    vandal.assert_found(message)


def with_pixels(value, where):
    def change(data):
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        image[where] = value
        return encode_png(image)

    return change


def test_an_id_outside_the_table_is_named(vandal):
    vandal.edit("instance.png", with_pixels(60000, (5, 5)))
    vandal.assert_found("instance.png shows id 60000, which scene .* does not have")


def test_a_pixel_that_changes_hands_is_named(vandal):
    vandal.edit("instance.png", with_pixels(0, (0, 0)))
    vandal.assert_found(r"object \d+: area_px is")


def test_depth_that_the_labels_do_not_know_of_is_named(vandal):
    vandal.edit("depth.png", with_pixels(100, (slice(None), slice(None))))
    vandal.assert_found(r"object \d+: distance_m is .*; mask and depth say 0\.1")


def test_the_caption_of_another_object_is_named(vandal):
    vandal.edit("txt", lambda _: b"In the front, bed is 2 meters to me.")
    vandal.assert_found("is not the caption of the largest captioned object")
