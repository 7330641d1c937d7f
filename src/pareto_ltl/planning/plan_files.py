"""Trees, front, plan and extra paths on disk.

``front.csv`` has the numbers and texts of a :class:`Front` for people, ``front.npz`` its arrays, with all
that is needed to fly each path. ``plan.json``, whose schema is part of the package, has all of a
:class:`Plan`, ``plan.csv`` its positions. A file of extra paths (``selection.extra_paths``) is a
``front.npz``, of which only the positions are read, or one with their positions and origins alone.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from careful_io.files import write_csv, write_json, write_npz
from careful_io.names import joined_names, split_names
from careful_io.reading import inside, read_text, shaped
from flight_quantities.frames import Navigation
from flight_quantities.heights import FlownAir, Height
from pareto_ltl.planning.branching.files import branches_document, read_branches
from pareto_ltl.planning.costs import cost_named, known_costs
from pareto_ltl.planning.limits import Price, Remedy, SegmentLimits, WorstSegment
from pareto_ltl.planning.navigation_files import number_or_nan, read_navigation
from pareto_ltl.planning.rates import FailureRate, Promise
from pareto_ltl.planning.records import BY_STEP, RISKS, Forest, Front, Objectives, Plan, PlannedPath, Tree
from pareto_ltl.settings.fidelity import models_of
from pareto_ltl.support.arrays import FloatArray, require_shape
from pareto_ltl.support.stored import stored

TREE_ARRAYS = ("x", "parent", "step", "q", "cell", "length", "risk", "swaps", "beta")
RISK_COLUMNS = ("mission_risk", "collision_risk", "mission_risk_ordered", "mission_risk_paper")
FRONT_HEADER = (
    "path", "failure", "failure_low", "failure_high", "law", "runs", "length_m", *RISK_COLUMNS, "steps",
    "duration_s", "order", "origin",
)  # fmt: skip
NO_RATE = (math.nan, math.nan, math.nan, "", "")
PATH_ARRAYS = ("t", "x", "cov", "q", "u")
PLAN_SCHEMA = "pareto_ltl.plan/2"
BRANCHED_SCHEMA = "pareto_ltl.plan/3"  # of a plan with branches
PLAN_SCHEMAS = {
    PLAN_SCHEMA: "plan",
    BRANCHED_SCHEMA: "plan",
    "pareto_ltl.plan/1": "plan_1",
}  # identifier in the file: name of the schema file
TABLE_HEADER = ("step", "t_s", "x_m", "y_m", "u_x_m_s", "u_y_m_s", "cov_xx", "cov_xy", "cov_yy", "q", "label")
AS_STORED = (  # values of a plan that the file has as they are
    "formula", "dt", "u_min", "u_max", "capacity", "epsilon", "epsilon_kept", "fidelity", "covered",
    "not_covered",
)  # fmt: skip
LIMIT_KEYS = tuple(field.name for field in fields(SegmentLimits))  # of each segment
NAVIGATION_KEYS = tuple(field.name for field in fields(Navigation))
ExtraPath = tuple[str, FloatArray]  # how it was made, and its positions (T+1, 2) [m]


def _checked(path: PlannedPath, prefix: str = "") -> PlannedPath:
    """``path``; raises ValueError if the shapes of its arrays do not fit together."""
    size = len(path.t)
    shapes = {"x": (size, 2), "cov": (size, 2, 2), "q": (size,), "u": (size - 1, 2)}
    for name, shape in shapes.items():
        require_shape(f"{prefix}{name}", getattr(path, name), *shape)
    if len(path.label) != size:
        raise ValueError(f"{prefix}label must have {size} entries, got {len(path.label)}")
    return path


# --- trees -----------------------------------------------------------------------------------


def write_forest(directory: Path, forest: Forest) -> None:
    """Write ``trees.npz``."""
    arrays: dict[str, NDArray[Any]] = {"accepted": forest.accepted}
    for number, tree in enumerate(forest.trees):
        arrays |= {f"tree_{number:03d}/{name}": getattr(tree, name) for name in TREE_ARRAYS}
        causes = sorted(tree.reach)
        arrays[f"tree_{number:03d}/causes"] = np.array(causes, dtype=np.str_)
        arrays[f"tree_{number:03d}/counts"] = np.array([tree.reach[cause] for cause in causes], float)
    write_npz(directory / "trees.npz", arrays)


def read_forest(place: Path | str) -> Forest:
    """The forest, without times (NaN): an archive must not depend on the speed of the machine."""
    with stored(place, "trees.npz", "a forest") as arrays:
        names = sorted({key.partition("/")[0] for key in arrays if "/" in key})
        trees = tuple(_tree(arrays, name) for name in names)
        return Forest(trees, arrays["accepted"], math.nan)


def _tree(arrays: Mapping[str, NDArray[Any]], name: str) -> Tree:
    counts = zip(arrays[f"{name}/causes"].tolist(), arrays[f"{name}/counts"].tolist(), strict=True)
    tree = Tree(**{key: arrays[f"{name}/{key}"] for key in TREE_ARRAYS}, seconds=math.nan, reach=dict(counts))
    size = len(tree.parent)
    require_shape(f"{name}/x", tree.x, size, 2)
    require_shape(f"{name}/risk", tree.risk, size, None)
    for key in ("step", "q", "cell", "length"):
        require_shape(f"{name}/{key}", getattr(tree, key), size)
    if (tree.parent >= np.arange(size)).any() or (tree.parent < -1).any():
        raise ValueError(f"a vertex of {name} does not come after its parent")
    return tree


# --- front -----------------------------------------------------------------------------------


def write_front(directory: Path, front: Front) -> None:
    """Write ``front.csv`` and ``front.npz``."""
    write_npz(directory / "front.npz", _front_arrays(front))
    write_csv(directory / "front.csv", *front_table(front))  # where it is, the other one is too


def front_table(front: Front) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
    """The columns of ``front.csv`` and their values, one row for each path."""
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
    return (*FRONT_HEADER, *further), rows


def _length_and_risks(o: Objectives) -> list[float]:
    return [o.length, *(getattr(o, name) for name in RISK_COLUMNS)]


def _front_arrays(front: Front) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {
        "fidelity": np.array([front.models.label]),
        "reference": np.asarray(front.reference, float),
        "hypervolume": np.array([front.hypervolume]),
        "raw": np.array([_length_and_risks(o) for o in front.raw]).reshape(-1, 1 + len(RISK_COLUMNS)),
        "failed": front.failed,
        "judged": front.judged,
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
    table = inside(place, "front.csv")
    text = read_text(table)
    with shaped(table, "a front"):
        rows = list(csv.DictReader(text.splitlines()))
        names = {cost.column: cost.name for cost in known_costs() if cost.column not in FRONT_HEADER}
        further = {names[column]: column for row in rows[:1] for column in row if column in names}
        costs = [_objectives(row, further) for row in rows]
        rates = tuple(_rate(row) for row in rows if row["failure"])
    with stored(place, "front.npz", "a front") as arrays:
        models = models_of(str(arrays["fidelity"].item()))
        count = sum(key.endswith("/x") for key in arrays)
        if count != len(rows):
            raise ValueError(f"it holds {count} paths, and front.csv {len(rows)}")
        return Front(
            paths=tuple(_path(arrays, k, row, costs[k]) for k, row in enumerate(rows)),
            raw=_raw_objectives(arrays, further),
            hypervolume=float(arrays["hypervolume"].item()),
            reference=np.asarray(arrays["reference"], float),
            rates=rates,
            raw_rates=tuple(
                FailureRate(models.law, failure, low, high, int(runs))
                for failure, low, high, runs in arrays["raw_rates"].reshape(-1, 4).tolist()
            ),
            failed=arrays["failed"],
            models=models,
            judged=np.asarray(arrays.get("judged", np.zeros((0, 0))), float),
        )


def _raw_objectives(arrays: Mapping[str, NDArray[Any]], further: Mapping[str, str]) -> tuple[Objectives, ...]:
    """The objectives of the paths before refinement; ``further`` are the names of costs other than length."""
    rows = arrays["raw"].reshape(-1, 1 + len(RISK_COLUMNS)).tolist()
    others = {name: arrays[f"raw_{name}"].tolist() for name in further} if rows else {}
    return tuple(
        Objectives(
            {"length": row[0]} | {name: column[k] for name, column in others.items()},
            **dict(zip(RISK_COLUMNS, row[1:], strict=True)),
        )
        for k, row in enumerate(rows)
    )


def _objectives(row: Mapping[str, str], further: Mapping[str, str]) -> Objectives:
    """The objectives of a row; ``further`` are the columns of costs other than length, by name."""
    costs = {name: float(row[column] or "nan") for name, column in {"length": "length_m", **further}.items()}
    return Objectives(costs, **{name: float(row[name] or "nan") for name in RISK_COLUMNS})


def _rate(row: Mapping[str, str]) -> FailureRate:
    failure, low, high = (float(row[key]) for key in ("failure", "failure_low", "failure_high"))
    return FailureRate(row["law"], failure, low, high, int(row["runs"]))


def _path(
    arrays: Mapping[str, NDArray[Any]], number: int, row: Mapping[str, str], costs: Objectives
) -> PlannedPath:
    key = path_key(number)
    path = PlannedPath(
        **{name: arrays[f"{key}/{name}"] for name in PATH_ARRAYS},
        label=tuple(split_names(names) for names in arrays[f"{key}/label"].tolist()),
        objectives=costs,
        origin=row["origin"],
        fixes=tuple(arrays[f"{key}/fixes"].tolist()),
        order=row["order"],
    )
    return _checked(path, f"{key}/")


# --- extra paths -----------------------------------------------------------------------------


def read_extra_paths(place: Path | str) -> list[ExtraPath]:
    """The paths in a ``front.npz``, in the results directory that has one, or in an extra file.

    Raises
    ------
    DataError
        If the file cannot be read, or does not contain paths.
    """
    with stored(Path(place).expanduser(), "front.npz", "paths of a front") as arrays:
        paths = []
        for number in range(sum(key.endswith("/x") for key in arrays)):
            key = path_key(number)
            x = np.ascontiguousarray(arrays[f"{key}/x"], float)
            if x.ndim != 2 or x.shape[1] != 2 or len(x) < 2 or not np.isfinite(x).all():
                raise ValueError(f"{key}/x must be finite positions of shape (T+1, 2), got {x.shape}")
            known = arrays.get(f"{key}/origin")
            paths.append((f"extra path {number}" if known is None else str(known.item()), x))
        return paths


# --- plan ------------------------------------------------------------------------------------


def write_plan(directory: Path, plan: Plan) -> None:
    """Write ``plan.json`` and ``plan.csv``."""
    path = plan.path
    content = {
        "schema": PLAN_SCHEMA if plan.branching is None else BRANCHED_SCHEMA,
        "formula": plan.formula,
        "atoms": plan.atoms,
        "dt": plan.dt,
        "u_min": plan.u_min,
        "u_max": plan.u_max,
        **({} if plan.capacity is None else {"capacity": plan.capacity}),
        "epsilon": plan.epsilon,
        **_nearness(plan),
        "fidelity": plan.fidelity,
        "models": {key: value for key, value in asdict(plan.models).items() if key != "name"},
        "objectives": path.objectives.as_dict(),
        "selection": {"rule": plan.rule, "weights": plan.weights, **plan.rule_settings},
        "promise": None if plan.promise is None else promise_document(plan.promise),
        "covered": plan.covered,
        "not_covered": plan.not_covered,
        "origin": path.origin,
        "order": path.order,
        "fixes": path.fixes,
        **({} if plan.limits is None else {"segments": _segments(plan.limits)}),
        "prices": [asdict(price) for price in plan.prices],
        **_flown(plan),
        **{key: getattr(plan.navigation, key, None) for key in NAVIGATION_KEYS},
        **{name: getattr(path, name) for name in BY_STEP},
    }
    if plan.branching is not None:
        content["branches"] = branches_document(plan.branching, plan.air)
    write_json(directory / "plan.json", content)
    write_csv(directory / "plan.csv", TABLE_HEADER, (_plan_row(path, step) for step in range(len(path.t))))


def _flown(plan: Plan) -> dict[str, Any]:
    """Height and air of the flight, and the calibrated airspeeds; nothing for plans of earlier versions."""
    if plan.height is None:
        return {}
    if plan.air is None or plan.navigation is None:
        return {"height": asdict(plan.height)}
    air = asdict(plan.air) | {"density_ratio": plan.air.density_ratio}
    calibrated = plan.air.calibrated(plan.navigation.airspeed)
    return {"height": asdict(plan.height), "air": air, "airspeed_calibrated": calibrated}


def promise_document(promise: Promise) -> dict[str, Any]:
    """The rate, then claim, bound, linearity and the result of the test."""
    document = asdict(promise)
    rate: dict[str, Any] = document.pop("rate")
    if not promise.floor:
        del document["floor"]
    return rate | document


def _nearness(plan: Plan) -> dict[str, Any]:
    """Whether the plan keeps epsilon, its worst segment, and what helps; only where flights judge."""
    if plan.worst is None:
        return {}
    remedies = [asdict(remedy) for remedy in plan.remedies]
    return {"epsilon_kept": plan.epsilon_kept, "worst_segment": asdict(plan.worst)} | (
        {"remedies": remedies} if remedies else {}
    )


def _segments(limits: SegmentLimits) -> list[dict[str, Any]]:
    columns = (getattr(limits, key) for key in LIMIT_KEYS)
    return [dict(zip(LIMIT_KEYS, row, strict=True)) for row in zip(*columns, strict=True)]


def _limits(content: Mapping[str, Any]) -> SegmentLimits | None:
    rows = content.get("segments")
    if rows is None:
        return None
    if len(rows) != len(content["u"]):
        raise ValueError(f"segments must have {len(content['u'])} entries, got {len(rows)}")
    nearest, *numbers = ([row.get(key, 0.0) for row in rows] for key in LIMIT_KEYS)  # without price: earlier
    return SegmentLimits(tuple(nearest), *(np.array(column, float) for column in numbers))


def _plan_row(path: PlannedPath, step: int) -> tuple[Any, ...]:
    control = path.u[step] if step < len(path.u) else ("", "")  # the last position has no control
    (xx, xy), (_, yy) = path.cov[step]
    label = joined_names(path.label[step])
    return (step, path.t[step], *path.x[step], *control, xx, xy, yy, path.q[step], label)


def read_plan(place: Path | str) -> Plan:
    """The plan in a results directory, or in a file of the same form.

    Files of schema ``pareto_ltl.plan/1`` are read too; they hold neither promise nor navigation.
    """
    with stored(place, "plan.json", "a plan", PLAN_SCHEMAS) as content:
        selection = dict(content["selection"])
        return Plan(
            path=_flight(content),
            **{name: content[name] for name in AS_STORED if name in content},  # earlier files lack some
            atoms=tuple(content["atoms"]),
            rule=selection.pop("rule"),
            weights=tuple(selection.pop("weights")),
            rule_settings=selection,
            promise=_promise(content.get("promise")),
            navigation=read_navigation(content),
            limits=_limits(content),
            prices=tuple(Price(**price) for price in content.get("prices", ())),
            height=Height(**content["height"]) if "height" in content else None,
            air=_air(content["air"]) if "air" in content else None,
            worst=WorstSegment(**content["worst_segment"]) if "worst_segment" in content else None,
            remedies=tuple(Remedy(**remedy) for remedy in content.get("remedies", ())),
            branching=read_branches(content["branches"]) if "branches" in content else None,
        )


def _air(content: Mapping[str, Any]) -> FlownAir:
    return FlownAir(**{field.name: content[field.name] for field in fields(FlownAir)})


def _promise(content: Mapping[str, Any] | None) -> Promise | None:
    if content is None:
        return None
    rate, claimed = map(FailureRate.stated, (content, content["claimed"]))
    bound, linearity = (number_or_nan(content[name]) for name in ("bound", "linearity"))
    return Promise(rate, claimed, bound, linearity, content["passed"], content.get("floor", 0.0))


def _flight(content: Mapping[str, Any]) -> PlannedPath:
    objectives = content["objectives"]  # files of schema 1 may lack mission_risk_ordered
    costs = {"mission_risk_ordered": objectives["mission_risk"]} | objectives
    risks = {name: number_or_nan(costs.pop(name)) for name in RISKS}
    flight = PlannedPath(
        t=np.array(content["t"], float),
        x=np.array(content["x"], float),
        cov=np.array(content["cov"], float),
        q=np.array(content["q"], np.int64),
        label=tuple(frozenset(names) for names in content["label"]),
        u=np.array(content["u"], float).reshape(-1, 2),
        objectives=Objectives({name: number_or_nan(value) for name, value in costs.items()}, **risks),
        origin=content["origin"],
        fixes=tuple(content.get("fixes", ())),
        order=content.get("order", ""),
    )
    _checked(flight)
    if not all(map(_is_covariance, flight.cov)):
        raise ValueError("cov must have symmetric matrices without negative eigenvalues")
    return flight


def _is_covariance(cov: FloatArray) -> bool:
    """Whether a matrix (2, 2) is symmetric and positive semidefinite, up to rounding."""
    (xx, xy), (yx, yy) = cov
    slack = 1e-9 * max(abs(xx), abs(yy))
    return bool(min(xx, yy) >= 0.0 and abs(xy - yx) <= slack and xx * yy - xy * yx >= -slack * max(xx, yy))
