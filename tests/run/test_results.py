"""Results on disk: whole files, the same bytes for the same records, and back again without loss."""

from __future__ import annotations

import csv
import json
import math
import struct
import zipfile
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from careful_io.archives import read_npz
from careful_io.files import whole_file, write_json, write_npz
from careful_io.reading import read_json
from flight_quantities.frames import local_plane
from pareto_ltl.logic import Automaton, translate
from pareto_ltl.planning import plan_files
from pareto_ltl.planning.plan_files import NAVIGATION_KEYS
from pareto_ltl.planning.rates import FailureRate, Promise
from pareto_ltl.planning.records import Forest, Front, Objectives, Plan, PlannedPath, Tree
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings import preset
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
EAST = np.array([1.0, 0.0])


def same(a: Any, b: Any) -> bool:
    """Equality of records down to the last bit of their arrays; NaN equals NaN."""
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return bool(a == b) or (isinstance(a, float) and math.isnan(a) and math.isnan(b))


def flight(steps: int = 4, seed: int = 1) -> PlannedPath:
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(steps + 1, 2, 2))
    return PlannedPath(
        t=1800.0 * np.arange(steps + 1),
        x=rng.normal(scale=1e5, size=(steps + 1, 2)),
        cov=half @ half.transpose(0, 2, 1),
        q=np.arange(steps + 1),
        label=(frozenset(),) * steps + (frozenset({"b", "a"}),),
        u=rng.normal(size=(steps, 2)),
        objectives=Objectives({"length": 1234567.891}, 1e-17, 0.1 + 0.2, 0.0, 0.7),
        origin="tree 3 vertex 1207",
        order="a>a+b",
    )


def rate(failures: int = 300, runs: int = 2000) -> FailureRate:
    return FailureRate("coherent", failures / runs, 0.13, 0.17, runs)


def bounded_front() -> Front:
    """The front of judge=bound."""
    paths = (flight(4, 1), replace(flight(6, 2), origin='smoothed, "weight" 100', order="", fixes=(2, 5)))
    return Front(paths, (paths[0].objectives,), 0.5, np.array([1.0, 1.0, 3e6]), models=preset("paper"))


def flown_front() -> Front:
    """The front of judge=flights."""
    failed = np.random.default_rng(4).random((2, 2000)) < 0.15
    models = replace(preset("full"), collision_bound="step")
    return replace(
        bounded_front(), reference=np.array([1.0, 3e6]), rates=(rate(300), rate(310)), failed=failed,
        raw_rates=(rate(80, 500),), models=models,
    )  # fmt: skip


def plan() -> Plan:
    """A plan on a plane without position on Earth."""
    flown = flight()
    return Plan(
        flown, "F(a & F b)", ("a", "b"), 1800.0, 30.0, 0.05, "paper", "weighted", (0.5, 0.25, 0.25),
        navigation=scene().frame.navigation(flown.t, flown.x, flown.u),
    )  # fmt: skip


def promised_plan() -> Plan:
    """A plan on Earth that its promise does not pass."""
    on_earth = replace(scene(), crs=local_plane(37.0, -92.0), time_zero=None)
    flown = replace(flight(), fixes=(1, 3))
    flown.u[2] = 0.0  # no heading
    return replace(
        plan(), path=flown, rule="threshold", rule_settings={"alpha": 0.02},
        fidelity="full with collision_bound=step",
        promise=Promise(rate(), rate(560, 4000), 0.1 + 0.2, 0.2, False),
        navigation=on_earth.frame.navigation(flown.t, flown.x, flown.u),
    )  # fmt: skip


def tree(seed: int, nodes: int = 5) -> Tree:
    rng = np.random.default_rng(seed)
    return Tree(
        x=rng.normal(size=(nodes, 2)),
        parent=np.arange(-1, nodes - 1),
        step=np.arange(nodes),
        q=np.zeros(nodes, np.int64),
        cell=np.ones(nodes, np.int64),
        length=rng.random(nodes),
        risk=rng.random((nodes, 2)),
        swaps=rng.random((3, 2, 4)),
        beta=rng.random(2),
        seconds=math.nan,
        reach={"blocked": 3.0, "extensions": 17.0},
    )


def forest() -> Forest:
    return Forest(tuple(tree(seed) for seed in range(12)), np.array([[0, 4], [11, 2]]), math.nan)


def deployments() -> dict[str, Deployment]:
    rng = np.random.default_rng(2)
    x = rng.normal(size=(7, 5, 2))
    return {
        law: Deployment(
            law, x, *(rng.random(7) < share for share in (0.5, 0.1, 0.3)), walled=law == "coherent"
        )
        for law in ("coherent", "independent")
    }


def decomposition() -> Decomposition:
    return Decomposition(
        cells=(SQUARE, SQUARE + EAST),
        labels=(frozenset({"b", "a"}), frozenset()),
        doors=np.array([[0, 1]]),
        obstacles=(SQUARE + 3 * EAST,),
        regions={"a": (SQUARE,), "b": (SQUARE,)},
    )


def automaton() -> Automaton:
    return translate("!c U (a & F b)", [(), ("a",), ("b",), ("c",)])


def scene() -> Scene:
    return Scene(
        bounds=np.array([[0.0, 0.0], [4.0, 1.0]]),
        start=np.array([0.1, 1 / 3]),
        regions={"a": SQUARE, "b": SQUARE},
        obstacles=(SQUARE + 3 * EAST,),
        crs=None,
        time_zero="2018-10-09T00:00:00Z",
    )


RECORDS = {
    "scene": scene,
    "decomposition": decomposition,
    "automaton": automaton,
    "forest": forest,
    "front": flown_front,
    "plan": promised_plan,
    "deployment": deployments,
}
ROWS = {row.stage: row for row in Run.rows().values()}
FILES = {
    "scene": "scene.json",
    "decomposition": "cells.json",
    "automaton": "automaton.json",
    "forest": "trees.npz",
    "plan": "plan.json",
    "deployment": "deployments.npz",
}


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_comes_back_bit_by_bit(name: str, tmp_path: Path) -> None:
    make, read = RECORDS[name], ROWS[name].load
    ROWS[name].save(tmp_path, make())
    assert same(read(tmp_path), make())
    if name in FILES:
        assert same(read(tmp_path / FILES[name]), make())


def test_a_plan_without_promise_and_place_on_earth_comes_back(tmp_path: Path) -> None:
    plan_files.write_plan(tmp_path, plan())
    assert same(plan_files.read_plan(tmp_path), plan())


def test_a_front_that_bounds_judge_comes_back(tmp_path: Path) -> None:
    plan_files.write_front(tmp_path, bounded_front())
    assert same(plan_files.read_front(tmp_path), bounded_front())
    empty = Front((), (), 0.0, np.ones(3), models=preset("paper"))
    plan_files.write_front(tmp_path, empty)
    assert same(plan_files.read_front(tmp_path), empty)


def test_files_that_hold_other_numbers_of_paths_are_no_front(tmp_path: Path) -> None:
    plan_files.write_front(tmp_path, flown_front())
    table = tmp_path / "front.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    with pytest.raises(DataError, match=r"front\.npz: not a front \(it holds 2 paths, and front\.csv 1\)"):
        plan_files.read_front(tmp_path)


@pytest.mark.parametrize(
    ("name", "array", "words"),
    [
        ("path_001/x", np.zeros((5, 2)), "path_001/x must have shape"),
        ("path_000/u", np.zeros((5, 2)), "path_000/u must have shape"),
        ("failed", np.zeros((3, 2000), bool), "2 rates need flights as rows"),
        ("fidelity", np.array(["best"]), "'best' is not a label of a fidelity"),
    ],
)
def test_an_archive_that_is_no_front_is_refused(name: str, array: Any, words: str, tmp_path: Path) -> None:
    plan_files.write_front(tmp_path, flown_front())
    write_npz(tmp_path / "front.npz", read_npz(tmp_path / "front.npz") | {name: array})
    with pytest.raises(DataError, match=words):
        plan_files.read_front(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (",0.15,", ",0.99,", "0 <= low <= failure <= high <= 1"),
        (",0.15,", ",x,", "could not convert"),
        (",2000,", ",0,", "at least one flight"),
        ("failure_low", "low", "failure_low' is missing"),
    ],
)
def test_a_table_that_is_no_front_is_refused(old: str, new: str, words: str, tmp_path: Path) -> None:
    plan_files.write_front(tmp_path, flown_front())
    table = tmp_path / "front.csv"
    table.write_text(table.read_text().replace(old, new, 1))
    with pytest.raises(DataError, match=rf"front\.csv: not a front \(.*{words}"):
        plan_files.read_front(tmp_path)


def test_a_plan_of_the_first_schema_is_read(tmp_path: Path) -> None:
    """As runs of version 0.2 wrote it, with its check by flights, which is no promise."""
    plan_files.write_plan(tmp_path, promised_plan())
    content = json.loads((tmp_path / "plan.json").read_text())
    for key in ("models", "promise", "order", *NAVIGATION_KEYS):
        del content[key]
    del content["selection"]["alpha"]
    content["acceptance"] = {
        "bound": 0.1, "estimate": None, "runs": 2000, "failures": 300, "low": 0.13, "high": 0.17,
        "passed": False, "linearity": 0.2,
    }  # fmt: skip
    write_json(tmp_path / "plan.json", content | {"schema": "pareto_ltl.plan/1"})
    made = promised_plan()
    old = replace(made, promise=None, navigation=None, rule_settings={}, path=replace(made.path, order=""))
    assert same(plan_files.read_plan(tmp_path), old)


@pytest.mark.parametrize("name", RECORDS)
def test_the_same_record_gives_the_same_bytes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make = RECORDS[name]
    ROWS[name].save(tmp_path, make())
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr("time.time", lambda: 2e9)  # another day
    ROWS[name].save(tmp_path, make())
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == first


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("spoil", ["missing", "cut", "foreign"])
def test_a_spoilt_file_is_named_in_one_line(name: str, spoil: str, tmp_path: Path) -> None:
    make, read = RECORDS[name], ROWS[name].load
    ROWS[name].save(tmp_path, make())
    path = tmp_path / FILES[name]
    if spoil == "missing":
        path.unlink()
    elif spoil == "cut":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    elif path.suffix == ".json":
        path.write_text('{"schema": "pareto_ltl.plan/2", "something": "else"}')
    else:
        write_npz(path, {"some/thing": np.zeros(3)})
    with pytest.raises(DataError) as caught:
        read(tmp_path)
    assert "\n" not in str(caught.value)
    assert name == "scene" or FILES[name] in str(caught.value)


@pytest.mark.parametrize(
    ("name", "array", "words"),
    [
        ("parent", np.array([-1, 2, 1, 0, 0]), "a vertex of tree_003 does not come after its parent"),
        ("x", np.zeros((5, 3)), "tree_003/x must have shape"),
        ("q", np.zeros(4, np.int64), "tree_003/q must have shape"),
    ],
)
def test_a_tree_that_no_growth_makes_is_refused(name: str, array: Any, words: str, tmp_path: Path) -> None:
    plan_files.write_forest(tmp_path, forest())
    arrays = read_npz(tmp_path / "trees.npz")
    write_npz(tmp_path / "trees.npz", arrays | {f"tree_003/{name}": array})
    with pytest.raises(DataError, match=words):
        plan_files.read_forest(tmp_path)


def test_a_plan_of_another_schema_is_refused_by_name(tmp_path: Path) -> None:
    plan_files.write_plan(tmp_path, plan())
    path = tmp_path / "plan.json"
    path.write_text(path.read_text().replace("pareto_ltl.plan/2", "pareto_ltl.plan/9"))
    known = "'pareto_ltl.plan/2' or 'pareto_ltl.plan/3' or 'pareto_ltl.plan/1'"
    with pytest.raises(DataError, match=f'expected schema {known}, found "pareto_ltl.plan/9"'):
        plan_files.read_plan(path)


def test_a_plan_with_a_row_too_few_is_refused(tmp_path: Path) -> None:
    plan_files.write_plan(tmp_path, plan())
    content = json.loads((tmp_path / "plan.json").read_text())
    content["u"].pop()
    (tmp_path / "plan.json").write_text(json.dumps(content))
    with pytest.raises(DataError, match=r"u must have shape \(4, 2\), got \(3, 2\)"):
        plan_files.read_plan(tmp_path)


def test_the_plan_has_the_keys_of_its_contract(tmp_path: Path) -> None:
    plan_files.write_plan(tmp_path, plan())
    content = json.loads((tmp_path / "plan.json").read_text())
    assert content["schema"] == "pareto_ltl.plan/2"
    wanted = (
        "formula atoms dt u_min u_max epsilon fidelity t x cov q label u objectives selection models crs "
        "time_utc lat lon heading_true airspeed promise order covered not_covered origin fixes"
    )
    assert set(wanted.split()) <= set(content)
    assert content["objectives"].keys() == {
        "length", "mission_risk_paper", "mission_risk", "collision_risk", "mission_risk_ordered",
    }  # fmt: skip
    assert content["selection"] == {"rule": "weighted", "weights": [0.5, 0.25, 0.25]}
    assert content["label"][-1] == ["a", "b"]


def test_the_table_of_a_plan_says_the_same_as_its_json(tmp_path: Path) -> None:
    plan_files.write_plan(tmp_path, plan())
    rows = list(csv.DictReader((tmp_path / "plan.csv").read_text().splitlines()))
    path = plan().path
    np.testing.assert_array_equal([[float(r["x_m"]), float(r["y_m"])] for r in rows], path.x)
    np.testing.assert_array_equal([[float(r["u_x_m_s"]), float(r["u_y_m_s"])] for r in rows[:-1]], path.u)
    np.testing.assert_array_equal([float(r["cov_xy"]) for r in rows], path.cov[:, 0, 1])
    assert rows[-1]["u_x_m_s"] == ""
    assert rows[-1]["label"] == "a b"


def test_a_promise_says_what_it_was_held_against(tmp_path: Path) -> None:
    plan_files.write_plan(tmp_path, promised_plan())
    content = json.loads((tmp_path / "plan.json").read_text())
    assert content["promise"] == {
        "law": "coherent", "failure": 0.15, "low": 0.13, "high": 0.17, "runs": 2000, "method": "flights",
        "claimed": {
            "law": "coherent", "failure": 0.14, "low": 0.13, "high": 0.17, "runs": 4000,
            "method": "flights",
        },
        "bound": 0.1 + 0.2, "linearity": 0.2, "passed": False,
    }  # fmt: skip
    assert content["selection"] == {"rule": "threshold", "weights": [0.5, 0.25, 0.25], "alpha": 0.02}
    assert content["models"]["collision_bound"] == "step"
    assert content["heading_true"][2] is None
    assert content["airspeed"][2] == 0.0


def test_the_front_lists_every_path_with_its_rate_and_costs(tmp_path: Path) -> None:
    plan_files.write_front(tmp_path, flown_front())
    rows = list(csv.DictReader((tmp_path / "front.csv").read_text().splitlines()))
    assert list(rows[0]) == [
        "path", "failure", "failure_low", "failure_high", "law", "runs", "length_m", "mission_risk",
        "collision_risk", "mission_risk_ordered", "mission_risk_paper", "steps", "duration_s", "order",
        "origin",
    ]  # fmt: skip
    assert [row["steps"] for row in rows] == ["4", "6"]
    assert [(row["failure"], row["failure_low"], row["law"], row["runs"]) for row in rows] == [
        ("0.15", "0.13", "coherent", "2000"), ("0.155", "0.13", "coherent", "2000"),
    ]  # fmt: skip
    assert [row["order"] for row in rows] == ["a>a+b", ""]
    plan_files.write_front(tmp_path, bounded_front())
    rows = list(csv.DictReader((tmp_path / "front.csv").read_text().splitlines()))
    assert {
        row[name] for row in rows for name in ("failure", "failure_low", "failure_high", "law", "runs")
    } == {""}


def test_a_front_with_an_endless_field_is_refused(tmp_path: Path) -> None:
    plan_files.write_front(tmp_path, flown_front())
    (tmp_path / "front.csv").write_text('"' + "x" * 200_000)
    with pytest.raises(DataError, match=r"front\.csv: not a front \(field larger than"):
        plan_files.read_front(tmp_path)


def test_numbers_that_json_lacks_become_null(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"x": math.nan, "y": [math.inf, 1.0], "z": np.array([np.nan, 2.0])})
    assert json.loads((tmp_path / "a.json").read_text()) == {"x": None, "y": [None, 1.0], "z": [None, 2.0]}
    assert "NaN" not in (tmp_path / "a.json").read_text()


@given(numbers=st.lists(st.floats(allow_nan=False, allow_infinity=False)))
def test_json_keeps_every_digit_of_a_number(
    numbers: list[float], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "numbers.json"
    write_json(path, {"numbers": np.array(numbers, float)})
    back = read_json(path)["numbers"]
    assert [struct.pack("d", n) for n in back] == [struct.pack("d", n) for n in numbers]


@given(
    array=hnp.arrays(
        st.sampled_from([np.float64, np.int64, np.bool_]),
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0),
    )
)
def test_archives_are_what_numpy_reads(array: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "arrays.npz"
    write_npz(path, {"b/second": array, "a": np.arange(3)})
    with np.load(path) as archive:
        assert archive.files == ["a", "b/second"]
        np.testing.assert_array_equal(archive["b/second"], array)
    with zipfile.ZipFile(path) as zipped:
        assert {entry.date_time for entry in zipped.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_order_of_arrays_does_not_change_an_archive(tmp_path: Path) -> None:
    a, b = np.arange(3), np.eye(2)
    write_npz(tmp_path / "one.npz", {"a": a, "b": b})
    write_npz(tmp_path / "two.npz", {"b": b, "a": a})
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


def _write_half(path: Path) -> None:
    with whole_file(path) as draft:
        draft.write_text("half of ")
        raise TypeError


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"x": 1})
    with pytest.raises(TypeError):
        write_json(tmp_path / "a.json", {"x": object()})
    with pytest.raises(TypeError):
        _write_half(tmp_path / "a.json")
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
    assert read_json(tmp_path / "a.json") == {"x": 1}


def test_a_run_is_done_when_its_status_says_so_and_its_metrics_are_there(tmp_path: Path) -> None:
    (tmp_path / "config_resolved.yaml").write_text("name: one\n")
    write_json(tmp_path / "run.json", {"status": "running"})
    results = Run.open(tmp_path)
    assert not results.done
    write_json(tmp_path / "run.json", {"status": "ok"})
    assert not results.done
    write_json(tmp_path / "metrics.json", {"completed": 1.0, "gp_z_sd": math.nan})
    assert results.done
    assert results.metrics["completed"] == 1.0
    assert math.isnan(results.metrics["gp_z_sd"])
