"""The statistics and tables of the comparison with peers (benchmarks/peers); no peer is needed."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

from pareto_ltl.world.scene import Scene
from peers import in_our_front, ratios, tables
from peers.channel import missing
from problems import box

INF = float("inf")


def test_a_ratio_of_proportional_figures_is_exact():
    ours = [3.0, 1.0, 2.0, 5.0, 4.0]
    assert ratios.median_ratio(ours, [2 * value for value in ours]) == (2.0, 2.0, 2.0)


def test_an_interval_holds_the_true_ratio_in_about_95_of_100_experiments():
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        day = rng.lognormal(0.0, 0.5, 21)  # slows both sides
        ours, theirs = day * rng.lognormal(0.0, 0.2, 21), 3.0 * day * rng.lognormal(0.0, 0.2, 21)
        ratio = ratios.median_ratio(ours, theirs)
        assert ratio.low <= ratio.value <= ratio.high
        held += ratio.low <= 3.0 <= ratio.high
    assert held >= 178  # 190 expected; the bootstrap of medians holds a little more often


def test_an_interval_does_not_change_from_run_to_run():
    figures = np.random.default_rng(2).random((2, 12))
    assert ratios.median_ratio(*figures) == ratios.median_ratio(*figures)


def test_runs_without_a_result_count_as_infinite():
    ratio = ratios.median_ratio([1.0, 1.0, 1.0], [2.0, INF, 2.0])
    assert ratio.value == 2.0
    assert ratio.high == INF
    assert ratios.median([1.0, INF, INF]) == INF
    assert ratios.median_ratio([INF, INF], [INF, INF]) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(("ours", "theirs"), [([], []), ([1.0], [1.0, 2.0])])
def test_figures_that_are_not_in_pairs_are_refused(ours, theirs):
    with pytest.raises(ValueError, match="as many figures"):
        ratios.median_ratio(ours, theirs)


def plan(grown: float, planned: float) -> dict[str, float]:
    times = {"grown": grown, "planned": planned}
    return times | {"grown_length": 2300.0, "planned_length": 1700.0, "vertices": 25_000}


LEG = {"cpu": 0.5, "vertices": 10_000, "checks": 250_000, "length": 1800.0}
DATA = {
    "date": "2026-01-02",
    "repeats": 2,
    "machine": {"processor": "a processor", "cores": 2, "system": "Linux x86_64"},
    "versions": {"ompl": "2.0.1"},
    "missions": {
        "phi1": {
            "first": [0.002, 0.002],
            "plan": [plan(0.1, 0.4), plan(0.1, 0.4)],
            "check_seconds": 1e-6,
            "ompl": {
                "RRT*": {
                    "first": [{**LEG, "cpu": 0.001}] * 2,
                    "budgets": [{"0.1": {**LEG, "length": None}, "0.5": LEG}] * 2,
                }
            },
            "drake": [{"length": 17.0, "build": 0.1, "solve": 0.9, "sets": 123}] * 2,
        }
    },
    "logic": {
        "six keys": {"states": 730, "ours": [0.02, 0.02], "through": [0.1, 0.1], "alone": [0.01, 0.01]}
    },
}


def row_of(text: str, figure: str, peer: str) -> list[str]:
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    (row,) = [line for line in lines if line[1] == figure and line[3] == peer]
    return row


def test_the_table_is_made_from_the_figures_alone():
    text = tables.markdown(json.loads(json.dumps(DATA)))
    assert text.startswith("2026-01-02, a processor, 2 cores")
    assert row_of(text, "first path [CPU ms]", "OMPL RRT*") == [
        "phi1", "first path [CPU ms]", "2.00", "OMPL RRT*", "1.00", "0.5 (0.5 to 0.5)"
    ]  # fmt: skip
    speed = row_of(text, "thousand vertices per CPU second", "OMPL RRT*")
    assert speed[2:] == ["250.0", "OMPL RRT*", "20.0", "12.5 (12.5 to 12.5)"]
    free = row_of(text, "the same", "OMPL RRT*, without collision tests")
    assert free[4:] == ["40.0", "6.25 (6.25 to 6.25)"]
    assert row_of(text, "plan [CPU s]", "Drake GCS, 123 sets")[2:] == [
        "0.40", "Drake GCS, 123 sets", "1.00", "2.5 (2.5 to 2.5)"
    ]  # fmt: skip
    assert row_of(text, "its length [km]", "Drake GCS")[4:] == ["1,700.0", "1 (1 to 1)"]
    assert row_of(text, "automaton [CPU ms]", "MONA alone")[4:] == ["10.0", "0.5 (0.5 to 0.5)"]


def test_after_a_budget_stands_what_was_there_by_then():
    text = tables.markdown(DATA)
    early, late = (row_of(text, f"length after {s} CPU s [km]", "OMPL RRT*") for s in (0.1, 0.5))
    assert early[2] == "2,300.0"  # the trees alone
    assert early[4] == "none"
    assert late[2:5] == ["1,700.0", "OMPL RRT*", "1,800.0"]
    assert tables.length_after(0.05, plan(0.1, 0.4)) == INF


def test_peers_that_are_missing_leave_no_rows():
    data = copy.deepcopy(DATA)
    data["missions"]["phi1"] |= {"drake": [], "ompl": {"RRT*": {"first": [], "budgets": []}}}
    data["logic"]["six keys"] |= {"through": [], "alone": []}
    assert len(tables.markdown(data).splitlines()) == 1


def test_the_module_prints_the_table_of_a_file(tmp_path: Path):
    file = tmp_path / "peers.json"
    file.write_text(json.dumps(DATA))
    folder = Path(tables.__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-m", "peers.tables", file], cwd=folder, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == tables.markdown(DATA)


def test_a_missing_peer_is_named_with_what_to_install(tmp_path: Path):
    told = missing("drake", tmp_path)
    assert told is not None
    assert "make build/peers/drake" in told
    assert "\n" not in told


# --- paths of peers in our front ----------------------------------------------------------------


def map_with(obstacle: np.ndarray, border: str = "open") -> Scene:
    region = box(14, 14, 18, 18)
    return Scene(
        np.array([[0.0, 0.0], [20e3, 20e3]]), np.array([2e3, 2e3]), {"a": region}, (obstacle,), border=border
    )


def test_obstacles_are_wider_and_regions_smaller_by_the_buffer():
    scene = in_our_front.buffered(map_with(box(8, 8, 11, 11)), 500.0)
    (wide,), (small,) = scene.obstacles, scene.regions["a"]
    assert shapely.Polygon(wide).equals(shapely.box(7.5e3, 7.5e3, 11.5e3, 11.5e3))
    assert shapely.Polygon(small).equals(shapely.box(14.5e3, 14.5e3, 17.5e3, 17.5e3))
    np.testing.assert_array_equal(scene.bounds, [[0.0, 0.0], [20e3, 20e3]])


def test_a_wide_buffer_leaves_the_start_and_something_of_each_region():
    scene = in_our_front.buffered(map_with(box(2.5, 1, 5, 4), "wall"), 4000.0)
    assert all(not shapely.Polygon(one).intersects(shapely.Point(scene.start)) for one in scene.obstacles)
    assert (scene.bounds[0] < scene.start).all()
    left = shapely.Polygon(scene.regions["a"][0])
    assert shapely.box(14e3, 14e3, 18e3, 18e3).contains(left)
    assert left.area == pytest.approx(0.4e3**2)


def entry(
    buffer: float, length: float | None, failure: float | None, ours: float | None
) -> dict[str, object]:
    numbers = {"planner": "P", "buffer": buffer, "length": length, "failure": failure, "ours": ours}
    return numbers | {"epsilon_kept": failure is not None and failure < 0.3}


def test_the_table_of_peers_in_our_front_compares_paths_of_one_length():
    theirs = [
        entry(0.0, 90e3, 0.9, None), entry(1.0, 100e3, 0.2, 0.1), entry(1.5, None, None, None),
        entry(2.0, 120e3, None, None),
    ]  # fmt: skip
    case = {
        "mission": "m",
        "sd": 1.0,
        "orders": [["a"]],
        "ours": [[0.1, 95e3], [0.05, 130e3]],
        "theirs": theirs,
    }
    data = {
        "date": "2026-01-02", "commit": "abc", "machine": {"processor": "CPU"}, "versions": {"ompl": "2"},
        "runs": 1000, "missions": [case], "absent": ["drake"],
    }  # fmt: skip
    lines = in_our_front.markdown(data).splitlines()
    assert lines[0] == "2026-01-02, commit abc, CPU; ompl 2; 1,000 flights."
    assert "drake: not installed, left out." in lines
    cells = ["m", "95 to 130 km: 10 to 5 %", "P", "90 km: 90 / - %", "100 km: 20 / 10 %", "no path"]
    assert f"| {' | '.join([*cells, '120 km: cannot be flown'])} |" in lines
    assert any("1 are at least as long as our shortest path: they fail 2 times as often" in k for k in lines)


def test_without_any_peer_the_comparison_of_fronts_ends_with_one_line(tmp_path):
    folder = Path(__file__).parents[1] / "benchmarks"
    ended = subprocess.run(
        [sys.executable, "-m", "peers.in_our_front", "--environments", tmp_path], cwd=folder,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1] == "no peer is installed"
    assert "make build/peers/ompl" in ended.stderr
