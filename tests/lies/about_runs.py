"""False values in trees, front, flights and the run."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from careful_io.archives import read_npz
from careful_io.files import write_npz
from careful_io.reading import read_json
from lies.editing import (
    COSTS,
    Lie,
    both,
    counted,
    in_arrays,
    in_flights,
    in_front,
    in_json,
    in_metrics,
    setting,
)
from pareto_ltl_verify.claims.front import cost_columns, judged_rows, volume
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.flights import clopper_pearson


def _other_parent(trees: dict[str, NDArray[Any]]) -> None:
    trees["tree_000/parent"][20] = (trees["tree_000/parent"][20] + 1) % 20


def _accept_less(place: Path) -> None:
    in_arrays("trees.npz", lambda t: t.update(accepted=t["accepted"][1:]))(place)
    metrics = read_json(place / "metrics.json")
    in_metrics({"accepted_nodes": metrics["accepted_nodes"] - 1})(place)


def _other_risks(trees: dict[str, NDArray[Any]]) -> None:
    for j, v in trees["accepted"]:
        trees[f"tree_{j:03d}/risk"][v, 0] = 0.02 + 0.5 * trees[f"tree_{j:03d}/risk"][v, 0]


def _add_dominated(rows: list[dict[str, str]]) -> None:
    worse = {key: repr(1.1 * float(rows[-1][key])) for key in COSTS.values()}
    rows.append(rows[-1] | worse | {"path": str(len(rows))})


def _other_failures(place: Path) -> None:
    """Claim that a tenth of the flights of each path of the front fail, with the intervals of that rate."""
    in_arrays("front.npz", lambda arrays: arrays["failed"][:, ::10].fill(True))(place)
    failed = read_npz(place / "front.npz")["failed"]

    def count(rows: list[dict[str, str]]) -> None:
        for row, flights in zip(rows, failed, strict=True):
            low, high = clopper_pearson(int(flights.sum()), len(flights))
            row |= {
                "failure": repr(float(flights.mean())),
                "failure_low": repr(low),
                "failure_high": repr(high),
            }

    in_front(count)(place)


def _shuffled(arrays: dict[str, NDArray[Any]]) -> None:
    """The flights of each path in another order: as many fail, but no longer in the same winds."""
    rng = np.random.default_rng(3)
    arrays["failed"] = np.array([rng.permutation(flights) for flights in arrays["failed"]])


def _moved(arrays: dict[str, NDArray[Any]]) -> None:
    arrays["path_000/x"][4] += 3000.0


def _halved_bounds(rows: list[dict[str, str]]) -> None:
    for row in rows:
        row["mission_risk_ordered"] = repr(0.5 * float(row["mission_risk_ordered"]))


def _relabelled(rows: list[dict[str, str]]) -> None:
    rows[0]["order"] = "c>b>a"


def thinned(place: Path) -> None:
    """Every other path of the front but the plan is left out, in all files and numbers of the front."""
    plan, arrays = read_json(place / "plan.json"), read_npz(place / "front.npz")
    with (place / "front.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    x = np.array(plan["x"])
    kept = [k for k in range(len(rows)) if k % 2 == 0 or np.array_equal(arrays[f"path_{k:03d}/x"], x)]
    others = {key: value for key, value in arrays.items() if not key.startswith("path_")}
    others["failed"] = arrays["failed"][kept] if len(arrays["failed"]) else arrays["failed"]
    for new, old in enumerate(kept):
        begin = f"path_{old:03d}/"
        others |= {
            f"path_{new:03d}/{key.removeprefix(begin)}": value
            for key, value in arrays.items()
            if key.startswith(begin)
        }
    write_npz(place / "front.npz", others)
    left = [rows[k] | {"path": str(new)} for new, k in enumerate(kept)]
    in_front(lambda listed: listed.__setitem__(slice(None), left))(place)
    result = open_evidence(place)
    sides = cost_columns(result)
    table = judged_rows(result)
    top = np.ones(table.shape[1])
    top[-len(sides) :] = [result.metrics[f"hypervolume_{name}"] for name in sides]
    numbers = {
        "hypervolume": volume(np.minimum(table / top, 1.0)),
        "shortest_m": min(float(row["length_m"]) for row in left),
        "safest": min(float(row["mission_risk"]) for row in left),
    }
    if "least_failure" in result.metrics:
        numbers["least_failure"] = min(float(row["failure"]) for row in left)
    in_metrics(numbers)(place)


SEARCH_LIES = (
    Lie("every other path of the front is left out", thinned, ("front: no judged path is better",)),
    Lie(
        "a judged path failed more often",
        in_arrays("front.npz", lambda a: a["judged"].__setitem__((slice(None), 1), 9.0)),
        ("front: no judged path is better",),
    ),
    Lie(
        "a judged path is longer than the box",
        in_arrays("front.npz", lambda a: a["judged"].__setitem__((-1, -1), 1e9)),
        ("front: box of the hypervolume",),
    ),
    Lie(
        "a vertex is farther along",
        in_arrays("trees.npz", lambda t: t["tree_000/length"].__setitem__(9, 1.0)),
        ("trees: vertices follow their parents",),
    ),
    Lie(
        "a vertex is elsewhere",
        in_arrays("trees.npz", lambda t: t["tree_001/x"].__setitem__((7, 0), 0.0)),
        ("trees: vertices follow their parents",),
    ),
    Lie(
        "a parent is another",
        in_arrays("trees.npz", _other_parent),
        ("trees: vertices follow their parents",),
    ),
    Lie(
        "a state of a vertex is another",
        in_arrays("trees.npz", lambda t: t["tree_000/q"].__setitem__(9, 3)),
        ("trees: vertices follow their parents",),
    ),
    Lie(
        "a vertex is in a cell that there is not",
        in_arrays("trees.npz", lambda t: t["tree_000/cell"].__setitem__(9, -1)),
        ("trees: vertices follow their parents",),
    ),
    Lie("an accepted vertex is left out", _accept_less, ("trees: accepted vertices",)),
    Lie("risks of vertices are others", in_arrays("trees.npz", _other_risks), ("trees: risks of vertices",)),
    Lie("there are more vertices", in_metrics({"nodes": 10**6}), ("trees: numbers of vertices",)),
    Lie("a row of the front is gone", in_front(lambda rows: rows.pop()), ("front: hypervolume",)),
    Lie("a dominated row is added", in_front(_add_dominated), ("front: no path is dominated",)),
    Lie(
        "a row of the front is better",
        in_front(lambda rows: rows[-1].update(length_m="1e3")),
        ("front: hypervolume",),
    ),
    Lie("the hypervolume is larger", in_metrics({"hypervolume": 0.99}), ("front: hypervolume",)),
    Lie("other flights of the front fail", _other_failures, ("front: failure rates of new flights",), "full"),
    Lie(
        "flights of the front are shuffled",
        in_arrays("front.npz", _shuffled),
        ("front: flights that fail together",),
        "full",
    ),
    Lie("a number of the run is made up", in_metrics({"failure_estimated": 0.001}), ("metrics: names",)),
    Lie(
        "a rate of the front is lower",
        in_front(lambda rows: rows[-1].update(failure="0.01")),
        ("front: failure rates and intervals",),
        "full",
    ),
    Lie(
        "an interval of the front is narrower",
        in_front(lambda rows: rows[0].update(failure_high=rows[0]["failure"])),
        ("front: failure rates and intervals",),
        "full",
    ),
    Lie(
        "a rate of the front is made up",
        in_front(lambda rows: rows[0].update(failure="0.0", law="independent")),
        ("front: failure rates and intervals",),
        "paper",
    ),
    Lie("a path of the front leads elsewhere", in_arrays("front.npz", _moved), ("front: paths",)),
    Lie("a mission order is another", in_front(_relabelled), ("front: paths",)),
    Lie("V of the front is halved", in_front(_halved_bounds), ("front: V and R of its paths",)),
    Lie(
        "the plan is not on the front",
        in_front(lambda rows: [row.update(origin="elsewhere") for row in rows]),
        ("front: the plan is on it",),
    ),
)


FLIGHT_ARRAYS = ("x", "accepted", "collided", "off_map")


def _all_well(law: str) -> Callable[[dict[str, NDArray[Any]]], Any]:
    def change(flights: dict[str, NDArray[Any]]) -> None:
        flights[f"{law}/accepted"][:] = True
        flights[f"{law}/collided"][:] = False
        flights[f"{law}/off_map"][:] = False

    return change


def _blown(flights: dict[str, NDArray[Any]]) -> None:
    flights["independent/x"][:, 1:4] += 2000.0


def _steady(flights: dict[str, NDArray[Any]]) -> None:
    x = flights["coherent/x"]
    x[:] = x.mean(axis=0) + 0.5 * (x - x.mean(axis=0))


def _other_law(flights: dict[str, NDArray[Any]]) -> None:
    for name in FLIGHT_ARRAYS:
        flights[f"coherent/{name}"] = flights[f"independent/{name}"]


def _twice(flights: dict[str, NDArray[Any]]) -> None:
    for name in list(flights):
        if not name.endswith("walled"):
            flights[name] = np.concatenate([flights[name]] * 2)


def _survivors(flights: dict[str, NDArray[Any]]) -> None:
    well = flights["coherent/accepted"] & ~flights["coherent/collided"] & ~flights["coherent/off_map"]
    chosen = np.resize(np.flatnonzero(well), len(well))
    for name in FLIGHT_ARRAYS:
        flights[f"coherent/{name}"] = flights[f"coherent/{name}"][chosen]


def _at_home(flights: dict[str, NDArray[Any]]) -> None:
    flights["coherent/off_map"] = ~flights["coherent/off_map"]


def _open_border(place: Path) -> None:
    in_json(
        "scene.json", lambda scene: scene.update(border={"wall": "open", "open": "wall"}[scene["border"]])
    )(place)


FLIGHT_LIES = (
    Lie(
        "flights left the map where they did not",
        in_flights("coherent", _at_home),
        ("coherent: verdicts of the flights",),
    ),
    Lie("the border is another", _open_border, ("map: border",)),
    Lie(
        "no flight leaves the map in the metrics",
        in_metrics({"off_map_coherent": 0.77}),
        ("coherent: rates and interval",),
    ),
    Lie(
        "fewer flights fail in the metrics",
        in_json("metrics.json", lambda m: m.update(failure_coherent=0.5 * m["failure_coherent"])),
        ("coherent: rates and interval",),
    ),
    Lie(
        "the interval is narrower",
        in_json("metrics.json", lambda m: m.update(failure_coherent_high=m["failure_coherent"])),
        ("coherent: rates and interval",),
    ),
    Lie("there are more runs", in_metrics({"runs_coherent": 10**5}), ("coherent: rates and interval",)),
    Lie(
        "flights are counted twice",
        both(in_arrays("deployments.npz", _twice), counted("independent", "coherent")),
        ("flights: laws and numbers",),
    ),
    Lie(
        "failed flights are said to be well",
        in_flights("coherent", _all_well("coherent")),
        ("coherent: verdicts of the flights",),
    ),
    Lie(
        "flights are blown elsewhere",
        in_flights("independent", _blown),
        ("independent: winds of the flights",),
    ),
    Lie("flights keep together", in_flights("coherent", _steady), ("coherent: positions of the flights",)),
    Lie(
        "flights of the other law",
        in_flights("coherent", _other_law),
        ("coherent: positions of the flights",),
    ),
    Lie(
        "failed flights are replaced",
        in_flights("coherent", _survivors),
        ("coherent: failure rate of new flights",),
        "paper",
    ),
    Lie(
        "a law is left out",
        in_arrays("deployments.npz", lambda f: [f.pop(f"coherent/{n}") for n in (*FLIGHT_ARRAYS, "walled")]),
        ("flights: laws and numbers", "flights: laws of the metrics"),
    ),
)


RECORD_LIES = (
    Lie(
        "the run is said to be infeasible",
        in_json("run.json", lambda r: r.update(status="infeasible", error="no path")),
        ("run: how it ended",),
    ),
    Lie(
        "the run is said to be complete",
        lambda place: [(place / name).unlink() for name in ("plan.json", "plan.csv")],
        ("run: how it ended", "run: files of all stages"),
    ),
    Lie("a file is gone", lambda place: (place / "deployments.npz").unlink(), ("run: files of all stages",)),
    Lie(
        "the seed is another",
        in_json("run.json", lambda r: r.update(seed=77)),
        ("run: name, seed and stages",),
    ),
    Lie("a setting is another", setting("planner", "n_max", 100_000), ("run: fingerprint of the settings",)),
    Lie(
        "an input is another",
        in_json("run.json", lambda r: r.update(inputs=dict.fromkeys(r["inputs"], "0" * 64))),
        ("run: fingerprints of the inputs",),
    ),
    Lie("the run was faster", in_metrics({"run_seconds": 0.1}), ("run: times",)),
    Lie("growth was faster", in_metrics({"nodes_per_second": 1e9}), ("run: times",)),
    Lie("a probability is above 1", in_metrics({"collision_risk_coherent": 1.5}), ("metrics: ranges",)),
    Lie(
        "a number is missing",
        in_metrics({"failure_coherent": None}),
        ("metrics: ranges", "coherent: rates and interval"),
    ),
    Lie(
        "the parts exceed the whole",
        in_metrics({"collision_coherent": 0.9}),
        ("metrics: rates and intervals", "coherent: rates and interval"),
    ),
)
