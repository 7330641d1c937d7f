"""Another path of a front as the plan: the bytes of a whole run with that selection, without planning."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import fields
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pareto_ltl
from careful_io.files import write_json
from declared_settings import extensions
from pareto_ltl.run.choosing import Choice, chosen_run
from pareto_ltl.settings import SelectionConfig
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.extensions import SELECTION_RULES
from pareto_ltl_apps.cli.arguments import read_length, read_number, read_share
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.judge import verify
from quick_plan import QUICK_SEARCH

PHI1 = "F(a & F b & F c)"
SMALL: dict[str, Any] = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 2, "n_max": 1500, "max_steps": 80},
    "smoothing": {"candidates": 2, "weights": [1.0, 100.0]},
    "refine": {"flights": 60, "sweep_flights": 20, "classes": 1, "points": 5},
    "selection": {"draws": 300, "runs": 500},
    "deployment": {"runs": 40},
    "report": "none",
}
WEIGHTED = {"rule": "weighted", "weights": [0.7, 0.1, 0.2]}
PRESETS = ("paper", "full")
UNLIKE = {"run.json", "run.log", "metrics.json", "run.lock"}  # they tell when and how long


def planned(place: Path, preset: str, **selection: Any) -> Path:
    settings = SMALL | {"selection": SMALL["selection"] | selection}
    pareto_ltl.plan("phi1", PHI1, fidelity=preset, out=place, **settings)
    return place


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A results directory of each preset."""
    place = tmp_path_factory.mktemp("made")
    return {preset: planned(place / preset, preset) for preset in PRESETS}


def wishes(place: Path) -> dict[str, Any]:
    """A choice of each kind that the front of ``place`` has, and the selection that finds it."""
    front = pareto_ltl.load_results(place).front
    costs = [path.objectives for path in front.paths]
    limits = [r.high for r in front.rates] or [o.mission_risk + o.collision_risk for o in costs]
    middle = sorted(o.length for o in costs)[len(costs) // 2]
    alpha = min(0.5 * (sorted(limits)[0] + sorted(limits)[-1]), 0.99)
    return {
        "failure": ({"failure": alpha}, {"rule": "threshold", "alpha": alpha}),
        "length": ({"length": middle}, {"rule": "length", "length": middle}),
        "knee": ({"knee": True}, {"rule": "knee"}),
        "point": ({"point": len(costs) - 1}, {"rule": "point", "point": len(costs) - 1}),
        "selection": ({"selection": WEIGHTED}, WEIGHTED),
    }


@pytest.mark.parametrize("wish", ["failure", "length", "knee", "point", "selection"])
@pytest.mark.parametrize("preset", PRESETS)
def test_a_choice_has_the_bytes_of_a_whole_run_and_passes_the_judge(
    preset: str, wish: str, made: dict[str, Path], tmp_path: Path
) -> None:
    asked, selection = wishes(made[preset])[wish]
    chosen = pareto_ltl.choose(made[preset], **asked, out=tmp_path / "chosen")
    whole = planned(tmp_path / "whole", preset, **selection)
    names = {path.name for path in whole.iterdir()}
    assert {path.name for path in (tmp_path / "chosen").iterdir()} == names
    assert {"plan.json", "front.npz", "wind.nc", "trees.npz", "config_resolved.yaml"} <= names
    for name in sorted(names - UNLIKE):
        assert (tmp_path / "chosen" / name).read_bytes() == (whole / name).read_bytes(), name
    told, wanted = (pareto_ltl.load_results(place).metrics for place in (tmp_path / "chosen", whole))
    lasting = [
        name for name in wanted if "seconds" not in name and name not in ("nodes_per_second", "memory_mib")
    ]
    np.testing.assert_equal({name: told[name] for name in lasting}, {name: wanted[name] for name in lasting})
    assert told.keys() <= wanted.keys()
    if wish == "point":  # the others have the bytes of whole runs as well, which it judges elsewhere
        assert [finding for finding in verify(tmp_path / "chosen") if not finding.holds] == []
    assert chosen.plan.rule == selection["rule"]


@pytest.mark.parametrize("preset", PRESETS)
def test_in_memory_the_plan_is_the_same_and_nothing_is_written(preset: str, made: dict[str, Path]) -> None:
    before = sorted(path.name for path in made[preset].parent.iterdir())
    last = len(pareto_ltl.load_results(made[preset]).front.paths) - 1
    chosen = pareto_ltl.choose(made[preset], point=last)
    assert chosen.plan.path is chosen.front.paths[last]
    again = pareto_ltl.choose(chosen, point=0)
    assert again.plan.path is again.front.paths[0]
    assert sorted(path.name for path in made[preset].parent.iterdir()) == before
    with pytest.raises(ConfigError, match="writes from a results directory"):
        pareto_ltl.choose(chosen, point=0, out="somewhere")


def test_a_front_in_memory_is_chosen_from_without_a_directory() -> None:
    result = pareto_ltl.plan("phi1", PHI1, wind="calm", planner={"trees": 2, "n_max": 800}, **QUICK_SEARCH)
    shortest = min(path.objectives.length for path in result.front.paths)
    other = pareto_ltl.choose(result, length=shortest)
    assert other.plan.path.objectives.length == shortest
    assert other.forest is result.forest


def test_stages_that_make_what_is_kept_are_not_run(made: dict[str, Path], tmp_path: Path) -> None:
    run = chosen_run(made["full"], Choice(point=0), tmp_path / "other")
    assert list(run.seconds) == ["problem", "plan", "forecasts", "deployment", "export", "report", "page"]


# --- the command ------------------------------------------------------------------------------


def test_the_command_writes_beside_the_results(
    made: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    place = made["full"]
    assert run_command_line(["choose", str(place), "--knee"]) == 0
    there = place.with_name("full_knee")
    assert f"results in {there}" in capsys.readouterr().out.replace("\n", "")
    assert pareto_ltl.load_results(there).plan.rule == "knee"
    assert pareto_ltl.load_results(there).provenance["argv"] == ["pareto-ltl", "choose", str(place), "--knee"]
    assert run_command_line(["choose", str(place), "--point", "0", "--out", str(place.parent / "first")]) == 0
    assert run_command_line(["rerun", str(place.parent / "first")]) == 0
    assert "the same, byte for byte" in capsys.readouterr().out


def test_a_rule_with_its_settings_chooses_from_the_command_line(
    made: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--rule", "weighted", "selection.weights=[0,0,1]"]
    assert run_command_line(["choose", str(made["paper"]), *words]) == 0
    found = pareto_ltl.load_results(made["paper"].with_name("paper_rule_weighted"))
    assert (found.plan.rule, found.plan.weights) == ("weighted", (0.0, 0.0, 1.0))
    assert found.plan.path.objectives.length == min(path.objectives.length for path in found.front.paths)
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ["--failure", "1e-9"],
            r"no path has a failure rate of at most 1e-7 % in coherent winds (upper end of 95 %); the safest",
        ),
        (["--length", "10km"], "no path is as short as 10.0 km; the shortest of the front, point "),
        (["--point", "999"], "there is no point 999; the front has points 0 to "),
        (["--point", "-1"], "--point must be the number of a path"),
        (
            ["--failure", "often"],
            "--failure must be a probability between 0 and 1, e.g. 0.02 or 2%, got 'often'",
        ),
        (["--length", "1900 miles"], "--length must be a length in m, km or nmi, e.g. 1900km"),
        ([], "one of the arguments --failure --energy --length --knee --point --rule is required"),
        (["--knee", "--point", "1"], "not allowed with argument"),
        (["--rule", "best"], "selection.rule must be one of worth, priority, weighted, "),
        (["--rule", "weighted", "selection.weights=[1,0]"], "selection.weights must be three numbers >= 0"),
        (["--rule", "weighted", "selection.weight=[1,0,0]"], "did you mean selection.weights?"),
        (["--rule", "weighted", "weights=[1,0,0]"], "'weights=[1,0,0]' is not known; expected selection.KEY"),
        (["--rule", "weighted", "selection.weights=[1,"], "'selection.weights=[1,' cannot be read: "),
        (["--knee", "selection.draws=10"], "expected selection.KEY=VALUE, with --rule NAME"),
        (["--rule", "knee", "selection.options.hours=3"], "selection.rule=knee reads none: remove hours"),
    ],
)
def test_a_wish_that_cannot_be_met_is_one_line(
    words: list[str], line: str, made: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(path.name for path in made["full"].parent.iterdir())
    assert run_command_line(["choose", str(made["full"]), *words]) == 2
    err = capsys.readouterr().err
    assert line in err
    assert err.count("\n") == 1
    assert sorted(path.name for path in made["full"].parent.iterdir()) == before


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (shutil.rmtree, "there is no run.json"),
        (lambda place: (place / "front.npz").unlink(), "front.npz: cannot be read"),
        (lambda place: (place / "front.csv").write_text("path\n"), "front.npz: not a front (it holds"),
        (lambda place: (place / "automaton.json").write_text("{}"), "automaton.json: lacks 'formula'"),
        (lambda place: write_json(place / "run.json", {"status": "infeasible"}), "its run found no plan"),
    ],
)  # fmt: skip
def test_results_that_hold_no_front_are_refused(
    damage: Callable[[Path], Any], words: str, made: dict[str, Path], tmp_path: Path
) -> None:
    place = tmp_path / "place"
    shutil.copytree(made["paper"], place)
    damage(place)
    with pytest.raises(DataError) as caught:
        pareto_ltl.choose(place, knee=True, out=tmp_path / "other")
    assert words in str(caught.value)
    assert not (tmp_path / "other").exists()


def test_a_choice_does_not_replace_its_source(made: dict[str, Path]) -> None:
    kept = (made["paper"] / "plan.json").read_bytes()
    with pytest.raises(ConfigError, match="would overwrite its source"):
        pareto_ltl.choose(made["paper"], knee=True, out=made["paper"].parent / "x" / ".." / "paper")
    assert (made["paper"] / "plan.json").read_bytes() == kept


def test_a_mapping_of_the_selection_names_its_rule(made: dict[str, Path]) -> None:
    with pytest.raises(ConfigError, match="selection names no rule; expected"):
        pareto_ltl.choose(made["paper"], selection={"weights": [1, 0, 0]})


@pytest.mark.parametrize(
    "given",
    [{}, {"knee": True, "point": 1}, {"failure": 0.1, "length": 1e6}, {"knee": True, "selection": {}}],
)
def test_exactly_one_wish_is_given(given: dict[str, Any], made: dict[str, Path]) -> None:
    with pytest.raises(ConfigError, match="give one of failure, energy, length, knee, point and selection"):
        pareto_ltl.choose(made["paper"], **given)


def test_a_wish_out_of_range_is_refused(made: dict[str, Path]) -> None:
    for wish in ({"failure": 1.5}, {"length": -1.0}, {"point": -1}):
        with pytest.raises((ConfigError, InfeasibleError)):
            pareto_ltl.choose(made["paper"], **wish)  # type: ignore[arg-type]


# --- what is asked ----------------------------------------------------------------------------


@given(st.floats(1.0, 1e6), st.sampled_from(["", "m", " m", "km", "nmi"]))
def test_lengths_have_units(value: float, unit: str) -> None:
    metres = {"km": 1e3, "nmi": 1852.0}.get(unit.strip(), 1.0) * value
    if metres <= 1e9:
        assert read_length(f"{value!r}{unit}") == pytest.approx(metres)


@pytest.mark.parametrize(
    ("text", "share"), [("0.02", 0.02), ("2%", 0.02), (" 7.5 % ", 0.075), (".5", 0.5), ("1e-3", 1e-3)]
)
def test_a_failure_is_a_share_or_a_percentage(text: str, share: float) -> None:
    assert read_share(text) == pytest.approx(share)


@given(st.text(max_size=8))
def test_any_other_text_is_refused(text: str) -> None:
    for read in (read_share, read_length, read_number):
        try:
            assert read(text) >= 0
        except ConfigError:
            continue


@pytest.mark.parametrize("text", ["٣", "1_0", "+3", "", "1e400", "nan", "inf", "0x10"])
def test_numbers_of_other_kinds_are_refused(text: str) -> None:
    for read in (read_share, read_length, read_number):
        with pytest.raises(ConfigError):
            read(text)


def test_folders_are_named_after_the_choice() -> None:
    names = [
        Choice(failure=0.02),
        Choice(length=1.9e6),
        Choice(length=1852.0),
        Choice(knee=True),
        Choice(point=3),
        Choice(selection=WEIGHTED),
    ]
    assert [choice.name for choice in names] == [
        "failure_0.02", "length_1900km", "length_1.852km", "knee", "point_3", "rule_weighted",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("choice", "changes"),
    [
        (Choice(failure=0.01), {"rule": "threshold", "alpha": 0.01}),
        (Choice(energy=0.02), {"rule": "energy", "alpha": 0.02}),
        (Choice(length=7e4), {"rule": "length", "length": 7e4}),
        (Choice(point=0), {"rule": "point", "point": 0}),
        (Choice(knee=True), {"rule": "knee"}),
        (Choice(selection={"rule": "weighted", "weights": [1.0, 0.0, 0.0]}),
         {"rule": "weighted", "weights": [1.0, 0.0, 0.0]}),
        (Choice(selection={"rule": "of_others"}), {"rule": "of_others", "options": {"hours": 3}}),
        (Choice(selection={"rule": "of_others", "options": {}}), {"rule": "of_others"}),
    ],
)  # fmt: skip
def test_a_choice_changes_its_own_settings_and_keeps_options_for_the_same_rule_alone(
    choice: Choice, changes: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    rule = EntryPoint("of_others", "others:rule", SELECTION_RULES.name)
    plain = extensions.installed_entries
    added = {rule.group: {rule.name: rule}}
    monkeypatch.setattr(extensions, "installed_entries", lambda group: plain(group) | added.get(group, {}))
    before = SelectionConfig(rule="of_others", options={"hours": 3}, alpha=0.3, length=5e4, point=4, runs=77)
    expected = {field.name: getattr(before, field.name) for field in fields(before)} | {"options": {}}
    after = choice.settings(before)
    assert {name: getattr(after, name) for name in expected} == expected | changes


@pytest.mark.parametrize(
    "criteria",
    [{}, {"knee": True, "failure": 0.1}, {"length": 1.0, "point": 0},
     {"knee": True, "selection": {"rule": "knee"}}, {"selection": {"weights": [1, 0, 0]}}, {"point": -1}],
)  # fmt: skip
def test_a_choice_that_is_none_or_two_is_refused(criteria: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"give one of|names no rule|0 or more"):
        Choice(**criteria)
