"""The front on disk: ``front.csv`` for people, ``front.npz`` with all that is needed to fly each path.

Together they hold all of a :class:`Front`: the table its numbers and texts, the archive its arrays.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.planning.costs import cost_named, known_costs
from pareto_ltl.planning.records import FailureRate, Front, Objectives, PlannedPath
from pareto_ltl.run.file_shape import inside, shaped
from pareto_ltl.settings.fidelity import models_of
from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.arrays import require_shape
from pareto_ltl.support.files import write_csv, write_npz
from pareto_ltl.support.names import joined_names, split_names
from pareto_ltl.support.reading import read_text

FRONT_HEADER = (
    "path",
    "failure",
    "failure_low",
    "failure_high",
    "law",
    "runs",
    "length_m",
    "mission_risk",
    "collision_risk",
    "mission_risk_ordered",
    "mission_risk_paper",
    "steps",
    "duration_s",
    "order",
    "origin",
)
RISK_COLUMNS = ("mission_risk", "collision_risk", "mission_risk_ordered", "mission_risk_paper")
NO_RATE = (math.nan, math.nan, math.nan, "", "")
PATH_ARRAYS = ("t", "x", "cov", "q", "u")


def write_front(directory: Path, front: Front) -> None:
    """Write both files."""
    rows = [
        (
            number,
            *((r.failure, r.low, r.high, r.law, r.runs) if (r := rate) else NO_RATE),
            *_length_and_risks(path.objectives),
            len(path.u),
            path.t[-1] - path.t[0],
            path.order,
            path.origin,
            *path.objectives.further_costs.values(),
        )
        for number, (path, rate) in enumerate(
            zip(front.paths, front.rates or [None] * len(front.paths), strict=True)
        )
    ]
    further = [cost_named(name).column for path in front.paths[:1] for name in path.objectives.further_costs]
    write_csv(directory / "front.csv", (*FRONT_HEADER, *further), rows)
    write_npz(directory / "front.npz", _front_arrays(front))


def _length_and_risks(o: Objectives) -> list[float]:
    return [o.length, *(getattr(o, name) for name in RISK_COLUMNS)]


def _front_arrays(front: Front) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {
        "fidelity": np.array([front.models.label]),
        "reference": np.asarray(front.reference, float),
        "hypervolume": np.array([front.hypervolume]),
        "raw": np.array([_length_and_risks(o) for o in front.raw]).reshape(-1, 1 + len(RISK_COLUMNS)),
        "failed": front.failed,
        "raw_rates": np.array([[r.failure, r.low, r.high, r.runs] for r in front.raw_rates]).reshape(-1, 4),
    }
    for name in front.raw[0].further_costs if front.raw else ():
        arrays[f"raw_{name}"] = np.array([o.costs[name] for o in front.raw], float)
    for number, path in enumerate(front.paths):
        key = path_key(number)
        arrays |= {f"{key}/{name}": getattr(path, name) for name in PATH_ARRAYS}
        arrays[f"{key}/label"] = np.array([joined_names(label) for label in path.label], np.str_)
        arrays[f"{key}/fixes"] = np.array(path.fixes, np.int64)
    return arrays


def path_key(number: int) -> str:
    """The name of a path in ``front.npz``."""
    return f"path_{number:03d}"


def read_front(place: Path | str) -> Front:
    """The front in a results directory, as it was written.

    Raises
    ------
    DataError
        If a file is missing or damaged, or if the two do not fit together.
    """
    table, archive = inside(place, "front.csv"), inside(place, "front.npz")
    text = read_text(table)
    arrays = read_npz(archive)
    with shaped(table, "a front"):
        rows = list(csv.DictReader(text.splitlines()))
        names = {cost.column: cost.name for cost in known_costs() if cost.column not in FRONT_HEADER}
        further = {names[column]: column for row in rows[:1] for column in row if column in names}
        costs = [_objectives(row, further) for row in rows]
        rates = tuple(_rate(row) for row in rows if row["failure"])
    with shaped(archive, "a front"):
        models = models_of(str(arrays["fidelity"].item()))
        count = sum(key.endswith("/x") for key in arrays)
        if count != len(rows):
            raise ValueError(f"it holds {count} paths, and front.csv {len(rows)}")
        raw = arrays["raw"].reshape(-1, 1 + len(RISK_COLUMNS))
        others = [dict(zip(further, row, strict=True)) for row in _further_rows(arrays, further, len(raw))]
        return Front(
            paths=tuple(_path(arrays, k, row, costs[k]) for k, row in enumerate(rows)),
            raw=tuple(
                Objectives({"length": row[0]} | other, **dict(zip(RISK_COLUMNS, row[1:], strict=True)))
                for row, other in zip(raw.tolist(), others, strict=True)
            ),
            hypervolume=float(arrays["hypervolume"].item()),
            reference=np.asarray(arrays["reference"], float),
            rates=rates,
            raw_rates=tuple(
                FailureRate(models.law, failure, low, high, int(runs))
                for failure, low, high, runs in arrays["raw_rates"].reshape(-1, 4).tolist()
            ),
            failed=arrays["failed"],
            models=models,
        )


def _objectives(row: Mapping[str, str], further: Mapping[str, str]) -> Objectives:
    """The objectives of a row; ``further`` are the columns of costs other than length, by name."""
    costs = {name: float(row[column] or "nan") for name, column in {"length": "length_m", **further}.items()}
    return Objectives(costs, **{name: float(row[name] or "nan") for name in RISK_COLUMNS})


def _further_rows(arrays: Mapping[str, NDArray[Any]], names: Iterable[str], rows: int) -> list[list[float]]:
    """The costs ``names`` of the paths before refinement, one row for each path."""
    columns = [arrays[f"raw_{name}"] for name in names] if rows else []
    table: list[list[float]] = np.stack(columns, axis=1).tolist() if columns else [[] for _ in range(rows)]
    return table


def _rate(row: Mapping[str, str]) -> FailureRate:
    failure, low, high = (float(row[key]) for key in ("failure", "failure_low", "failure_high"))
    return FailureRate(row["law"], failure, low, high, int(row["runs"]))


def _path(
    arrays: Mapping[str, NDArray[Any]], number: int, row: Mapping[str, str], costs: Objectives
) -> PlannedPath:
    key = path_key(number)
    t, x, cov, q, u = (arrays[f"{key}/{name}"] for name in PATH_ARRAYS)
    size = len(t)
    require_shape(f"{key}/x", x, size, 2)
    require_shape(f"{key}/cov", cov, size, 2, 2)
    require_shape(f"{key}/q", q, size)
    require_shape(f"{key}/u", u, size - 1, 2)
    require_shape(f"{key}/label", arrays[f"{key}/label"], size)
    return PlannedPath(
        t=t,
        x=x,
        cov=cov,
        q=q,
        label=tuple(split_names(names) for names in arrays[f"{key}/label"].tolist()),
        u=u,
        objectives=costs,
        origin=row["origin"],
        fixes=tuple(arrays[f"{key}/fixes"].tolist()),
        order=row["order"],
    )
