"""The plan on disk: ``plan.json``, whose schema is part of the package, and ``plan.csv``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.planning.costs import Price, SegmentLimits
from pareto_ltl.planning.records import (
    RISKS,
    FailureRate,
    Objectives,
    Plan,
    PlannedPath,
    Promise,
)
from pareto_ltl.run.file_shape import inside, shaped
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.files import write_csv, write_json
from pareto_ltl.support.names import joined_names
from pareto_ltl.support.schemas import read_document
from pareto_ltl.world.projection import Navigation

PLAN_SCHEMA = "pareto_ltl.plan/2"
PLAN_SCHEMAS = {
    PLAN_SCHEMA: "plan",
    "pareto_ltl.plan/1": "plan_1",
}  # identifier in the file: name of the schema file
TABLE_HEADER = ("step", "t_s", "x_m", "y_m", "u_x_m_s", "u_y_m_s", "cov_xx", "cov_xy", "cov_yy", "q", "label")


def write_plan(directory: Path, plan: Plan) -> None:
    """Write both files."""
    path = plan.path
    content = {
        "schema": PLAN_SCHEMA,
        "formula": plan.formula,
        "atoms": plan.atoms,
        "dt": plan.dt,
        "u_min": plan.u_min,
        "u_max": plan.u_max,
        **({} if plan.capacity is None else {"capacity": plan.capacity}),
        "epsilon": plan.epsilon,
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
        **_limits_document(plan.limits),
        "prices": [asdict(price) for price in plan.prices],
        **_navigation_document(plan.navigation),
        "t": path.t,
        "x": path.x,
        "cov": path.cov,
        "q": path.q,
        "label": path.label,
        "u": path.u,
    }
    write_json(directory / "plan.json", content)
    write_csv(directory / "plan.csv", TABLE_HEADER, (_plan_row(path, step) for step in range(len(path.t))))


def promise_document(promise: Promise) -> dict[str, Any]:
    """The rate, then claim, bound, linearity and the result of the test."""
    return asdict(promise.rate) | {
        "claimed": asdict(promise.claimed),
        "bound": promise.bound,
        "linearity": promise.linearity,
        "passed": promise.passed,
    }


LIMIT_KEYS = tuple(field.name for field in fields(SegmentLimits))  # of each segment


def _limits_document(limits: SegmentLimits | None) -> dict[str, Any]:
    if limits is None:
        return {}
    columns = (getattr(limits, key) for key in LIMIT_KEYS)
    return {"segments": [dict(zip(LIMIT_KEYS, row, strict=True)) for row in zip(*columns, strict=True)]}


def _limits(content: Mapping[str, Any]) -> SegmentLimits | None:
    rows = content.get("segments")
    if rows is None:
        return None
    if len(rows) != len(content["u"]):
        raise ValueError(f"segments must have {len(content['u'])} entries, got {len(rows)}")
    nearest, *numbers = ([row.get(key, 0.0) for row in rows] for key in LIMIT_KEYS)  # without price: earlier
    return SegmentLimits(tuple(nearest), *(np.array(column, float) for column in numbers))


NAVIGATION_KEYS = tuple(field.name for field in fields(Navigation))


def _navigation_document(navigation: Navigation | None) -> dict[str, Any]:
    return {key: None if navigation is None else getattr(navigation, key) for key in NAVIGATION_KEYS}


def _plan_row(path: PlannedPath, step: int) -> tuple[Any, ...]:
    control = path.u[step] if step < len(path.u) else ("", "")  # the last position has no control
    (xx, xy), (_, yy) = path.cov[step]
    label = joined_names(path.label[step])
    return (step, path.t[step], *path.x[step], *control, xx, xy, yy, path.q[step], label)


def read_plan(place: Path | str) -> Plan:
    """The plan in a results directory, or in a file of the same form.

    Files of schema ``pareto_ltl.plan/1`` are read too; they hold neither promise nor navigation.
    """
    path = inside(place, "plan.json")
    content = read_document(path, PLAN_SCHEMAS)
    with shaped(path, "a plan"):
        selection = dict(content["selection"])
        return Plan(
            path=_flight(content),
            formula=content["formula"],
            atoms=tuple(content["atoms"]),
            dt=content["dt"],
            u_min=content.get("u_min", 0.0),  # missing in files of earlier versions
            u_max=content["u_max"],
            capacity=content.get("capacity"),
            epsilon=content["epsilon"],
            fidelity=content["fidelity"],
            rule=selection.pop("rule"),
            weights=tuple(selection.pop("weights")),
            rule_settings=selection,
            promise=_promise(content.get("promise")),
            navigation=_navigation(content),
            limits=_limits(content),
            prices=tuple(Price(**price) for price in content.get("prices", ())),
            covered=content.get("covered", ""),
            not_covered=content.get("not_covered", ""),
        )


def _promise(content: Mapping[str, Any] | None) -> Promise | None:
    if content is None:
        return None
    names = [field.name for field in fields(FailureRate)]
    rate, claimed = (
        FailureRate(**{name: stated[name] for name in names}) for stated in (content, content["claimed"])
    )
    return Promise(rate, claimed, _number(content["bound"]), _number(content["linearity"]), content["passed"])


def _navigation(content: Mapping[str, Any]) -> Navigation | None:
    if content.get("airspeed") is None:
        return None
    steps = len(content["u"])
    times = content["time_utc"]
    return Navigation(
        airspeed=_numbers(content, "airspeed", steps),
        time_utc=None if times is None else tuple(times),
        crs=content["crs"],
        **{
            key: None if content[key] is None else _numbers(content, key, size)
            for key, size in (("lat", steps + 1), ("lon", steps + 1), ("heading_true", steps))
        },
    )


def _numbers(content: Mapping[str, Any], key: str, size: int) -> FloatArray:
    """The numbers of ``key``, null as NaN."""
    values = np.array([_number(value) for value in content[key]], float)
    if len(values) != size:
        raise ValueError(f"{key} must have {size} entries, got {len(values)}")
    return values


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _flight(content: Mapping[str, Any]) -> PlannedPath:
    objectives = content["objectives"]  # files of schema 1 may lack mission_risk_ordered
    costs = {"mission_risk_ordered": objectives["mission_risk"]} | objectives
    risks = {name: _number(costs.pop(name)) for name in RISKS}
    flight = PlannedPath(
        t=np.array(content["t"], float),
        x=np.array(content["x"], float),
        cov=np.array(content["cov"], float),
        q=np.array(content["q"], np.int64),
        label=tuple(frozenset(names) for names in content["label"]),
        u=np.array(content["u"], float).reshape(-1, 2),
        objectives=Objectives({name: _number(value) for name, value in costs.items()}, **risks),
        origin=content["origin"],
        fixes=tuple(content.get("fixes", ())),
        order=content.get("order", ""),
    )
    steps = len(flight.t)
    shapes = {"x": (steps, 2), "cov": (steps, 2, 2), "q": (steps,), "u": (steps - 1, 2)}
    for name, shape in shapes.items():
        if getattr(flight, name).shape != shape:
            raise ValueError(f"{name} must have shape {shape}, got {getattr(flight, name).shape}")
    if len(flight.label) != steps:
        raise ValueError(f"label must have {steps} entries, got {len(flight.label)}")
    if not all(map(_is_covariance, flight.cov)):
        raise ValueError("cov must have symmetric matrices without negative eigenvalues")
    return flight


def _is_covariance(cov: FloatArray) -> bool:
    """Whether a matrix (2, 2) is symmetric and positive semidefinite, up to rounding."""
    (xx, xy), (yx, yy) = cov
    slack = 1e-9 * max(abs(xx), abs(yy))
    return bool(min(xx, yy) >= 0.0 and abs(xy - yx) <= slack and xx * yy - xy * yx >= -slack * max(xx, yy))
