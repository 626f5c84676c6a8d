"""Files in the form of iGibson 1.0's: OBJ, MTL, URDF, JSON and PNG, written from what is public about it."""

import json
from pathlib import Path

import cv2
import numpy as np


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
