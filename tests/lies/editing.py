"""Edits of the files of a result that change a number in every file that has it."""

from __future__ import annotations

import csv
import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import yaml
from numpy.typing import NDArray

from careful_io.archives import read_npz
from careful_io.files import write_csv, write_json, write_npz
from careful_io.reading import read_json
from pareto_ltl_verify.claims.flights import METRICS
from pareto_ltl_verify.evidence import open_evidence
from pareto_ltl_verify.flights import rates
from pareto_ltl_verify.judge import CLAIMS, findings

COSTS = {
    "length": "length_m",
    "mission_risk": "mission_risk",
    "mission_risk_paper": "mission_risk_paper",
    "mission_risk_ordered": "mission_risk_ordered",
    "collision_risk": "collision_risk",
    "energy": "energy_j",
}


class Lie(NamedTuple):
    """An edit and the claims that must fail; ``only`` names a preset if other presets do not make them."""

    name: str
    edit: Callable[[Path], Any]
    caught: tuple[str, ...]
    only: str = ""


def edited(place: Path, copy: Path, lie: Lie) -> Path:
    """A copy of the results, in ``place``, with the edits of a lie."""
    shutil.copytree(place, copy)
    lie.edit(copy)
    return copy


def holds(place: Path, name: str) -> bool:
    """Whether the claim ``name`` of the results holds; no other one is judged."""
    (claim,) = (claim for claim in CLAIMS if claim.name == name)
    (found,) = findings(open_evidence(place), [claim])
    return found.holds


def in_json(name: str, change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], Any]:
    """Change the content of a JSON file."""

    def edit(place: Path) -> None:
        content = read_json(place / name)
        change(content)
        write_json(place / name, content)

    return edit


def in_text(name: str, pattern: str, new: str) -> Callable[[Path], Any]:
    """Replace what a pattern matches first in the text file ``name``."""

    def edit(place: Path) -> None:
        path = place / name
        text = path.read_text(encoding="utf-8")
        changed = re.sub(pattern, new, text, count=1, flags=re.DOTALL)
        assert changed != text
        path.write_text(changed, encoding="utf-8")

    return edit


def in_plan(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], Any]:
    """Change plan.json, and plan.csv with it."""

    def edit(place: Path) -> None:
        in_json("plan.json", change)(place)
        plan = read_json(place / "plan.json")
        with (place / "plan.csv").open(encoding="utf-8") as file:
            header = next(csv.reader(file))
        rows = []
        for t, ((xx, xy), (_, yy)) in enumerate(plan["cov"]):
            u = plan["u"][t] if t < len(plan["u"]) else ("", "")
            label = " ".join(sorted(plan["label"][t]))
            rows.append((t, plan["t"][t], *plan["x"][t], *u, xx, xy, yy, plan["q"][t], label))
        write_csv(place / "plan.csv", header, rows)

    return edit


def in_settings(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], Any]:
    """Change config_resolved.yaml."""

    def edit(place: Path) -> None:
        path = place / "config_resolved.yaml"
        content = yaml.safe_load(path.read_text())
        change(content)
        path.write_text(yaml.safe_dump(content, sort_keys=False))

    return edit


def in_arrays(name: str, change: Callable[[dict[str, NDArray[Any]]], Any]) -> Callable[[Path], Any]:
    """Change the arrays of an archive."""

    def edit(place: Path) -> None:
        arrays = {key: array.copy() for key, array in read_npz(place / name).items()}
        change(arrays)
        write_npz(place / name, arrays)

    return edit


def in_wind(change: Callable[[Any], Any]) -> Callable[[Path], Any]:
    """Change wind.nc."""

    def edit(place: Path) -> None:
        with h5py.File(place / "wind.nc", "r+") as file:
            change(file)

    return edit


def in_front(change: Callable[[list[dict[str, str]]], Any]) -> Callable[[Path], Any]:
    """Change the rows of front.csv, and the size of the front in the metrics."""

    def edit(place: Path) -> None:
        with (place / "front.csv").open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        header = list(rows[0])
        change(rows)
        write_csv(place / "front.csv", header, ([row[key] for key in header] for row in rows))
        in_metrics({"front_size": len(rows)})(place)

    return edit


def in_metrics(numbers: Mapping[str, Any]) -> Callable[[Path], Any]:
    """Put ``numbers`` into metrics.json."""
    return in_json("metrics.json", lambda content: content.update(numbers))


def both(*edits: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """Several edits, one after another."""

    def edit(place: Path) -> None:
        for one in edits:
            one(place)

    return edit


def recosted(name: str, factor: float) -> Callable[[Path], Any]:
    """Multiply a cost of the plan in every file that holds it."""

    def edit(place: Path) -> None:
        plan = read_json(place / "plan.json")
        old = plan["objectives"][name]
        plan["objectives"][name] = new = factor * old
        if plan["promise"]:
            costs = plan["objectives"]
            plan["promise"]["bound"] = bound = min(1.0, costs["mission_risk"] + costs["collision_risk"])
            in_metrics({"promise_bound": bound})(place)
        write_json(place / "plan.json", plan)
        in_metrics({COSTS[name]: new})(place)

        def row_of_plan(rows: list[dict[str, str]]) -> None:
            for row in rows:
                if row["origin"] == plan["origin"] and float(row[COSTS[name]]) == old:
                    row[COSTS[name]] = repr(new)

        in_front(row_of_plan)(place)

    return edit


def counted(*laws: str) -> Callable[[Path], Any]:
    """Write the rates of deployments.npz into the metrics."""

    def edit(place: Path) -> None:
        flights = read_npz(place / "deployments.npz")
        for law in laws:
            flags = (flights[f"{law}/{name}"] for name in ("accepted", "collided", "off_map"))
            found = rates(*flags, bool(flights[f"{law}/walled"].all()))
            in_metrics({METRICS[key].format(law): value for key, value in found.items()})(place)

    return edit


def in_flights(law: str, change: Callable[[dict[str, NDArray[Any]]], Any]) -> Callable[[Path], Any]:
    """Change the flights under a law, and update the rates."""
    return both(in_arrays("deployments.npz", change), counted(law))


def setting(section: str, key: str, value: Any) -> Callable[[Path], Any]:
    """Change one setting."""
    return in_settings(lambda told: told[section].update({key: value}))


def put(content: Any, *path: Any, value: Any) -> None:
    """Set the value at ``path``."""
    for key in path[:-1]:
        content = content[key]
    content[path[-1]] = value


def scaled(content: Any, *path: Any, factor: float) -> None:
    """Multiply the value at ``path``."""
    for key in path[:-1]:
        content = content[key]
    content[path[-1]] = (np.array(content[path[-1]]) * factor).tolist()


def moved(corners: list[list[float]], metres: float) -> list[list[float]]:
    """Corners farther east."""
    return [[x + metres, y] for x, y in corners]


def shrunk(corners: list[list[float]], factor: float = 0.9) -> list[list[float]]:
    """Corners nearer to their middle."""
    points = np.array(corners)
    middle = points.mean(axis=0)
    shrunk_corners: list[list[float]] = (middle + factor * (points - middle)).tolist()
    return shrunk_corners
