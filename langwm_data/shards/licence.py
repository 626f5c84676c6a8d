"""What a data card says about licences: of what the generator made, and of what it took from others."""

from collections.abc import Sequence

from langwm_data.scenes.spec import ModelRecord
from langwm_data.shards.manifest import CARD_FILE, Manifest

_OWN = """\
Homes, furniture and textures are procedural, made by the generator itself; no third-party assets are
in these files. They may be used under the generator's licence, Apache-2.0."""

_IGIBSON = """\
**Not to be passed on.** These views show scenes, object models and materials of the iGibson 1.0 dataset
(Stanford Vision and Learning Lab; models partly after ShapeNet and PartNet-Mobility), and `assets/` holds
meshes and pictures made from its files. Who has that dataset has accepted its licence, which forbids to
redistribute it: keep these files where that licence lets you keep the iGibson dataset."""

_FURNITURE = """\
Homes, textures and some of the furniture are procedural, made by the generator itself, and may be used
under its licence, Apache-2.0. The furniture models below are by the authors named there, under the licences
named there, read from catalogues whose checksum stands in `dataset.json` under `sources`. They are thinned
and scaled to the size that their catalogue states; `assets/` holds them as they were drawn. Whoever passes
on views of them names their authors. Models for test are shown by no training frame.

| model | name | author | licence | catalogue | split |
|---|---|---|---|---|---|
"""


def is_igibson(manifest: Manifest) -> bool:
    """Whether a dataset shows scenes of iGibson."""
    return "igibson" in manifest.sources


def licence_tags(manifest: Manifest) -> dict[str, str]:
    """As Hugging Face reads them: one licence for all, or ``other`` with a name and a place to read on."""
    if is_igibson(manifest):
        return {"license": "other", "license_name": "igibson-1.0-dataset"}
    if manifest.sources:
        link = f"{CARD_FILE}#licence"
        return {"license": "other", "license_name": "apache-2.0-with-models-of-others", "license_link": link}
    return {"license": "apache-2.0"}


def licence_text(manifest: Manifest, models: Sequence[ModelRecord]) -> str:
    """The paragraph for people, with the authors of all models of catalogues.

    Args:
        manifest: What the dataset holds.
        models: Those of others that stand in its scenes.
    """
    if is_igibson(manifest):
        return _IGIBSON
    if not manifest.sources:
        return _OWN
    rows = (
        (m.model, m.name, m.author, m.licence, m.source, m.split)
        for m in sorted(models, key=lambda m: (m.source, m.model))
    )
    return _FURNITURE + "\n".join(f"| {' | '.join(map(_cell, row))} |" for row in rows)


def _cell(text: str) -> str:
    """Foreign text in one cell of a table."""
    plain = " ".join(text.split())
    return "".join(f"\\{c}" if c in "\\|`*_[]<>" else c for c in plain)
