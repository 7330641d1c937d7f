"""Paths from a file that are judged with the paths of a run."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from careful_io.files import write_npz
from pareto_ltl.planning.plan_files import read_extra_paths
from pareto_ltl.planning.problem import Problem
from pareto_ltl.run.front_stage import extra_paths
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.studies.departure_table import write_extra_paths
from problems import KM, box, make_problem, make_scene


@pytest.fixture(scope="module")
def problem() -> Problem:
    return make_problem("F a", make_scene({"a": box(5, 1, 9, 5)}, [], start=(2.0, 3.0)))


def straight(length: float) -> FloatArray:
    """A path of ``length`` [km] to the east, at 5 m/s."""
    return np.column_stack([2.0 + np.arange(0.0, length + 0.1, 0.5), np.full(int(2 * length) + 1, 3.0)]) * KM


def test_extra_paths_are_evaluated_as_any_other(problem: Problem, tmp_path: Path) -> None:
    file = tmp_path / "extra_paths.npz"
    write_extra_paths(file, [("tree 3 vertex 7", straight(5.0)), ("smoothed", straight(6.0))])
    paths = extra_paths(str(file), problem)
    assert [path.origin for path in paths] == ["tree 3 vertex 7", "smoothed"]
    assert [path.objectives.length for path in paths] == pytest.approx([5000.0, 6000.0])
    np.testing.assert_array_equal(paths[1].x, straight(6.0))
    assert extra_paths(None, problem) == ()


def test_a_front_of_another_run_is_read_by_its_positions(tmp_path: Path) -> None:
    write_npz(tmp_path / "front.npz", {"path_000/x": straight(5.0), "path_000/u": np.zeros((10, 2))})
    ((origin, x),) = read_extra_paths(tmp_path)
    assert origin == "extra path 0"
    np.testing.assert_array_equal(x, straight(5.0))


@pytest.mark.parametrize(
    ("x", "reason"),
    [
        (straight(2.0), "does not complete the mission: at its end a is still to be visited"),
        (straight(5.0)[::5], "needs more airspeed than robot.u_max"),
    ],
)
def test_a_path_that_cannot_be_flown_is_named_in_a_warning(
    x: FloatArray, reason: str, problem: Problem, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "extra_paths.npz"
    write_extra_paths(file, [("by hand", x), ("good", straight(5.0))])
    with caplog.at_level(logging.WARNING):
        assert [path.origin for path in extra_paths(str(file), problem)] == ["good"]
    assert "by hand of selection.extra_paths is left out" in caplog.text
    assert reason in caplog.text


@pytest.mark.parametrize(
    "arrays",
    [
        {"path_001/x": straight(5.0)},
        {"path_000/x": np.zeros((3, 3))},
        {"path_000/x": np.zeros((1, 2))},
        {"path_000/x": np.full((3, 2), np.nan)},
        {"path_000/x": np.array(["a", "b"])},
        {"path_000/x": straight(5.0), "path_000/origin": np.array(["a", "b"])},
    ],
)
def test_a_file_without_paths_is_refused_in_one_line(arrays: dict[str, FloatArray], tmp_path: Path) -> None:
    write_npz(tmp_path / "front.npz", arrays)
    with pytest.raises(DataError, match=r"front\.npz: not paths of a front"):
        read_extra_paths(tmp_path)
