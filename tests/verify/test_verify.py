"""Honest results pass the judge, and every planted lie is caught."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from careful_io.reading import read_json
from careful_io.yaml_files import read_yaml
from honest_results import PRESETS, SMALL
from levels import first_of_each
from lies import LIES, Lie, edited
from lies.editing import in_plan, setting
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.flights import clopper_pearson
from pareto_ltl_verify.judge import CLAIMS, findings, verify

# Before the night each claim is lied about once, in results of both presets by turns.
EVERY = [
    (lie, preset)
    for number, lie in enumerate(LIES)
    for preset in (PRESETS[number % 2 :] + PRESETS[: number % 2])
    if lie.only in ("", preset)
]
CASES = list(first_of_each(EVERY, lambda case: case[0].caught))


@pytest.mark.parametrize("preset", PRESETS)
def test_an_honest_result_passes(preset: str, honest: dict[str, Path]) -> None:
    found = verify(honest[preset])
    assert [finding for finding in found if not finding.holds] == []
    assert len(found) >= 80
    assert len({finding.claim for finding in found}) == len(found)


@pytest.mark.parametrize(("lie", "preset"), CASES, ids=[f"{lie.name}-{preset}" for lie, preset in CASES])
def test_a_lie_is_caught(lie: Lie, preset: str, honest: dict[str, Path], tmp_path: Path) -> None:
    result = open_evidence(edited(honest[preset], tmp_path / "lie", lie))
    claims = {claim.name: claim for claim in CLAIMS}
    for name in lie.caught:
        (finding,) = findings(result, [claims[name]])
        assert not finding.holds, finding


def test_a_promise_that_is_a_fifth_too_low_is_caught(tmp_path: Path) -> None:
    """As many new flights as the promise has contradict it; 2,000 would not."""
    often = {
        "selection": {"draws": 200, "runs": 20_000, "rule": "threshold", "alpha": 0.2},
        "exports": "none",
        "refine": {"flights": 200, "sweep_flights": 60, "classes": 1, "points": 4},
        "robot": SMALL["robot"] | dict.fromkeys(("airspeed_sd", "heading_sd", "clock_sd")),
    }
    place = tmp_path / "often"
    pareto_ltl.plan("phi1", "F(a & F b & F c)", fidelity="full", out=place, **(SMALL | often))
    claim = [claim for claim in CLAIMS if claim.name == "plan: promised rate"]
    assert next(findings(open_evidence(place), claim)).holds
    told = read_json(place / "plan.json")["promise"]
    assert 0.05 < told["failure"] < 0.2
    low, high = clopper_pearson(count := round(0.8 * told["failure"] * told["runs"]), told["runs"])
    in_plan(lambda plan: plan["promise"].update(failure=count / told["runs"], low=low, high=high))(place)
    assert not next(findings(open_evidence(place), claim)).holds
    in_plan(lambda plan: plan["promise"].update(runs=2000))(place)
    assert next(findings(open_evidence(place), claim)).holds


@pytest.mark.parametrize("preset", PRESETS)
def test_a_path_and_its_beginning_are_flown_in_the_same_winds(preset: str, honest: dict[str, Path]) -> None:
    """Else paths of different lengths would not fail together, as they do in the flights of the planner."""
    result = open_evidence(honest[preset])
    for law in ("independent", "coherent"):
        whole = result.fly(law, result.x, result.u, 20, 3)
        for steps in (1, len(result.u) // 2, len(result.u) - 1):
            begun = result.fly(law, result.x[: steps + 1], result.u[:steps], 20, 3)
            np.testing.assert_array_equal(begun, whole[:, : steps + 1])


def test_each_lie_has_a_name_of_its_own() -> None:
    assert len({lie.name for lie in LIES}) == len(LIES) >= 60
    assert {name for lie in LIES for name in lie.caught} <= {claim.name for claim in CLAIMS}


# --- the command ------------------------------------------------------------------------------


def test_the_command_prints_a_table_and_counts_failures(
    honest: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["verify", str(honest["paper"])]) == 0
    *out, count, rest = capsys.readouterr().out.splitlines()
    assert all(line.startswith("holds  ") and len(line) <= 80 for line in out)
    assert count == f"{len(out)} claims hold"
    assert rest.startswith("only pareto-ltl rerun can show: ")

    lie = next(lie for lie in LIES if lie.name == "the covariance is smaller")
    place = edited(honest["paper"], tmp_path / "lie", lie)
    assert run_command_line(["verify", "--failed-only", str(place)]) == 3
    out = capsys.readouterr().out.splitlines()
    wrong = [line.removeprefix("FAILS  ") for line in out[:-1:3]]
    assert {"plan: covariance", "exports: ellipses and radii", "exports: areas of corridors"} <= set(wrong)
    assert [line.split()[0] for line in out[1:3]] == ["claimed", "re-derived"]
    assert out[-1].startswith(f"{len(wrong)} of ")
    assert "claims fail: plan: covariance; exports: ellipses and radii" in out[-1]

    assert run_command_line(["verify", str(place), "--json"]) == 3
    document = json.loads(capsys.readouterr().out)
    assert document["failed"] == len(wrong) == sum(not claim["holds"] for claim in document["claims"])


def test_settings_without_a_selection_are_claims_that_fail(
    honest: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "damaged"
    shutil.copytree(honest["paper"], place)
    file = place / "config_resolved.yaml"
    settings = read_yaml(file)
    del settings["selection"]
    file.write_text(json.dumps(settings))
    assert run_command_line(["verify", "--failed-only", str(place)]) == 3
    told = capsys.readouterr()
    assert "FAILS  front: the rule picks the plan\n       claimed     cannot be judged\n" in told.out
    assert "       re-derived  KeyError: 'selection'\n" in told.out
    assert told.err == ""


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (shutil.rmtree, "no such folder"),
        (lambda place: (place / "run.json").unlink(), "is this a results directory?"),
        (lambda place: (place / "metrics.json").unlink(), "is this a results directory?"),
        (lambda place: (place / "metrics.json").write_text("{"), "not JSON"),
        (lambda place: (place / "config_resolved.yaml").unlink(), "is this a results directory?"),
        (lambda place: (place / "config_resolved.yaml").write_text("a: [b"), "not YAML"),
        (lambda place: (place / "config_resolved.yaml").write_bytes(b"a: \xff"), "is not UTF-8"),
        (lambda place: (place / "config_resolved.yaml").write_text("5"), "expected keys and values"),
        (lambda place: _rewrite(place, status="running"), "its run was killed; plan again"),
        (lambda place: _rewrite(place, stages=["compare"]), "holds no plan, its stages are ['compare']"),
        (lambda place: _rewrite(place, stages=None), "holds no plan"),
    ],
)
def test_what_is_no_finished_plan_is_one_line(
    damage: Callable[[Path], Any],
    words: str,
    honest: dict[str, Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = tmp_path / "place"
    shutil.copytree(honest["paper"], place)
    damage(place)
    assert run_command_line(["verify", str(place)]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def _rewrite(place: Path, **changes: Any) -> None:
    path = place / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


EXPORTED = ("plan.gpx", "plan.kml", "plan.geojson", "mission.plan", "mavlink_script.json", "trajectory.nc")


@pytest.mark.parametrize(
    "names",
    [
        *[(name,) for name in ("plan.json", "scene.json", "cells.json", "automaton.json", "wind.nc")],
        *[("trees.npz",), ("front.csv",), EXPORTED],
    ],
    ids=lambda names: names[0],
)
def test_a_damaged_file_is_a_claim_that_fails(
    names: tuple[str, ...], honest: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Files of exports, each of which has claims of its own, are damaged together."""
    place = tmp_path / "place"
    shutil.copytree(honest["paper"], place)  # which is verified in half the time of ``full``
    for name in names:
        content = (place / name).read_bytes()
        (place / name).write_bytes(content[: len(content) // 2])
    assert run_command_line(["verify", "--failed-only", str(place)]) == 3
    captured = capsys.readouterr()
    assert captured.err == ""
    lines = captured.out.splitlines()
    ends = [k for k, line in enumerate(lines) if line.endswith("claimed     cannot be judged")]
    unread = [lines[k - 1] + lines[k + 1] for k in ends]
    if names == EXPORTED:
        assert {name for name in names for line in unread if name in line} == set(names)
    else:
        assert unread or names == ("front.csv",)  # half a table is a table


def test_an_infeasible_run_is_judged_by_what_is_there(tmp_path: Path) -> None:
    settings = SMALL | {"planner": {"trees": 1, "n_max": 20}, "robot": {}}
    with pytest.raises(InfeasibleError):
        pareto_ltl.plan("phi1", "F(a & F b & F c)", fidelity="paper", out=tmp_path / "none", **settings)
    found = verify(tmp_path / "none")
    assert [finding for finding in found if not finding.holds] == []
    assert {finding.claim.partition(":")[0] for finding in found} == {
        "run", "settings", "metrics", "map", "mission", "wind", "plan", "trees", "units",
    }  # fmt: skip


def test_a_time_step_that_was_left_to_the_planner_is_that_of_the_metrics(
    honest: dict[str, Path], tmp_path: Path
) -> None:
    lie = Lie("dt is open", setting("robot", "dt", "auto"), ())
    result = open_evidence(edited(honest["paper"], tmp_path / "open", lie))
    wrong = [finding.claim for finding in findings(result) if not finding.holds]
    assert wrong == ["run: fingerprint of the settings", "page: all texts"]  # which shows the settings


@pytest.mark.parametrize("runs", [20, 300])
def test_a_promise_of_few_flights_holds(runs: int, tmp_path: Path) -> None:
    """Few flights with no failure among them: the promise is computed from weighted ones in any case."""
    small = SMALL | {"selection": {"draws": 200, "runs": runs}, "deployment": {"runs": 100}}
    small |= {"refine": {"flights": 100, "sweep_flights": 40, "classes": 1, "points": 3}}
    made = pareto_ltl.plan("phi1", "F a", fidelity="full", out=tmp_path / "few", **small)
    assert [finding.claim for finding in verify(tmp_path / "few") if not finding.holds] == []
    assert made.plan.promise is not None
