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
