"""The Python of the README runs as it stands there, on small stand-ins for its runs."""

import re
import shlex
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch

import agent  # noqa: F401  # registers the environment
import cli
from agent.systems.agent import Agent
from agent.systems.registry import find_system, load_agent_config
from agent.systems.system import Spaces
from langwm_data.config import DatasetConfig
from langwm_data.config_io import load_config
from langwm_data.pipeline import render_dataset
from langwm_data.shards.dataset import ShardDataset
from pretrain.batch import TextTokens
from pretrain.config import MAEConfig, TextConfig
from pretrain.mae import LanguageGroundedMAE
from pretrain.model_file import MODEL_FOLDER

SIZE = {"frames": 4, "splits": {"test_fraction": 0.5}}
TEXT = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", TEXT, flags=re.MULTILINE | re.DOTALL)


def blocks_of(title):
    """The Python of one section, as somebody would paste it: one block after another."""
    section = TEXT.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    return [block for block in BLOCKS if block in section]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder with ``runs/data``, ``runs/mae`` and ``runs/agent`` that have learned nothing."""
    folder = tmp_path_factory.mktemp("readme")
    config = load_config(DatasetConfig, "langwm_data", presets=["debug"], overrides=SIZE)
    render_dataset(config, folder / "runs/data")
    null = TextTokens(embed=torch.zeros(1, 21, 8), attend=torch.ones(1, 21, dtype=torch.bool))
    sizes = MAEConfig(conv_channels=(4, 4, 4, 4), dim=8, num_heads=2, encoder_layers=1, decoder_layers=1)
    LanguageGroundedMAE(sizes, TextConfig(), null).save_pretrained(folder / "runs/mae" / MODEL_FOLDER)
    agent_config = load_agent_config("dreamerv2", presets=["debug"])
    env = gymnasium.make("LangWM/PointNav-v0")
    model = find_system("dreamerv2").create(agent_config, Spaces.of(env))
    Agent(model, agent_config, Spaces.of(env)).save_pretrained(folder / "runs/agent" / MODEL_FOLDER)
    return folder


def test_from_python_runs(runs, monkeypatch):
    monkeypatch.chdir(runs)
    library, own = blocks_of("From Python")
    names = {}
    exec(library, names)
    assert names["tokens"].shape == (1, 81, 8)
    assert names["depth"].shape == (1, 128, 160)
    assert names["mask"].any()
    assert names["action"].shape == (2,)
    exec(own.replace('"tiny"', '"debug"'), names := {})
    assert names["run"] == Path("runs/mine")
    assert names["agent"].system == "own-encoder"


def test_what_is_in_a_dataset_runs(runs, monkeypatch):
    monkeypatch.chdir(runs)
    saved = ShardDataset("runs/data").iter(shuffle_seed=0).state_dict()
    names = {"rank": 0, "num_ranks": 1, "worker": 0, "num_workers": 1, "saved": saved}
    (block,) = blocks_of("What is in a dataset")
    exec(block, names)
    assert names["rgb"].dtype == np.uint8
    assert len(list(names["stream"])) == 4


def test_the_plan_of_the_table_is_made(runs, monkeypatch, capsys):
    monkeypatch.chdir(runs)
    (line,) = re.findall(r"^langwm (benchmark .* --plan)", TEXT, flags=re.MULTILINE)
    assert cli.run(shlex.split(line)) == 0
    assert capsys.readouterr().out.startswith("cells   3: 0 are done, 2 are to be trained")


def test_the_script_with_processes_makes_none_where_it_is_only_imported():
    (block,) = blocks_of("Scores that can be compared")
    exec(block, names := {"__name__": "__mp_main__"})
    assert "RestartingVectorEnv" in names
    assert "envs" not in names
