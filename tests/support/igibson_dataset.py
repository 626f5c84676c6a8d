"""A small dataset in the layout of iGibson 1.0, written from what is public about it: none of its data.

Two of the fifteen floors, each of two rooms with a doorway: living room x -3.9 to 0.9, bedroom 1.1 to 3.9,
both y -2.9 to 2.9, walls 0.2 m thick, 2.4 m high.
"""

import numpy as np
from igibson_files import Writer, flat_picture, joint_text, link_text, mtl_text, obj_text, quad_text
from igibson_models import write_models

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
    colors = {
        "wall": (200, 190, 170),
        "ceiling": (230, 230, 230),
        "floor_0": (120, 80, 40),
        "floor_1": (20, 60, 160),
    }
    for part, color in colors.items():
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
