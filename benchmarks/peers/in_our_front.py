"""Paths of peers in our front: their failure rates beside ours of the same length.

    PYTHONPATH=benchmarks python -m peers.in_our_front DIR [DIR ...]      # results directories of our runs

The peers plan on the map of each run, without wind: around the obstacles widened by 0 to 2 standard
deviations of the position, into the regions shrunk by as much, in the orders of the paths of our front. Their
paths are flown at full airspeed in the wind of the run, and all paths are judged by the same fresh flights.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.random import SeedSequence

from compare_fronts import failures_at
from pareto_ltl import load_results
from pareto_ltl.extend import PlannedPath, Problem, completing_path, evaluate, which_fail
from pareto_ltl.planning.refine.starts import retimed_means
from pareto_ltl.planning.routes.obligations import mission_order
from pareto_ltl.planning.routes.taut_lines import walk_line
from pareto_ltl.run.front_stage import extra_paths
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.world.cells import decompose
from pareto_ltl.world.scene import Scene
from peers.channel import Peer
from peers.compare import PLANNERS, machine, open_peers

Figures = dict[str, Any]
Order = tuple[str, ...]

BUFFERS = (0.0, 1.0, 1.5, 2.0)  # [standard deviations of the position]
ORDERS = 3  # of our front that the peers try, those of the shortest paths
SECONDS = 1.0  # of CPU time that a planner of OMPL has for a mission
SIDE = 10.0  # of the map, in the unit of the peers: AORRTC does not work in metres
SLOWER = 12  # more steps that a path may have before it counts as one that cannot be flown
NEAR = 0.7  # of the distance from the start, by which an obstacle or a wall moves at most: a mitre is longer
LEAST = 0.1  # of the size of a region that is left where the buffer is wider
JUDGING = SeedSequence(41)


@dataclass(frozen=True, slots=True)
class Judged:
    """One path of a peer; ``failure`` is None if it cannot be flown, ``length`` [m] if there is none."""

    planner: str
    buffer: float
    length: float | None
    failure: float | None = None
    ours: float | None = None  # failure of our front at this length, None if all our paths are longer
    epsilon_kept: bool | None = None


# --- the map of the peers ---------------------------------------------------------------------


def position_sd(problem: Problem, path: PlannedPath) -> float:
    """Standard deviation of the position in its widest direction [m], rms along ``path``."""
    xx, xy, yy = evaluate(problem, x=path.x).cov.T
    widest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    return float(np.sqrt(widest.mean()))


def buffered(scene: Scene, width: float) -> Scene:
    """The map with obstacles wider by ``width`` [m], and regions and walls narrower.

    Near the start they move less, so that it stays free.
    """
    if width == 0.0:
        return scene
    start, drawn = shapely.Point(scene.start), [shapely.Polygon(polygon) for polygon in scene.obstacles]
    wider = [shape.buffer(min(width, NEAR * shape.distance(start)), join_style="mitre") for shape in drawn]
    regions = {
        name: tuple(part for polygon in parts for part in rings(shrunk(polygon, width)))
        for name, parts in scene.regions.items()
    }
    bounds = scene.bounds.copy()
    if scene.border == "wall":
        inside = np.minimum(width, NEAR * np.abs(scene.start - bounds))
        bounds = bounds + inside * [[1.0], [-1.0]]
    box = shapely.box(*bounds.ravel())
    obstacles = tuple(part for shape in wider for part in rings(shape.intersection(box)))
    return replace(scene, bounds=bounds, regions=regions, obstacles=obstacles, obstacle_names=())


def shrunk(polygon: FloatArray, width: float) -> shapely.Geometry:
    """``polygon`` without its rim of ``width`` [m]; a tenth of its size if nothing is left."""
    shape = shapely.Polygon(polygon)
    inner = shape.buffer(-width, join_style="mitre")
    if not inner.is_empty:
        return inner
    middle = np.array(shape.representative_point().coords[0])
    return shapely.Polygon(middle + LEAST * (np.asarray(polygon) - middle))


def rings(shape: shapely.Geometry) -> list[FloatArray]:
    """The outlines (n, 2) of the polygons of ``shape``, counter-clockwise, without holes."""
    polygons = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon" and part.area > 0.0]
    return [np.array(shapely.geometry.polygon.orient(part).exterior.coords[:-1]) for part in polygons]


def map_for_peers(scene: Scene) -> Figures:
    """The map and its cells in a unit of a tenth of its size, from its south-west corner."""
    cells, corner = decompose(scene), scene.bounds[0]
    unit = float((scene.bounds[1] - corner).max()) / SIDE

    def scaled(points: Any) -> Any:
        return ((np.asarray(points) - corner) / unit).tolist()

    return {
        "unit": unit, "corner": corner,
        "side": ((scene.bounds[1] - corner) / unit).tolist(),
        "start": scaled(scene.start),
        "obstacles": [scaled(polygon) for polygon in cells.obstacles],
        "regions": {
            name: scaled(max(parts, key=lambda part: shapely.Polygon(part).area))
            for name, parts in scene.regions.items()
        },
        "cells": [scaled(cell) for cell in cells.cells],
        "doors": cells.doors.tolist(),
        "inside": {
            name: [i for i, label in enumerate(cells.labels) if name in label] for name in scene.regions
        },
    }  # fmt: skip


# --- the paths of the peers -------------------------------------------------------------------


def orders_of(problem: Problem, ours: Sequence[PlannedPath]) -> list[Order]:
    """The orders of regions of our shortest paths, at most ``ORDERS``."""
    found: dict[Order, None] = {}
    for path in sorted(ours, key=lambda path: path.objectives.length):
        order = mission_order(problem, path)
        if order is not None and all(len(label) == 1 for label in order.labels):
            found[tuple(name for (name,) in order.labels)] = None
    return list(found)[:ORDERS]


def peer_lines(peers: dict[str, Peer], name: str, scene: Figures, orders: list[Order]) -> Iterator[Any]:
    """The name of each planner, and the corners (n, 2) [m] of its path; None if it has none."""
    corner, unit = scene["corner"], scene["unit"]
    if "ompl" in peers:
        peers["ompl"].ask(op="map", name=name, side=scene["side"], obstacles=scene["obstacles"])
        for planner in ("RRT*", "AORRTC"):
            line = ompl_line(peers["ompl"], name, scene, orders, PLANNERS[planner][0])
            yield f"OMPL {planner}", None if line is None else corner + unit * line
    if "drake" in peers:
        keys, path = ("cells", "doors", "inside", "start"), None
        possible = [order for order in orders if all(scene["inside"][region] for region in order)]
        if possible:  # a wide buffer may cover a region
            told = peers["drake"].ask(op="mission", orders=possible, **{key: scene[key] for key in keys})
            path = told["path"]
        yield "Drake GCS", None if path is None else corner + unit * np.array(path)


def ompl_line(ompl: Peer, name: str, scene: Figures, orders: list[Order], kind: str) -> FloatArray | None:
    """The shortest path of the ``orders``, leg by leg; each leg starts where the one before ended."""
    ways = sorted(
        {order[: k + 1] for order in orders for k in range(len(order))}, key=lambda way: (len(way), way)
    )
    lines: dict[Order, FloatArray] = {(): np.array([scene["start"]])}
    for way in ways:
        if (before := lines.get(way[:-1])) is None:
            continue
        told = ompl.ask(
            op="leg", name=name, planner=kind, start=before[-1].tolist(), goal=scene["regions"][way[-1]],
            seconds=SECONDS / len(ways), step=None,
        )  # fmt: skip
        if told["length"] is not None:
            lines[way] = np.vstack([before, np.array(told["path"])[1:]])
    whole = [lines[order] for order in orders if order in lines]
    return min(whole, key=lambda line: float(np.hypot(*np.diff(line, axis=0).T).sum()), default=None)


def flown(problem: Problem, line: FloatArray, origin: str) -> PlannedPath | None:
    """The path of the robot along ``line`` at full airspeed, in a few more steps if it must be slower.

    None if it cannot be flown.
    """
    begun = np.vstack([problem.scene.start, line[1:]])
    walked = walk_line(problem, begun)
    if walked is None:
        return None
    for more in range(SLOWER):
        x = walked if more == 0 else retimed_means(problem, walked, len(walked) - 1 + more)
        try:
            return completing_path(problem, x, origin)
        except InfeasibleError:
            continue
    return None


# --- judging ----------------------------------------------------------------------------------


def judged(folder: str, peers: dict[str, Peer], runs: int) -> Figures:
    """Our front of the results ``folder``, and every path of a peer in it."""
    results = load_results(folder)
    problem, name = results.problem, results.settings.name
    ours = extra_paths(folder, problem)
    orders = orders_of(problem, ours)
    shortest = min(ours, key=lambda path: path.objectives.length)
    sd = position_sd(problem, shortest)
    entries: list[tuple[Judged, PlannedPath | None]] = []
    for times in BUFFERS:
        scene = map_for_peers(buffered(problem.scene, times * sd))
        for planner, line in peer_lines(peers, f"{folder} {times}", scene, orders):
            path = None if line is None else flown(problem, line, planner)
            length = None if line is None else float(np.hypot(*np.diff(line, axis=0).T).sum())
            entries.append((Judged(planner, times, length), path))
    theirs = [path for _, path in entries if path is not None]
    failed = which_fail(problem, [*ours, *theirs], runs, JUDGING).mean(axis=1)
    rates = np.maximum(failed, 0.5 / runs)
    rows = np.column_stack([rates[: len(ours)], [path.objectives.length for path in ours]])
    rest = iter(rates[len(ours) :].tolist())
    return {
        "mission": name, "sd": sd, "orders": orders,
        "ours": rows[np.argsort(rows[:, 1])].tolist(),
        "theirs": [shown(placed(problem, rows, entry, path, rest)) for entry, path in entries],
    }  # fmt: skip


def placed(
    problem: Problem, rows: FloatArray, entry: Judged, path: PlannedPath | None, rates: Iterator[float]
) -> Judged:
    """``entry`` with its failure, the next of ``rates``, and with the failure of our front at its length."""
    if path is None:
        return entry
    length = path.objectives.length
    ours = float(failures_at(rows, np.array([length]))[0]) if length >= rows[:, 1].min() else None
    return replace(
        entry, length=length, failure=next(rates), ours=ours, epsilon_kept=problem.keeps_epsilon(path)
    )


def shown(entry: Judged) -> Figures:
    return {name: getattr(entry, name) for name in Judged.__slots__}


# --- the page ---------------------------------------------------------------------------------


def markdown(data: Figures) -> str:
    """The table of ``data``, with commit, machine and versions: length [km], failure theirs / ours."""
    versions = ", ".join(f"{name} {number}" for name, number in data["versions"].items())
    processor = data["machine"]["processor"]
    stamp = f"{data['date']}, commit {data['commit']}, {processor}; {versions}; {data['runs']:,} flights."
    head = ["", "our front", "planner", *(f"buffer {times:g} sd" for times in BUFFERS)]
    lines = [head, ["---"] * len(head)]
    for case in data["missions"]:
        front = f"{span(case['ours'], 1, 1e-3)} km: {span(case['ours'], 0, 100.0)} %"
        begin = [case["mission"], front]
        for planner in dict.fromkeys(entry["planner"] for entry in case["theirs"]):
            found = {entry["buffer"]: entry for entry in case["theirs"] if entry["planner"] == planner}
            lines.append([*begin, planner, *(cell(found.get(times)) for times in BUFFERS)])
            begin = ["", ""]
    absent = [f"{name}: not installed, left out." for name in data["absent"]]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return "\n\n".join([stamp, *absent, table, summary(data["missions"])])


def span(rows: list[list[float]], column: int, unit: float) -> str:
    """The first and the last value of a column of our front."""
    return " to ".join(f"{unit * rows[k][column]:,.4g}" for k in (0, -1))


def cell(entry: Figures | None) -> str:
    """Length [km] of a path, its failure, and the failure of our front at this length."""
    if entry is None or entry["length"] is None:
        return "no path"
    length = f"{entry['length'] / 1e3:,.4g} km"
    if entry["failure"] is None:
        return f"{length}: cannot be flown"
    ours = "-" if entry["ours"] is None else f"{100 * entry['ours']:.3g}"
    return f"{length}: {100 * entry['failure']:.3g} / {ours} %"


def summary(missions: list[Figures]) -> str:
    """One line for each buffer on all missions."""
    lines = []
    for times in BUFFERS:
        every = [entry for case in missions for entry in case["theirs"] if entry["buffer"] == times]
        rated = [entry for entry in every if entry["failure"] is not None]
        both = [entry for entry in rated if entry["ours"] is not None]
        line = f"- Buffer {times:g} sd: {len(rated)} of {len(every)} paths can be flown"
        if rated:
            failure = 100 * float(np.median([entry["failure"] for entry in rated]))
            kept = sum(entry["epsilon_kept"] for entry in rated)
            line += f" and fail {failure:.3g} % in the median; {kept} keep epsilon"
        if both:
            ratio = float(np.median([entry["failure"] / entry["ours"] for entry in both]))
            better = sum(entry["failure"] < entry["ours"] for entry in both)
            line += (
                f". {len(both)} are at least as long as our shortest path: they fail {ratio:.3g} times as "
                f"often as ours of their length in the median, and less often in {better} cases"
            )
        lines.append(f"{line}.")
    return "\n".join(lines)


def commit() -> str:
    """The commit of this checkout, and whether it has changes."""
    here = Path(__file__).parent

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=here, capture_output=True, text=True, check=True
        ).stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "../../src")
    return git("rev-parse", "--short=8", "HEAD") + (" with changes" if changed else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("results", nargs="*", help="results directories of our runs")
    parser.add_argument("--out", type=Path, default=Path("build/peers_in_our_front.json"), help="all figures")
    parser.add_argument("--environments", type=Path, default=Path("build/peers"), help="where the peers are")
    parser.add_argument("--runs", type=int, default=10_000, help="flights that judge each path")
    parser.add_argument("--table", action="store_true", help="only print the tables of --out again")
    given = parser.parse_args()
    if given.table:
        print(markdown(json.loads(given.out.read_text())))
        return
    wanted = ["ompl", "drake"]
    peers = open_peers(wanted, given.environments, lambda line: print(line, file=sys.stderr))
    if not peers:
        raise SystemExit("no peer is installed")
    versions = {name: version(name) for name in ("pareto-ltl", "numpy")} | {
        "python": platform.python_version()
    }
    for peer in peers.values():
        versions |= peer.ask(op="version")
    data: Figures = {
        "date": datetime.now(UTC).date().isoformat(), "commit": commit(), "machine": machine(),
        "versions": versions, "runs": given.runs, "missions": [],
        "absent": [name for name in wanted if name not in peers],
    }  # fmt: skip
    given.out.parent.mkdir(parents=True, exist_ok=True)
    for folder in given.results:
        data["missions"].append(judged(folder, peers, given.runs))
        print(data["missions"][-1]["mission"], file=sys.stderr, flush=True)
        given.out.write_text(json.dumps(data, indent=1) + "\n")
    for peer in peers.values():
        peer.close()
    print(markdown(data))


if __name__ == "__main__":
    main()
