"""Settings from plain Python: the same as the command line composes, with the same refusals."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hydra.types import RunMode

import pareto_ltl
from pareto_ltl.run import provenance
from pareto_ltl.run.interface import python_arguments
from pareto_ltl.settings import PRESETS, PlannerConfig, Settings, preset
from pareto_ltl.settings.fidelity import models_of
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.cli import composition
from pareto_ltl_apps.cli.setting_keys import settings_from

NEEDS_A_FILE = {"csv", "currents", "ensemble", "grib", "netcdf", "stations"}


def composed(*overrides: str) -> Settings:
    """What the command line makes of ``overrides``."""
    arguments = composition.parse_flags(overrides)
    with composition.opened_hydra(arguments) as hydra:
        return settings_from(composition.composed_config(hydra, arguments, RunMode.RUN))


@pytest.mark.parametrize(
    ("message", "arguments"),
    [
        ("planner.epsilon must be above 0, got 3", 'planner={"epsilon": ...}'),
        ("unknown setting planner.treez; did you mean planner.trees?", 'planner={"trees": ...}'),
        (
            "raise robot.u_max, planner.epsilon or robot.dt=auto, since robot.u_max is 3 m/s",
            'robot={"u_max": ..., "dt": ...}, planner={"epsilon": ...}',
        ),
        ("mission.formula: no region d; wind.nc and scene.json cannot be read", ""),
    ],
)
def test_settings_of_a_message_are_spelled_as_arguments_in_python(message: str, arguments: str) -> None:
    assert python_arguments(message) == arguments


def test_an_error_of_plan_has_a_note_with_the_spelling_in_python() -> None:
    with pytest.raises(ConfigError, match=r"^planner.trees must lie") as refused:
        pareto_ltl.plan("phi1", "F a", planner={"trees": 0})
    assert refused.value.__notes__ == ['in Python: pareto_ltl.plan(..., planner={"trees": ...})']
    with pytest.raises(pareto_ltl.FormulaError) as unread:
        pareto_ltl.plan("phi1", "F (")
    assert unread.value.__notes__ == ["F (\n   ^"]  # where it is wrong, and no setting


def test_nothing_said_is_the_default() -> None:
    assert Settings.of({}) == Settings()


@pytest.mark.parametrize(
    ("section", "name"),
    [
        (section, name)
        for section in ("scene", "mission", "robot", "wind", "planner", "fidelity", "selection", "report")
        for name in CONF.names(section)
        if name not in (*NEEDS_A_FILE, "length")
    ],
)
def test_a_choice_has_the_values_that_the_command_line_composes(section: str, name: str) -> None:
    assert repr(Settings.of_section(section, name)) == repr(getattr(composed(f"{section}={name}"), section))


def test_a_choice_of_several_sections_has_the_values_that_the_command_line_composes() -> None:
    quick = Settings.of({"planner": "quick", "refine": {"points": 5}})
    line = composed("planner=quick", "refine.points=5")
    for section in ("planner", "refine", "selection"):
        assert repr(getattr(quick, section)) == repr(getattr(line, section))
    assert (quick.refine.flights, quick.selection.draws, quick.planner.trees) == (500, 4000, 4)


@pytest.mark.parametrize("source", CONF.names("wind"))
def test_a_wind_by_its_source_has_the_values_that_the_command_line_composes(source: str) -> None:
    """``noise_min`` and ``max_speed`` of a current are not those of a wind."""
    path = ["wind.path=x"] if source in NEEDS_A_FILE else []
    asked: dict[str, Any] = {"source": source} | ({"path": "x"} if path else {})
    line = composed(f"wind={source}", *path).wind
    assert repr(Settings.of_section("wind", asked)) == repr(line)
    explicit = {"noise_min": 0.123, "max_speed": 12.0, "level": "20m", "hold_last": False}
    changed = composed(f"wind={source}", *path, *(f"wind.{key}={value}" for key, value in explicit.items()))
    assert repr(Settings.of_section("wind", asked | explicit)) == repr(changed.wind)


def test_values_have_the_types_of_the_settings_whatever_was_given() -> None:
    built = Settings.of(
        {
            "seed": np.int64(3),
            "robot": {"dt": 600, "u_max": np.float32(20), "a": np.eye(2)},
            "planner": {"n_max": 500, "epsilon": None},
            "smoothing": {"weights": (1, 10)},
            "scene": {
                "bounds": ((0, 0), (1, 1)),
                "random": {"regions": 2},
                "regions": {"a": [(0, 0), (1, 1)]},
            },
        }
    )
    assert repr(asdict(built.robot)["dt"]) == "600.0"
    assert repr(built.robot.u_max) == "20.0"
    assert built.robot.a == [[1.0, 0.0], [0.0, 1.0]]
    assert repr(built.smoothing.weights) == "[1.0, 10.0]"
    assert built.scene.bounds == [[0, 0], [1, 1]]
    assert built.scene.regions == {"a": [[0, 0], [1, 1]]}
    assert built.scene.random.regions == 2
    assert type(built.seed) is int
    assert built.planner.epsilon is None


def test_a_settings_object_is_taken_as_it_is() -> None:
    mine = PlannerConfig(trees=3)
    assert Settings.of({"planner": mine}).planner is mine


@pytest.mark.parametrize("name", PRESETS)
def test_one_model_changes_on_top_of_its_preset(name: str) -> None:
    built = Settings.of_section("fidelity", {"name": name, "refine": "none"})
    assert built.label == f"{name} with refine=none"
    assert built.law == preset(name).law


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"planner": {"treez": 3}}, "unknown setting planner.treez; did you mean planner.trees?"),
        ({"selection": {"section": "x"}}, "unknown setting selection.section; "),
        (
            {"selection": {"margin": 1}},
            "unknown setting selection.margin; there are rule, saving, weights, alpha, ",
        ),
        ({"plannr": {}}, "unknown setting plannr; did you mean planner?"),
        (
            {"ablation": {"parents": ["scaled"]}},
            "ablation.parents is no setting any more: trees of every preset grow by the paper's models",
        ),
        (
            {"fidelity": {"parents": "mixed"}},
            "fidelity.parents=mixed is no rule: trees of every preset grow by the paper's models and choose",
        ),
        ({"planner": {"trees": 2.5}}, "planner.trees must be a whole number, got 2.5"),
        ({"planner": {"trees": True}}, "planner.trees must be a whole number, got True"),
        ({"planner": {"trees": 0}}, "planner.trees must lie in [1, 10000], got 0"),
        ({"robot": {"dt": "soon"}}, "robot.dt must lie in [0.001, 1000000] [s] or be auto, got 'soon'"),
        ({"robot": 30}, "robot must be a choice, a mapping or a settings object, got 30"),
        ({"wind": "storm"}, "there is no wind 'storm'; there are aifs, "),
        ({"mission": {"goals": "a"}}, "mission.goals must be "),
        ({"report": {"figures": 1}}, "report.figures must be true or false, got 1"),
        ({"scene": {"random": {"gaps": 1}}}, "unknown setting scene.random.gaps; did you mean"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(sections: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        Settings.of(sections)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_settings_come_back_from_the_file_of_a_run(tmp_path: Path) -> None:
    settings = composed("+experiment=phi2", "robot.u_max=25", "planner.epsilon=0.04", "wind.rho=0.5")
    provenance.write_settings(tmp_path, settings)
    back = Settings.of_file(tmp_path / "config_resolved.yaml")
    assert asdict(back) == asdict(settings)
    assert provenance.config_hash(back) == provenance.config_hash(settings)


@pytest.mark.parametrize(
    ("content", "message"), [(None, "cannot be read"), ("a: [", "not YAML"), ("3", "keys")]
)
def test_a_spoilt_file_of_settings_is_named(content: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "config_resolved.yaml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(DataError, match=message) as caught:
        Settings.of_file(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("name", ["a" * 100_000, "../scene/phi1", "no\0name", "", "*"])
def test_a_choice_that_is_no_name_of_a_file_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(ConfigError, match=r"there is no scene .*; there are") as caught:
        Settings.of({"scene": name})
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


def test_what_earlier_versions_wrote_about_trees_is_read_and_left_out(tmp_path: Path) -> None:
    path, content = tmp_path / "config_resolved.yaml", asdict(Settings())
    content["fidelity"]["parents"] = "mixed"
    content["ablation"]["parents"] = ["dominance", "scaled"]
    path.write_text(yaml.safe_dump(content))
    assert Settings.of_file(path) == Settings()
    assert models_of("full with parents=scaled, refine=none") == replace(preset("full"), refine="none")
    with pytest.raises(ValueError, match="is not a label of a fidelity"):
        models_of("full with parnts=scaled")
