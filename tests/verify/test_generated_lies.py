"""Lies that Hypothesis makes: one fact of a result is another, in every record that states it.

At night, and with ``PARETO_LTL_LIES=CASES``, they are other ones every day: ``PARETO_LTL_LIES_SEED`` repeats
those of a day.
"""

from __future__ import annotations

import os
import re
import shutil
from datetime import UTC, datetime
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, Phase, given, note, seed, settings

from levels import AT_NIGHT
from lies.generated import CHANGES, EXPORTS, FILES, PAGE, Fact, facts, told
from pareto_ltl.support.errors import ParetoLtlError
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import CLAIMS, findings

ASKED = os.environ.get("PARETO_LTL_LIES")
CASES = int(ASKED) if ASKED else 300 if AT_NIGHT else 40
FRESH = AT_NIGHT or ASKED is not None
SEED = os.environ.get("PARETO_LTL_LIES_SEED", datetime.now(UTC).date().isoformat() if FRESH else "0")
NEW_FLIGHTS = frozenset({  # claims that need many new flights are judged last
    "plan: prices of its limits", "plan: promised rate", "front: flights that fail together",
    "front: failure rates of new flights", "front: V and R of its paths", "trees: risks of vertices",
    *(f"{law}: {name}" for law in ("independent", "coherent")
      for name in ("positions of the flights", "failure rate of new flights", "R of the controls")),
})  # fmt: skip
ORDER = sorted(CLAIMS, key=lambda claim: claim.name in NEW_FLIGHTS)
PASSING = {
    r"report\.html: (paths/#/(log|spread|risk|label|utc)|wind|automaton|vehicle).*": (
        "the page: winds, ellipses, logs and risks of points, and the drawing of the automaton"
    ),
    r"report\.html: (map/(earthly|exported)|points/\*/costs|paths/#/(line|t)|pricedObstacles).*": (
        "the page: rounded numbers and what the script draws"
    ),
    r"report\.html: (flights/(at|why)|causes|schema).*": "the page: what its script draws",
    r"run\.json: (pid|host|folder|threads|argv|overrides|python|packages|started|finished|version|git).*": (
        "where, when and with which packages the run was made"
    ),
    r"(run|metrics)\.json: (seconds|memory_mib|growth|nodes_per_second|run_seconds).*": (
        "how long the run took"
    ),
    r"metrics\.json: gp_.*": "scores of the wind, which are compared between files only",
    r"front\.csv: \*/origin": "where the search began a path of the front, which only the search knows",
    r"front\.csv: \*/(mission_risk.*|collision_risk)": "V and R of six paths of the front are computed again",
    r"front\.npz: (path_#/(cov|u)|judged|reference|raw).*": "six paths of the front, and the search itself",
    r"trees\.npz: tree_#/(beta|causes|counts|risk).*": "the search, and risks of most vertices",
    r"deployments\.npz: .*/x.*": "one position among thousands: verdicts and distributions are judged",
    r"plan\.json: (prices|air|segments/\*/deviations).*": "prices and the air are known within limits",
    r"plan\.json: (schema|promise/linearity)": "the version of the file",
    r"mission\.plan: pareto_ltl/failure_by_position.*": "a rate is compared with new flights",
    r"corridor\.geojson: .*/flights": "how many flights gave a corridor its size",
}  # facts by file and kind, and why no reader of the files finds them; docs/verify.md has the same reasons


SETTINGS = {
    r"(ingest|evaluation|compare|convergence|ablation|hindcast|forecast_test|departure|levels|replanning|sitl"
    r"|sweep)/.*": "settings of other commands",
    r"scene/name": "a name that no other file has",
    r"scene/simplify": "no outline was moved, and none would be with the other limit",
    r"scene/random/(seed|radius/\*|gap)": "no place of the map is drawn at random",
    r"robot/fix_(sd|time)": "the map has no landmarks",
    r"branch/.*": "the plan has no branches, as one for which none is worth it",
    r"robot/effort_risk": "flights judge, and no airspeed is reserved",
    r"robot/power/(blade|lifting|tip|wake)": "the power curve of a rotor, and the aircraft has wings",
    r"wind/(noise_min|max_points|max_speed)": "limits, which the readings keep with the other value too",
    r"wind/(spacing|modes_spacing)": "a map of this size has the same lattice with the other value",
    r"wind/energy": "as many modes as wind.modes_max allows, with either share",
    r"wind/holdout": "the readings that were held out are not in the files",
    r"wind/(model|cycle|hours|members|gefs_members|offline|retries)": "live winds",
    r"wind/ensemble_prior": "ensembles",
    r"wind/cache": "where the table of the wind came from",
    r"logic/max_states": "a limit, which the automaton keeps with the other value too",
    r"planner/(n_max|max_seconds|max_steps)": "limits, which trees and plan keep with the other value too",
    r"planner/(epsilon_strict|delta|near|beta_risk|beta_length|explore|refresh)": "growth of the trees",
    r"planner/threads": "the trees are the same with any number of threads",
    r"(smoothing|refine)/.*": "where and how long the search looks for paths",
    r"selection/(saving|least|point|examined)": "the rule of this result does not read it",
    r"exports/(files|formats/\*|flights)": "which files a run writes; each that is there is compared",
    r"report/(figures|page|formats/\*|dpi|paths|trees)": "which figures a run draws",
}  # config_resolved.yaml: single settings, and why another value may pass
PASSING |= {rf"config_resolved\.yaml: {kind}": why for kind, why in SETTINGS.items()}


def reason(fact: Fact) -> str:
    """Why another value of this fact may pass; empty if it may not."""
    named = f"{fact.file}: {fact.kind}"
    return next((why for pattern, why in PASSING.items() if re.fullmatch(pattern, named)), "")


def caught_by(place: Path, file: str) -> str:
    """The first claim that a falsified result breaks; empty if all hold that the file concerns."""
    try:
        result = open_evidence(place)
    except ParetoLtlError as error:
        return f"refused: {error}"
    own = [claim for claim in ORDER if file in claim.needs]
    others = [] if file in (*EXPORTS, PAGE) else [claim for claim in ORDER if claim not in own]
    order = sorted((*own, *others), key=lambda claim: claim.name in NEW_FLIGHTS)
    return next((found.claim for found in findings(result, order) if not found.holds), "")


@seed(SEED)
@settings(
    max_examples=CASES, deadline=None, phases=[Phase.generate], derandomize=False, database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)  # fmt: skip
@given(data=st.data())
def test_a_generated_lie_is_caught_or_listed(
    honest: dict[str, Path], tmp_path: Path, data: st.DataObject
) -> None:
    result = honest["full"]
    file = data.draw(st.sampled_from(FILES))
    known = facts(result, file)
    kind = data.draw(st.sampled_from(sorted(known)))
    fact, change = data.draw(st.sampled_from(known[kind])), data.draw(st.sampled_from(sorted(CHANGES)))
    copy = tmp_path / "lie"
    shutil.rmtree(copy, ignore_errors=True)
    if reason(fact) or told(result, copy, fact, change) is None:
        return
    note(f"{file}: {fact.place} is not {fact.value!r} but {change}")
    assert caught_by(copy, file), f"{file}: {kind} ({change}) passes; PARETO_LTL_LIES_SEED={SEED}"


@pytest.mark.parametrize(
    ("file", "kind", "change"),
    [("front.npz", "path_#/x/*", "one more"), ("plan.json", "promise/claimed/method", "half")],
)
def test_a_lie_that_once_passed_is_caught(
    file: str, kind: str, change: str, honest: dict[str, Path], tmp_path: Path
) -> None:
    known = facts(honest["full"], file)[kind]
    fact, copy = known[len(known) // 2], tmp_path / "lie"
    assert told(honest["full"], copy, fact, change) is not None
    assert caught_by(copy, file)
