import io
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

DEBIAN = Path("/usr/share/sweethome3d")
"""Where Debian's package sweethome3d-furniture lies."""

# A step, seen from its front (+z in the file): 2 wide, 1 high at the back, 3 deep, its front half lower.
STEP_OBJ = """
mtllib step.mtl
v 10 0 0
v 12 0 0
v 12 0 3
v 10 0 3
v 10 1 0
v 12 1 0
v 12 1 1
v 10 1 1
v 12 0.5 3
v 10 0.5 3
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl top
f 5/4 8/1 7/2 6/3
usemtl rest
f 8 10 9 7
f 4 3 9 10
f 2 1 5 6
f 1 4 10 8 5
f 3 2 6 7 9
f 1 2 3 4
"""
STEP_MTL = "newmtl top\nKd 1 1 1\nmap_Kd C:\\textures\\Stripes.PNG\nnewmtl rest\nKd 0.25 0.5 0.75\nd 0.5\n"


def png(pixels):
    return cv2.imencode(".png", np.asarray(pixels, np.uint8))[1].tobytes()


STRIPES = png([[[0, 0, 255]] * 4, [[255, 0, 0]] * 4])  # red above, blue below


def zip_bytes(files):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in files.items():
            file.writestr(name, data)
    return buffer.getvalue()


def properties(*models, **shared):
    """The text of a catalogue's properties."""
    lines = [f"{key}={value}" for key, value in ({"name": "Tiny", "license": "CC0"} | shared).items()]
    defaults = {
        "name": "Bed",
        "category": "Bedroom",
        "model": "/step/step.obj",
        "width": 100,
        "depth": 150,
        "height": 50,
        "creator": "Ann",
    }
    for number, model in enumerate(models, start=1):
        record = {"id": f"Tiny#{number}"} | defaults | model
        lines += [f"{key}#{number}={value}" for key, value in record.items() if value is not None]
    return "\n".join(lines).encode("latin-1")


@pytest.fixture
def write_catalogue(tmp_path):
    """Writes a catalogue of the given models, each of which is a step by default."""

    def write(*models, name="tiny.sh3f", files=None, **shared):
        content = {
            "PluginFurnitureCatalog.properties": properties(*models, **shared),
            "PluginFurnitureCatalog_fr.properties": b"name#1=Lit",
            "step/step.obj": STEP_OBJ,
            "step/step.mtl": STEP_MTL,
            "step/stripes.png": STRIPES,
        }
        path = tmp_path / "catalogues" / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(zip_bytes(content | (files or {})))
        return path.parent

    return write


@pytest.fixture
def nest():
    """The bytes of an archive with a step under each of the names."""
    return lambda *names: zip_bytes(dict.fromkeys(names, STEP_OBJ))


# A box of one metre, standing on the floor.
BOX_OBJ = """
v 0 0 0
v 1 0 0
v 1 0 1
v 0 0 1
v 0 1 0
v 1 1 0
v 1 1 1
v 0 1 1
f 1 2 3 4
f 5 8 7 6
f 1 5 6 2
f 2 6 7 3
f 3 7 8 4
f 4 8 5 1
"""

FURNITURE = {
    # name: group, and width, depth, height of each model in centimetres
    "Bed": ("Bedroom", (160, 205, 80), (95, 200, 70), (140, 205, 90)),
    "Chair": ("Living room", (42, 45, 90), (45, 50, 88), (44, 44, 95)),
    "Wooden alder table": ("Office", (140, 85, 75), (160, 90, 75)),
    "Bedside table": ("Bedroom", (45, 40, 50), (50, 42, 48)),
    "Burlap sofa": ("Living room", (180, 85, 85), (200, 90, 80)),
    "Cup": ("Kitchen", (9, 9, 10), (8, 8, 9)),
    "Washbasin": (
        "Bathroom",
        (60, 50, 40),
    ),
}


@pytest.fixture
def furnish(write_catalogue):
    """Writes a catalogue of boxes with the sizes of furniture; every model is a file of its own."""

    def write(**shared):
        models, files = [], {}
        for name, (group, *sizes) in FURNITURE.items():
            for width, depth, height in sizes:
                number = len(models) + 1
                path = f"model{number}/box.obj"
                files[path] = f"{BOX_OBJ}# {number}\n"
                models.append(
                    {"name": name, "category": group, "model": f"/{path}"}
                    | {"width": width, "depth": depth, "height": height}
                    | ({"elevation": 45} if name == "Washbasin" else {})
                )
        return write_catalogue(*models, files=files, **shared)

    return write


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "langwm"
