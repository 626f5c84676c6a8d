"""What must be true of a dataset's meshes and pictures: all that its scenes need, whole, and no others."""

from collections.abc import Collection
from pathlib import Path

from langwm_data.scenes.assets import ASSETS_DIR, Assets
from langwm_data.shards.findings import Finding, foreign
from langwm_data.shards.scenes import read_scene

_CHECK_PX = 16


def check_assets(folder: Path, scenes: Collection[str]) -> list[Finding]:
    """What is wrong with the assets of a dataset.

    Args:
        folder: That of the dataset.
        scenes: Those of its scenes that are sound.
    """
    place = folder / ASSETS_DIR
    needed = {file for name in sorted(scenes) for file in read_scene(folder, name).assets()}
    if place.is_symlink():
        return [Finding(where=ASSETS_DIR, what="is a link to another folder")]
    there = sorted(path.name for path in place.iterdir()) if place.is_dir() else []
    findings = [
        Finding(where=f"{ASSETS_DIR}/{foreign(name)[1:-1]}", what="is no part of this dataset")
        for name in there
        if name not in needed
    ]
    for file in sorted(needed):
        if fault := _fault(place, file):
            findings.append(Finding(where=f"{ASSETS_DIR}/{file}", what=fault))
    return findings


def _fault(place: Path, file: str) -> str:
    name, _, kind = file.partition(".")
    if (place / file).exists() and not (place / file).is_file():
        return "is not a plain file"
    assets = Assets(place)
    try:
        assets.read(file)
        if kind == "npz":
            assets.mesh(name)
        else:
            assets.picture(name, _CHECK_PX)
    except ValueError as error:
        return str(error).replace(f"{place}/", "")[:300]
    return ""
