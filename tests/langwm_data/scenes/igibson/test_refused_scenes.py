"""What a scene lacks, or cannot mean, is refused in one sentence that names it."""

import re

import pytest

from langwm_data.scenes.igibson.source import IGibson


def spoiled(dataset, match):
    source = IGibson(dataset.root, seed=0)
    with pytest.raises(ValueError, match=match) as caught:
        source.make("Beechwood_0")
    assert str(caught.value).startswith("field 'scenes.igibson': value")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("scenes/Beechwood_0_int/urdf/Beechwood_0_int_best.urdf", "Beechwood_0_int_best.urdf: no such file"),
        (
            "scenes/Beechwood_0_int/urdf/Beechwood_0_int_walls.urdf",
            "Beechwood_0_int_walls.urdf: no such file",
        ),
        ("scenes/Beechwood_0_int/shape/visual/wall_vm.obj", "wall_vm.obj: no such file"),
        (
            "scenes/Beechwood_0_int/misc/walls_material_groups.json",
            "walls_material_groups.json: no such file",
        ),
        ("scenes/Beechwood_0_int/layout/floor_no_obj_0.png", "floor_no_obj_0.png: no such file"),
        ("objects/table/table_a/table_a.urdf", "objects/table/table_a/table_a.urdf: no such file"),
        (
            "objects/table/table_a/misc/material_groups.json",
            "table_a/misc/material_groups.json: no such file",
        ),
        ("objects/table/table_a/shape/visual/link_0_m0_vm.obj", "link_0_m0_vm.obj: no such file"),
        ("objects/table/table_a/shape/collision/base_link_cm.obj", "base_link_cm.obj: no such file"),
    ],
)
def test_a_file_that_is_not_there_is_named(dataset, path, message):
    (dataset.root / path).unlink()
    spoiled(dataset, re.escape(message))


@pytest.mark.parametrize(
    ("tag", "message"),
    [
        ("visual", "the body of link 'base_link' has no visual mesh"),
        ("collision", "the body of link 'base_link' has no collision mesh"),
    ],
)
def test_a_model_without_meshes_is_named(dataset, tag, message):
    place = dataset.root / "objects/table/table_a/table_a.urdf"
    place.write_text(re.sub(f"<{tag}>.*</{tag}>", "", place.read_text()))
    spoiled(dataset, f"table_a.urdf: {message}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('category="walls"', 'category="fence"', "0 links of category 'walls'; allowed: one"),
        ('model="table_a"', 'model="../table_a"', "'../table_a' is no plain name"),
        ('category="table"', 'category="../table"', "'../table' is no plain name"),
        ('model="Beechwood_0_int" name="floors"', 'model="../x" name="floors"', "'../x' is no plain name"),
        (
            '<robot name="igibson_scene">',
            '<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;">',
            "declares a document type",
        ),
        ('category="chair"', 'category="hammock"', "objects/hammock: no such folder"),
        ('model="horn_a"', 'model="horn_b"', "objects/gramophone/horn_b/horn_b.urdf: no such file"),
    ],
)
def test_a_scene_that_cannot_be_meant_is_refused(dataset, old, new, message):
    place = dataset.root / "scenes/Beechwood_0_int/urdf/Beechwood_0_int_best.urdf"
    text = place.read_text()
    assert old in text
    place.write_text(text.replace(old, new))
    spoiled(dataset, message)


def test_an_empty_category_is_named(dataset):
    (dataset.root / "objects/hammock").mkdir()
    place = dataset.root / "scenes/Beechwood_0_int/urdf/Beechwood_0_int_best.urdf"
    place.write_text(place.read_text().replace('category="chair"', 'category="hammock"'))
    spoiled(dataset, "objects/hammock: no model in it, and .* leaves 'chair_0' open")


def test_a_class_that_is_nowhere_is_named(dataset):
    dataset.json(
        "scenes/Beechwood_0_int/misc/walls_material_groups.json", [{"1": ["velvet"]}, {"wall_vm.obj": 1}]
    )
    spoiled(dataset, "wall/1: material class 'velvet' is not in materials/materials.json")


def test_a_mesh_that_leads_out_is_refused(dataset):
    place = dataset.root / "objects/table/table_a/table_a.urdf"
    place.write_text(place.read_text().replace("shape/visual/link_0_m0_vm.obj", "../../../../secret.obj"))
    spoiled(dataset, "names '../../../../secret.obj', which leads out of the dataset")


def test_too_many_objects_are_refused(dataset, monkeypatch):
    monkeypatch.setattr("langwm_data.scenes.igibson.scene.MAX_INSTANCES", 10)
    spoiled(dataset, "8 objects in 2 rooms; at most 10 can be told apart")


def test_a_body_that_is_too_heavy_as_one_mesh_is_refused(dataset, monkeypatch):
    monkeypatch.setattr("langwm_data.scenes.meshes.triangles.MAX_TRIANGLES", 3040)
    place = dataset.root / "objects/table/table_a/shape/visual/link_0_m0_vm.obj"
    place.write_text(place.read_text() + "f 1 2 3\n" * 3000)
    spoiled(dataset, "table_a.urdf: the body of link 'base_link' has 3060 triangles; allowed: 1 to 3040")


def test_structure_that_is_too_heavy_as_one_mesh_is_refused(dataset, monkeypatch):
    monkeypatch.setattr("langwm_data.scenes.meshes.triangles.MAX_TRIANGLES", 90)
    scene = "scenes/Beechwood_0_int"
    dataset.text(f"{scene}/shape/visual/more_vm.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "f 1 2 3\n" * 10)
    place = dataset.root / f"{scene}/urdf/Beechwood_0_int_walls.urdf"
    more = '<visual><geometry><mesh filename="shape/visual/more_vm.obj"/></geometry></visual></link>'
    place.write_text(place.read_text().replace("</link>", more))
    spoiled(dataset, "Beechwood_0_int_walls.urdf: has 94 triangles; allowed: 1 to 90")


def test_structure_without_meshes_is_named(dataset):
    place = dataset.root / "scenes/Beechwood_0_int/urdf/Beechwood_0_int_floors.urdf"
    place.write_text(re.sub("<visual>.*</visual>", "", place.read_text()))
    spoiled(dataset, "Beechwood_0_int_floors.urdf: no visual mesh")
