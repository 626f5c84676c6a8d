import dataclasses

import pytest

from langwm_data.shards.sample import DatasetError
from langwm_data.shards.scenes import read_scene, scene_path, write_scene


def test_a_scene_is_read_as_it_was_written(small_scene, tmp_path):
    write_scene(tmp_path, small_scene)
    assert read_scene(tmp_path, small_scene.name) == small_scene
    assert scene_path(tmp_path, small_scene.name).read_text() == small_scene.to_json()


def test_missing_damaged_and_misplaced_scenes_are_told_apart(small_scene, tmp_path):
    name = small_scene.name
    with pytest.raises(DatasetError, match=rf"scene .*{name}\.json is missing"):
        read_scene(tmp_path, name)
    write_scene(tmp_path, dataclasses.replace(small_scene, name="Elm_0"))
    scene_path(tmp_path, "Elm_0").rename(scene_path(tmp_path, name))
    with pytest.raises(DatasetError, match=rf"holds scene 'Elm_0'; it should hold '{name}'"):
        read_scene(tmp_path, name)
    scene_path(tmp_path, name).write_text('{"name": 3}')
    with pytest.raises(DatasetError, match=rf"{name}\.json: not a scene"):
        read_scene(tmp_path, name)
