"""A small dataset in the layout of iGibson 1.0, written from what is public about it: none of its data.

Two of the fifteen floors, each of two rooms with a doorway: living room x -3.9 to 0.9, bedroom 1.1 to 3.9,
both y -2.9 to 2.9, walls 0.2 m thick, 2.4 m high.
"""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from langwm_data.scenes.igibson.source import IGibson
from langwm_data.scenes.splits import HELD_OUT_TEXTURE_IDS

SIDE_PX = 1000
TRAIN_COLOR, HELD_OUT_COLOR = (40, 200, 60), (200, 40, 180)
"""Red, green, blue of the pictures of each split."""
ROOMS = ("bathroom", "bedroom", "kitchen", "living_room")
STAIRWELL = (-3.9, 1.9, -2.9, 2.9)
"""x0, y0, x1, y1 of what the map takes away and no solid does."""

WALLS = {
    "west": ((-4.1, -3.1, 0), (-3.9, 3.1, 2.4)),
    "east": ((3.9, -3.1, 0), (4.1, 3.1, 2.4)),
    "south": ((-3.9, -3.1, 0), (3.9, -2.9, 2.4)),
    "north": ((-3.9, 2.9, 0), (3.9, 3.1, 2.4)),
    "divide_south": ((0.9, -2.9, 0), (1.1, -0.5, 2.4)),
    "divide_north": ((0.9, 0.5, 0), (1.1, 2.9, 2.4)),
    "lintel": ((0.9, -0.5, 2.0), (1.1, 0.5, 2.4)),
}
LIVING, BEDROOM = (-3.9, -2.9, 0.9, 2.9), (1.1, -2.9, 3.9, 2.9)

TABLE_TOP = [((-0.4, -0.35, 0.7), (0.6, 0.25, 0.75))]
TABLE_LEGS = [((x, y, 0.0), (x + 0.05, y + 0.05, 0.7)) for x in (-0.4, 0.55) for y in (-0.35, 0.2)]
CHAIR = [((-0.2, -0.2, 0.0), (0.2, 0.2, 0.45)), ((-0.2, 0.15, 0.45), (0.2, 0.2, 0.9))]
"""A block with a back at +y."""


def obj_text(boxes, library="", groups=True):
    """Boxes as OBJ, each a group; texture coordinates run once over every side, upright on its walls."""
    lines = [f"mtllib {library}", "usemtl default"] if library else []
    for number, (low, high) in enumerate(boxes):
        if groups:
            lines.append(f"o box_{number}")
        x, y, z = zip(low, high, strict=True)
        for corner in np.ndindex(2, 2, 2):
            lines.append(f"v {x[corner[0]]} {y[corner[1]]} {z[corner[2]]}")
        lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
        for side in SIDES:
            lines.append(
                "f " + " ".join(f"{8 * number + v + 1}/{4 * number + t + 1}" for t, v in enumerate(side))
            )
    return "\n".join(lines) + "\n"


SIDES = (
    (0, 4, 5, 1),  # -y: x to the right
    (4, 6, 7, 5),  # +x
    (6, 2, 3, 7),  # +y
    (2, 0, 1, 3),  # -x
    (1, 5, 7, 3),  # +z
    (2, 6, 4, 0),  # -z
)
"""Corners 4x + 2y + z counter-clockwise seen from outside, lower left of the picture first."""


def quad_text(rect, z, library, *, up):
    x0, y0, x1, y1 = rect
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    lines = [f"mtllib {library}", "usemtl default", *(f"v {x} {y} {z}" for x, y in corners)]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    order = (1, 2, 3, 4) if up else (4, 3, 2, 1)
    return "\n".join([*lines, "f " + " ".join(f"{i}/{i}" for i in order)]) + "\n"


def mtl_text(picture):
    return f"newmtl default\nKd 0.8 0.8 0.8\nd 1.0\nmap_Kd {picture}\nmap_bump NORMAL.png\n"


def link_text(name, visuals, collisions, origin=""):
    def shapes(tag, files):
        return "".join(
            f'<{tag}>{origin}<geometry><mesh filename="{file}"/></geometry></{tag}>' for file in files
        )

    return f'<link name="{name}">{shapes("visual", visuals)}{shapes("collision", collisions)}</link>'


def joint_text(name, kind, parent, child, xyz, *, rpy="0 0 0", axis="0 0 1", limits=(0, 0)):
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/><limit lower="{limits[0]}" upper="{limits[1]}"/></joint>'
    )


class Writer:
    """Writes files below one folder."""

    def __init__(self, root):
        self.root = Path(root)

    def text(self, path, text):
        place = self.root / path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)

    def json(self, path, value):
        self.text(path, json.dumps(value))

    def png(self, path, rgb_or_grey):
        place = self.root / path
        place.parent.mkdir(parents=True, exist_ok=True)
        image = rgb_or_grey if rgb_or_grey.ndim == 2 else rgb_or_grey[..., ::-1]
        assert cv2.imwrite(str(place), image)

    def model(self, category, name, *, links, joints="", box, groups, picture=None):
        """An object model. ``links``: name to ({mesh file: boxes}, [collision boxes])."""
        folder = f"objects/{category}/{name}"
        parts = ""
        for link, (visuals, solids) in links.items():
            for file, boxes in visuals.items():
                self.text(f"{folder}/shape/visual/{file}", obj_text(boxes, "default.mtl", groups=False))
            self.text(f"{folder}/shape/collision/{link}_cm.obj", obj_text(solids))
            parts += link_text(
                link, [f"shape/visual/{file}" for file in visuals], [f"shape/collision/{link}_cm.obj"]
            )
        self.text(
            f"{folder}/{name}.urdf", f'<?xml version="1.0"?><robot name="{name}">{parts}{joints}</robot>'
        )
        low, high = (np.array(corner, float) for corner in box)
        metadata = {"bbox_size": (high - low).tolist(), "base_link_offset": ((low + high) / 2).tolist()}
        self.json(f"{folder}/misc/metadata.json", metadata)
        self.json(f"{folder}/misc/material_groups.json", groups)
        self.text(f"{folder}/shape/visual/default.mtl", mtl_text("../../material/DIFFUSE.png"))
        self.png(
            f"{folder}/material/DIFFUSE.png", flat_picture((90, 90, 200)) if picture is None else picture
        )


def flat_picture(color):
    return np.full((16, 16, 3), color, np.uint8)


def upright_picture():
    """Yellow above, dark blue below, a white stripe at the left."""
    picture = flat_picture((230, 210, 20)).copy()
    picture[8:] = (20, 20, 120)
    picture[:, :3] = 255
    return picture


def write_dataset(root):
    """The whole dataset."""
    writer = Writer(root)
    write_materials(writer)
    write_models(writer)
    writer.text("metadata/room_categories.txt", "\n".join(ROOMS) + "\n")
    writer.text("metadata/categories.txt", "walls\nfloors\nceilings\nchair\ntable\n")
    for name in ("Beechwood_0_int", "Rs_int"):
        write_scene(writer, name)


def write_materials(writer):
    writer.png("materials/train.png", flat_picture(TRAIN_COLOR))
    writer.png("materials/held_out.png", flat_picture(HELD_OUT_COLOR))
    writer.png("materials/paper.png", flat_picture((240, 240, 230)))
    table = {
        category: {
            f"{category}{n:02d}": {
                "diffuse": f"{'held_out' if n in held_out else 'train'}.png",
                "metallic": None,
                "roughness": None,
                "normal": None,
            }
            for n in (*held_out, 51, 52, 53)
        }
        for category, held_out in HELD_OUT_TEXTURE_IDS.items()
    }
    table["paper"] = {"Paper_001": {"diffuse": "paper.png"}}
    writer.json("materials/materials.json", table)


def write_models(writer):
    writer.model(
        "table",
        "table_a",
        links={
            "base_link": (
                {"link_0_m0_vm.obj": TABLE_TOP, "link_0_m1_vm.obj": TABLE_LEGS},
                [*TABLE_TOP, *TABLE_LEGS],
            )
        },
        box=((-0.4, -0.35, 0.0), (0.6, 0.25, 0.75)),
        groups=[
            {"0": ["wood", "planks"], "1": ["metal", "mirror"]},
            {"link_0_m0_vm.obj": 0, "link_0_m1_vm.obj": 1},
        ],
    )
    for name in ("chair_a", "chair_b"):
        writer.model(
            "chair",
            name,
            links={"base_link": ({"link_0_m0_vm.obj": CHAIR}, CHAIR)},
            box=((-0.2, -0.2, 0.0), (0.2, 0.2, 0.9)),
            groups=[{"0": []}, {"link_0_m0_vm.obj": 0}],
            picture=upright_picture(),
        )
    body, front = [((-0.4, -0.25, 0.0), (0.4, 0.25, 0.8))], [((0.0, -0.05, 0.05), (0.7, 0.0, 0.75))]
    writer.model(
        "bottom_cabinet",
        "cabinet_a",
        links={
            "base_link": ({"link_0_m0_vm.obj": body}, body),
            "link_1": ({"link_1_m0_vm.obj": front}, front),
        },
        joints=joint_text("hinge", "revolute", "base_link", "link_1", "-0.35 -0.25 0", limits=(0, 1.5)),
        box=((-0.4, -0.3, 0.0), (0.4, 0.25, 0.8)),
        groups=[{"0": ["wood"], "1": ["painting"]}, {"link_0_m0_vm.obj": 0, "link_1_m0_vm.obj": 1}],
    )
    frame = [((-0.5, -0.1, 0.0), (-0.45, 0.1, 2.0)), ((0.45, -0.1, 0.0), (0.5, 0.1, 2.0))]
    leaf = [((0.0, -0.02, 0.01), (0.88, 0.02, 1.98))]
    writer.model(
        "door",
        "door_a",
        links={
            "base_link": ({"link_0_m0_vm.obj": frame}, frame),
            "link_1": ({"link_1_m0_vm.obj": leaf}, leaf),
        },
        joints=joint_text("hinge", "revolute", "base_link", "link_1", "-0.44 0 0", limits=(0, 3.0)),
        box=((-0.5, -0.1, 0.0), (0.5, 0.1, 2.0)),
        groups=[{"0": ["wood"]}, {"link_0_m0_vm.obj": 0, "link_1_m0_vm.obj": 0}],
    )
    mattress, pillow = [((-0.7, -1.0, 0.0), (0.7, 1.0, 0.5))], [((-0.3, -0.2, 0.0), (0.3, 0.2, 0.12))]
    writer.model(
        "bed",
        "bed_a",
        links={
            "base_link": ({"link_0_m0_vm.obj": mattress}, mattress),
            "link_1": ({"link_1_m0_vm.obj": pillow}, pillow),
        },
        joints=joint_text("rests", "floating", "base_link", "link_1", "0.1 0.7 0.5"),
        box=((-0.7, -1.0, 0.0), (0.7, 1.0, 0.62)),
        groups=[{"0": ["fabric"], "1": ["leather"]}, {"link_0_m0_vm.obj": 0, "link_1_m0_vm.obj": 1}],
    )
    horn = [((-0.15, -0.15, 0.0), (0.15, 0.15, 1.2))]
    writer.model(
        "gramophone",
        "horn_a",
        links={"base_link": ({"link_0_m0_vm.obj": horn}, horn)},
        box=((-0.15, -0.15, 0.0), (0.15, 0.15, 1.2)),
        groups=[{"0": ["metal"]}, {"link_0_m0_vm.obj": 0}],
    )


OBJECTS = {
    # name: (attributes, centre of the bounding box, yaw)
    "table_0": (
        'category="table" model="table_a" room="living_room_0" bounding_box="1.5 0.6 0.8"',
        (-1.5, -1.0, 0.4),
        0.5,
    ),
    "chair_0": (
        'category="chair" model="random" random_group="4" room="living_room_0" bounding_box="0.4 0.5 1.0"',
        (-2.5, 1.0, 0.5),
        2.0,
    ),
    "chair_1": (
        'category="chair" model="random" random_group="4" room="living_room_0" bounding_box="0.4 0.5 1.0"',
        (0.0, 1.5, 0.5),
        -1.2,
    ),
    "bottom_cabinet_0": (
        'category="bottom_cabinet" model="cabinet_a" room="bedroom_0" bounding_box="0.8 0.55 0.8"',
        (3.5, -2.0, 0.4),
        -np.pi / 2,
    ),
    "door_0": (
        'category="door" model="door_a" room="living_room_0,bedroom_0" bounding_box="1.0 0.2 2.0"',
        (1.0, 0.0, 1.0),
        np.pi / 2,
    ),
    "bed_0": (
        'category="bed" model="bed_a" room="bedroom_0" bounding_box="1.4 2.0 0.62"',
        (3.0, 1.6, 0.31),
        0.0,
    ),
    "gramophone_0": (
        'category="gramophone" model="horn_a" room="bedroom_0" scale="1 1 1"',
        (1.5, -2.4, 0.6),
        0.0,
    ),
}


def scene_text(name, objects=None):
    links, joints = '<link name="world"/>', ""
    for category in ("walls", "floors", "ceilings"):
        links += f'<link category="{category}" model="{name}" name="{category}"/>'
        joints += joint_text(f"fix_to_world_{category}", "fixed", "world", category, "0 0 0")
    for label, (attributes, (x, y, z), yaw) in (OBJECTS if objects is None else objects).items():
        links += f'<link name="{label}" {attributes}/>'
        kind = "floating" if label.startswith("chair") else "fixed"
        joints += joint_text(f"j_{label}", kind, "world", label, f"{x} {y} {z}", rpy=f"0 0 {yaw}")
    return f'<?xml version="1.0" ?><robot name="igibson_scene">{links}{joints}</robot>'


def write_scene(writer, name):
    folder = f"scenes/{name}"
    writer.text(f"{folder}/urdf/{name}_best.urdf", scene_text(name))
    shapes = {
        "walls": (["wall_vm.obj"], ["wall_cm.obj"]),
        "floors": (["floor_0_vm.obj", "floor_1_vm.obj"], ["floor_cm.obj"]),
        "ceilings": (["ceiling_vm.obj", "ceiling_1_vm.obj"], ["ceiling_cm.obj"]),
    }
    for kind, (visuals, solids) in shapes.items():
        link = link_text(
            "base_link",
            [f"shape/visual/{file}" for file in visuals],
            [f"shape/collision/{file}" for file in solids],
            origin='<origin xyz="0. 0. 0."/>',
        )
        writer.text(f"{folder}/urdf/{name}_{kind}.urdf", f'<robot name="{kind}">{link}</robot>')
    visual, collision = f"{folder}/shape/visual", f"{folder}/shape/collision"
    writer.text(f"{visual}/wall_vm.obj", obj_text(WALLS.values(), "wall.mtl", groups=False))
    writer.text(f"{collision}/wall_cm.obj", obj_text(WALLS.values()))
    for number, rect in enumerate(((*LIVING[:2], 1.0, LIVING[3]), (1.0, *BEDROOM[1:]))):
        writer.text(f"{visual}/floor_{number}_vm.obj", quad_text(rect, 0.0, f"floor_{number}.mtl", up=True))
        ceiling = "ceiling_vm.obj" if number == 0 else "ceiling_1_vm.obj"
        writer.text(f"{visual}/{ceiling}", quad_text(rect, 2.4, "ceiling.mtl", up=False))
    writer.text(f"{collision}/floor_cm.obj", obj_text([((-4.1, -3.1, -0.2), (4.1, 3.1, 0.0))]))
    writer.text(f"{collision}/ceiling_cm.obj", obj_text([((-4.1, -3.1, 2.4), (4.1, 3.1, 2.6))]))
    for number, (part, color) in enumerate(
        {
            "wall": (200, 190, 170),
            "ceiling": (230, 230, 230),
            "floor_0": (120, 80, 40),
            "floor_1": (20, 60, 160),
        }.items()
    ):
        del number
        writer.text(f"{visual}/{part}.mtl", mtl_text(f"../../material/{part}/COMBINED.png"))
        writer.png(f"{folder}/material/{part}/COMBINED.png", flat_picture(color))
    misc = f"{folder}/misc"
    writer.json(f"{misc}/walls_material_groups.json", [{"1": ["bricks", "plaster"]}, {"wall_vm.obj": 1}])
    writer.json(
        f"{misc}/floors_material_groups.json",
        [{"1": ["wood_floor"], "2": []}, {"floor_0_vm.obj": 1, "floor_1_vm.obj": 2}],
    )
    writer.json(
        f"{misc}/ceilings_material_groups.json",
        [{"1": ["paint"]}, {"ceiling_vm.obj": 1, "ceiling_1_vm.obj": 1}],
    )
    write_maps(writer, f"{folder}/layout")


def pixels(rect):
    x0, y0, x1, y1 = (round(100 * value) + SIDE_PX // 2 for value in rect)
    return slice(y0, y1), slice(x0, x1)


def write_maps(writer, layout):
    free, obstacles = np.zeros((SIDE_PX, SIDE_PX), np.uint8), np.full((SIDE_PX, SIDE_PX), 255, np.uint8)
    instances, kinds = np.zeros_like(free), np.zeros_like(free)
    for rect, instance, kind in ((LIVING, 3, "living_room"), (BEDROOM, 7, "bedroom")):
        free[pixels(rect)] = 255
        instances[pixels(rect)] = instance
        kinds[pixels(rect)] = ROOMS.index(kind) + 1
    free[pixels((0.9, -0.5, 1.1, 0.5))] = 255
    free[pixels(STAIRWELL)] = 0
    for low, high in WALLS.values():
        if low[2] == 0:
            obstacles[pixels((*low[:2], *high[:2]))] = 0
    for name, image in {
        "floor_trav_no_obj_0": free,
        "floor_no_obj_0": obstacles,
        "floor_insseg_0": instances,
        "floor_semseg_0": kinds,
    }.items():
        writer.png(f"{layout}/{name}.png", image)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def shared_dataset(tmp_path_factory):
    """A whole dataset; do not write into it."""
    root = tmp_path_factory.mktemp("ig_dataset")
    write_dataset(root)
    return root


@pytest.fixture
def dataset(shared_dataset, tmp_path):
    """A whole dataset to spoil, as a writer."""
    shutil.copytree(shared_dataset, tmp_path / "ig_dataset")
    return Writer(tmp_path / "ig_dataset")


@pytest.fixture(scope="session")
def source(shared_dataset):
    return IGibson(shared_dataset, seed=0)


@pytest.fixture(scope="session")
def scene(source):
    """Beechwood_0, for training."""
    return source.make("Beechwood_0")
