import pytest

from agent.benchmark import grid as grid_module
from agent.benchmark.grid import (
    Cell,
    Request,
    base_config,
    cell_config,
    cells_of,
    known_systems,
    make_grid,
    parse_maes,
    parse_seeds,
    parse_systems,
)
from agent.benchmark.rows import GROUPS, TABLE, in_table_order, row_of
from agent.systems.controls import CONTROL_NAMES
from agent.systems.registry import SYSTEMS
from langwm_data.config_io import ConfigError


def test_every_learner_and_control_is_known_and_the_table_lists_each_once():
    assert set(known_systems()) == {*SYSTEMS, *CONTROL_NAMES}
    assert len(known_systems()) == len(set(known_systems()))
    assert {row_of(name).group for name in CONTROL_NAMES} == {"control"}
    assert {row.group for row in TABLE.values()} <= set(GROUPS)


def test_without_names_all_systems_that_need_no_download_are_taken(monkeypatch):
    monkeypatch.setattr(grid_module, "SYSTEMS", dict.fromkeys(["langwm", "dreamerv2-grounding-dino", "mine"]))
    assert parse_systems(None) == ("langwm", *(n for n in TABLE if n in CONTROL_NAMES), "mine")
    assert parse_systems("dreamerv2-grounding-dino, langwm,langwm") == ("dreamerv2-grounding-dino", "langwm")


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("0-4", (0, 1, 2, 3, 4)), ("7", (7,)), ("0-2,5", (0, 1, 2, 5)), ("3,1-3", (3, 1, 2)), (" 2 ", (2,))],
)
def test_seeds_are_read(text, seeds):
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["4-0", "", "a", "1,,2", "-1", "0-", "0-1000", "1.5", "9" * 12])
def test_wrong_seeds_are_refused(text):
    with pytest.raises(
        ConfigError, match=f"--seeds '{text}' is not of the form 0-4, 7 or 0-2,5, first before"
    ):
        parse_seeds(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [("langwm,hal", "--systems: 'hal' is unknown; allowed: .*langwm"), (" , ", "names no system; allowed: ")],
)
def test_wrong_systems_are_refused(text, message):
    with pytest.raises(ConfigError, match=message):
        parse_systems(text)


def test_autoencoders_are_given_to_the_systems_they_were_trained_for():
    assert parse_maes(["runs/a=b"][:0]) == {}
    assert parse_maes(["runs/mae"]) == {"langwm": "runs/mae"}
    assert parse_maes(["langwm=runs/a=b"]) == {"langwm": "runs/a=b"}


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (
            ["hal=runs/mae"],
            "--mae 'hal=runs/mae' is not of the form RUN or SYSTEM=RUN; systems that read one: .*langwm",
        ),
        (["random=runs/mae"], "--mae 'random=runs/mae' is not of the form"),
        (["dreamerv2=runs/mae"], "--mae 'dreamerv2=runs/mae' is not of the form"),
        (["langwm="], "--mae 'langwm=' is not of the form"),
        ([""], "--mae '' is not of the form"),
        (["a", "langwm=b"], "--mae names two runs for langwm: 'a' and 'b'; give one"),
    ],
)
def test_wrong_autoencoders_are_refused(texts, message):
    with pytest.raises(ConfigError, match=message):
        parse_maes(texts)


def test_a_cell_is_configured_as_train_agent_would_be():
    request = Request(systems="random,langwm", seeds="0-1", mae=["runs/mae"])
    grid = make_grid(request, presets=["tiny"], flags={"steps": 500}, assignments=["env.max_steps=70"])
    assert cells_of(grid) == [Cell("random", 0), Cell("langwm", 0), Cell("langwm", 1)]
    assert [cell.is_control for cell in cells_of(grid)] == [True, False, False]
    config = cell_config(grid, Cell("langwm", 1))
    assert (config.system, config.seed, config.mae) == ("langwm", 1, "runs/mae")
    assert (config.steps, config.env.max_steps, config.features) == (500, 70, "frozen")
    assert base_config(grid).env == config.env


def test_what_is_there_is_named_from_the_root(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here").mkdir()
    flags = {"env": {"scenes": {"baked": "here"}}}
    grid = make_grid(Request(mae=["here", "mwm=some/hub"]), flags=flags)
    assert grid.mae == {"langwm": str(tmp_path / "here"), "mwm": "some/hub"}
    assert grid.overrides == {"env": {"scenes": {"baked": str(tmp_path / "here")}}}
    grid = make_grid(Request(), assignments=["env.scenes.igibson=here", "env.id=here"])
    assert grid.overrides["env"] == {"scenes": {"igibson": str(tmp_path / "here")}, "id": "here"}


def test_what_differs_between_cells_is_not_for_assignments():
    for text, flag in (("seed=3", "--seeds"), ("mae=x", "--mae"), ("system=langwm", "--systems")):
        with pytest.raises(ConfigError, match=f"--set {text} is not for a grid; give {flag}"):
            make_grid(Request(), assignments=[text])


def test_wrong_settings_and_presets_are_refused_by_name():
    with pytest.raises(ConfigError, match=r"did you mean 'height'"):
        make_grid(Request(), assignments=["env.camera.heigth=3"])
    with pytest.raises(ConfigError, match="--preset 'huge' is unknown"):
        make_grid(Request(), presets=["huge"])
    with pytest.raises(ConfigError, match="--against 'hal' is unknown; allowed: "):
        make_grid(Request(against="hal"))


def test_the_order_of_the_table_is_by_group():
    names = {"random", "mine", "langwm", "rad", "langwm-no-mask"}
    assert in_table_order(names) == ["rad", "langwm", "langwm-no-mask", "mine", "random"]
