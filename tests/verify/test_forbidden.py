"""A result whose mission forbids a region: the judge reads it between steps, and catches who does not."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import pareto_ltl
from lies.editing import holds, in_flights
from pareto_ltl.simulation.records import read_deployments
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.judge import verify
from quick_wind import QUICK_WIND

MISSION = "!s U a"
SCENE = {
    "name": "strip", "unit": 1e5, "centre": [37.0, -92.0], "bounds": [[0, 0], [10, 10]], "start": [1, 5],
    "regions": {"a": [[7, 4], [9, 4], [9, 6], [7, 6]], "s": [[4, 0], [4.2, 0], [4.2, 5.2], [4, 5.2]]},
}  # fmt: skip
SMALL = {
    "robot": {"dt": 1800.0},
    "planner": {"trees": 2, "n_max": 600, "max_steps": 60},
    "smoothing": {"candidates": 1, "weights": [1.0]},
    "wind": QUICK_WIND,
    "deployment": {"runs": 4000},
    "report": "none",
}


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan round a strip 20 km wide, in steps of up to 54 km."""
    place = tmp_path_factory.mktemp("forbidden") / "run"
    pareto_ltl.plan(
        SCENE, MISSION, fidelity="paper", selection={"rule": "threshold", "alpha": 0.9}, out=place, **SMALL
    )
    return place


def jumped(place: Path) -> np.ndarray:
    """Flights in coherent winds that the steps alone would call well: they met the strip between two."""
    ground, flights = open_evidence(place).ground, read_deployments(place)["coherent"]
    at_steps = np.array([ground.columns(x) for x in flights.x])
    strip = [k for k, letter in enumerate(ground.dfa.letters) if "s" in letter]
    reached = np.array([any("a" in ground.dfa.letters[c] for c in row) for row in at_steps])
    jumps: np.ndarray = ~flights.accepted & reached & ~np.isin(at_steps, strip).any(axis=1)
    return jumps


def test_an_honest_result_with_a_forbidden_region_passes(honest: Path) -> None:
    assert [finding for finding in verify(honest) if not finding.holds] == []
    assert jumped(honest).sum() > 10  # otherwise the lie below is none


def test_flights_that_jump_a_forbidden_strip_cannot_be_called_well(honest: Path, tmp_path: Path) -> None:
    shutil.copytree(honest, tmp_path / "lie")
    jumps = jumped(honest)
    in_flights("coherent", lambda f: f["coherent/accepted"].__setitem__(jumps, True))(tmp_path / "lie")
    assert not holds(tmp_path / "lie", "coherent: verdicts of the flights")
