"""A small dataset in the layout of iGibson 1.0, whole or to be spoilt."""

import shutil

import pytest
from igibson_dataset import write_dataset
from igibson_files import Writer

from langwm_data.scenes.igibson.source import IGibson


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
