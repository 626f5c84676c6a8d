"""Object models in the layout of iGibson 1.0, made of boxes."""

from igibson_files import joint_text, upright_picture

TABLE_TOP = [((-0.4, -0.35, 0.7), (0.6, 0.25, 0.75))]
TABLE_LEGS = [((x, y, 0.0), (x + 0.05, y + 0.05, 0.7)) for x in (-0.4, 0.55) for y in (-0.35, 0.2)]
CHAIR = [((-0.2, -0.2, 0.0), (0.2, 0.2, 0.45)), ((-0.2, 0.15, 0.45), (0.2, 0.2, 0.9))]
"""A block with a back at +y."""


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
