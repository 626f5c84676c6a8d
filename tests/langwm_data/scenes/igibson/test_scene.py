"""A scene stands where its files put it, worked out here a second time from the numbers in them."""

import dataclasses

import numpy as np
import pytest

from langwm_data.config import RobotConfig
from langwm_data.scenes.geometry import quat_matrix
from langwm_data.scenes.igibson.source import IGibson
from langwm_data.scenes.navigation import FreeSpace
from langwm_data.scenes.spec import OWN, SceneSpec
from langwm_data.scenes.splits import HELD_OUT_TEXTURE_IDS, check_palette, sample_palette

TABLE, CHAIR, OTHER_CHAIR, CABINET, DOOR, BED, PILLOW, HORN = range(8)


def world_vertices(source, obj):
    vertices = source.assets.mesh(obj.mesh.name).vertices.astype(float)
    return vertices @ quat_matrix(obj.orientation).T + obj.position


def in_box_frame(points, center, yaw):
    """Points in the frame of a bounding box."""
    c, s = np.cos(yaw), np.sin(yaw)
    return (points - center) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T


@pytest.mark.parametrize(
    ("number", "center", "size", "yaw"),
    [
        (TABLE, (-1.5, -1.0, 0.4), (1.5, 0.6, 0.8), 0.5),
        (CHAIR, (-2.5, 1.0, 0.5), (0.4, 0.5, 1.0), 2.0),
        (OTHER_CHAIR, (0.0, 1.5, 0.5), (0.4, 0.5, 1.0), -1.2),
        (CABINET, (3.5, -2.0, 0.4), (0.8, 0.55, 0.8), -np.pi / 2),
        (HORN, (1.5, -2.4, 0.6), (0.3, 0.3, 1.2), 0.0),
    ],
)
def test_an_object_fills_its_bounding_box_where_its_joint_says(source, scene, number, center, size, yaw):
    points = in_box_frame(world_vertices(source, scene.objects[number]), center, yaw)
    np.testing.assert_allclose(points.min(axis=0), np.divide(size, -2), atol=1e-5)
    np.testing.assert_allclose(points.max(axis=0), np.divide(size, 2), atol=1e-5)
    np.testing.assert_allclose(scene.objects[number].size, size, atol=1e-5)


def test_a_yaw_turns_counter_clockwise_seen_from_above(source, scene):
    vertices = world_vertices(source, scene.objects[CHAIR])
    back = vertices[vertices[:, 2] > 0.95].mean(axis=0)
    # The back is at +y of the model, 0.175 of 0.4 m from its middle; the box is 0.5 m deep.
    reach = 0.175 / 0.4 * 0.5
    expected = (-2.5 - reach * np.sin(2.0), 1.0 + reach * np.cos(2.0))
    np.testing.assert_allclose(back[:2], expected, atol=1e-5)


def test_two_links_of_a_body_are_one_object_in_two_materials(source, scene):
    cabinet = scene.objects[CABINET]
    assert (cabinet.category, cabinet.phrase, cabinet.model) == (
        "cabinet",
        "bottom cabinet",
        "bottom_cabinet/cabinet_a",
    )
    assert source.assets.mesh(cabinet.mesh.name).sizes == (12, 12)
    assert [scene.slots[i].categories for i in cabinet.mesh.slots] == [("wood",), ("paper",)]
    assert len(cabinet.parts) == 2


def test_a_floating_joint_gives_two_objects_at_rest(source, scene):
    bed, pillow = scene.objects[BED], scene.objects[PILLOW]
    assert (bed.model, pillow.model) == ("bed/bed_a", "bed/bed_a/link_1")
    assert bed.instance != pillow.instance
    np.testing.assert_allclose(pillow.position, (3.1, 2.3, 0.5), atol=1e-6)
    both = np.concatenate([world_vertices(source, o) for o in (bed, pillow)])
    np.testing.assert_allclose(both.min(axis=0), (2.3, 0.6, 0.0), atol=1e-5)
    np.testing.assert_allclose(both.max(axis=0), (3.7, 2.6, 0.62), atol=1e-5)
    assert all(o.is_fixed for o in scene.objects)


def test_solids_lie_where_the_meshes_do(source, scene):
    for obj in scene.objects:
        rotation = quat_matrix(obj.orientation)
        points = np.concatenate(
            [
                np.add(p.points, p.position)
                if p.shape == "hull"
                else np.multiply(np.array(list(np.ndindex(2, 2, 2))) - 0.5, p.size) + p.position
                for p in obj.parts
            ]
        )
        solid, seen = points @ rotation.T + obj.position, world_vertices(source, obj)
        np.testing.assert_allclose(solid.min(axis=0), seen.min(axis=0), atol=2e-4)
        np.testing.assert_allclose(solid.max(axis=0), seen.max(axis=0), atol=2e-4)


def test_a_model_left_open_is_drawn_once_for_its_group_and_again_for_another_seed(
    source, shared_dataset, scene
):
    assert scene.objects[CHAIR].model == scene.objects[OTHER_CHAIR].model
    drawn = {IGibson(shared_dataset, seed).make("Beechwood_0").objects[CHAIR].model for seed in range(6)}
    assert drawn == {"chair/chair_a", "chair/chair_b"}


def test_the_same_copy_and_seed_give_the_same_scene(source, shared_dataset, scene):
    again = IGibson(shared_dataset, 0).make("Beechwood_0")
    assert again == scene
    assert SceneSpec.from_json(scene.to_json()) == scene


def test_what_no_table_knows_is_called_by_its_name(scene, source, caplog):
    horn = scene.objects[HORN]
    assert (horn.category, horn.phrase) == ("other_object", "gramophone")
    source.make("Rs_0")
    assert "Rs_0: categories gramophone are in no table" in caplog.text


def test_rooms_surfaces_and_names_are_those_of_the_files(scene):
    assert (scene.name, scene.building, scene.floor, scene.split) == ("Beechwood_0", "Beechwood", 0, "train")
    assert {r.name: r.rect for r in scene.rooms} == {
        "living_room_0": (-3.9, -2.9, 0.9, 2.9),
        "bedroom_0": (1.1, -2.9, 3.9, 2.9),
    }
    assert scene.height_m == 2.4
    seen = [s for s in scene.surfaces if s.mesh is not None]
    assert {(s.kind, s.room) for s in seen} == {
        (kind, room) for kind in ("wall", "floor", "ceiling") for room in ("living_room_0", "bedroom_0")
    }
    assert not any(s.is_seen for s in scene.surfaces if s.part is not None)
    assert len({s.instance for s in seen}) == 6
    assert not {s.instance for s in seen} & {o.instance for o in scene.objects}
    assert scene.objects[DOOR].room == "living_room_0"
    assert {(m.model, m.licence) for m in scene.models} >= {("table/table_a", "iGibson dataset licence")}


def test_walls_belong_to_the_room_that_they_face(source, scene):
    for surface in scene.surfaces:
        if surface.mesh is None or surface.kind != "wall":
            continue
        mesh = source.assets.mesh(surface.mesh.name)
        faces_east = mesh.normals[:, 0] > 0.5
        at_divide = np.abs(mesh.vertices[:, 0] - 1.0) < 0.11
        x = mesh.vertices[faces_east & at_divide, 0]
        # The side of the dividing wall that faces east is the bedroom's.
        assert (len(x) > 0) == (surface.room == "bedroom_0")


def test_groups_without_classes_keep_their_own_texture(source, scene):
    floors = {s.room: s.mesh for s in scene.surfaces if s.kind == "floor" and s.mesh is not None}
    assert floors["bedroom_0"].slots == (OWN,)
    assert source.assets.mesh(floors["bedroom_0"].name).materials[0].texture is not None
    assert scene.slots[floors["living_room_0"].slots[0]].categories == ("wood_floor",)
    assert scene.objects[CHAIR].mesh.slots == (OWN,)


@pytest.mark.parametrize(("name", "split"), [("Beechwood_0", "train"), ("Rs_0", "test")])
def test_a_split_wears_its_own_textures_only(source, name, split):
    scene = source.make(name)
    check_palette(scene)
    rng = np.random.default_rng(0)
    for _ in range(50):
        palette = sample_palette(rng, scene.slots, split, scene.pictures)
        check_palette(dataclasses.replace(scene, palette=palette))
        for material in palette:
            held_out = HELD_OUT_TEXTURE_IDS.get(material.category)
            assert held_out is None or (material.id in held_out) == (split == "test")
            source.assets.read(f"{material.picture}.png")


def test_a_door_stands_open_in_its_scene(source, scene):
    leaf = world_vertices(source, scene.objects[DOOR])
    low, high = leaf.min(axis=0), leaf.max(axis=0)
    # Closed, it would lie within the thickness of the wall, x 0.9 to 1.1.
    assert low[0] < 0.5 or high[0] > 1.5


def test_the_robot_gets_from_room_to_room_and_nowhere_that_the_map_forbids(scene):
    robot = RobotConfig()
    free = FreeSpace.from_scene(scene, robot=robot)
    assert free.is_free((-3.0, 0.0))
    assert free.is_free((2.0, 0.0))
    assert np.isfinite(free.distance_field((2.0, 0.0)).distance((-3.0, 0.0)))
    without = FreeSpace.from_scene(dataclasses.replace(scene, floor_map=None), robot=robot)
    assert without.is_free((-3.0, 2.3))
    assert not free.is_free((-3.0, 2.3))


def test_free_space_is_what_map_and_solids_leave(scene):
    """In an empty house: inside of the walls by the robot's radius, and outside of the stairwell."""
    empty = dataclasses.replace(scene, objects=())
    robot = RobotConfig()
    free = FreeSpace.from_scene(empty, robot=robot)
    x, y = np.moveaxis(free.center(np.stack(np.indices(free.grid.shape), axis=-1)), -1, 0)
    r = robot.radius_m
    living = (x > -3.9 + r) & (x < 0.9 - r) & (np.abs(y) < 2.9 - r)
    bedroom = (x > 1.1 + r) & (x < 3.9 - r) & (np.abs(y) < 2.9 - r)
    doorway = (np.abs(x - 1.0) <= 0.1 + r) & (np.abs(y) < 0.5 - r)
    # The map is eroded by a cell of 0.1 m on the side from which x and y come.
    stairs = (x < -2.9 + 0.1) & (y > 1.9)
    expected = (living | bedroom | doorway) & ~stairs
    wrong = free.grid != expected
    # Walls end in edges and rounded corners at the doorway: half a cell to either side.
    assert wrong.sum() <= 0.01 * expected.sum()
    assert not (free.grid & stairs).any()


def test_meshes_that_were_made_before_are_found_and_made_again_when_they_are_gone(dataset, monkeypatch):
    source = IGibson(dataset.root, seed=0)
    first = source.make("Beechwood_0")
    with monkeypatch.context() as patch:
        patch.setattr("langwm_data.scenes.igibson.objects._make_mesh", lambda *_: pytest.fail("made again"))
        assert IGibson(dataset.root, seed=0).make("Beechwood_0") == first
    name = first.objects[TABLE].mesh.name
    (source.assets.folders[0] / f"{name}.npz").unlink()
    assert IGibson(dataset.root, seed=0).make("Beechwood_0") == first
    source.assets.read(f"{name}.npz")
