"""The key ``branches`` of ``plan.json``, schema ``pareto_ltl.plan/3``: a plan without it has schema 2."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from flight_quantities.frames import Navigation
from flight_quantities.heights import FlownAir
from pareto_ltl.planning.branching.cells import Cell
from pareto_ltl.planning.branching.records import Branch, BranchFix, Branching, TreeRow
from pareto_ltl.planning.navigation_files import read_navigation
from pareto_ltl.planning.rates import FailureRate
from pareto_ltl.planning.records import BY_STEP, Objectives, PlannedPath
from pareto_ltl.support.arrays import require_shape

DIFFERENCE = ("middle", "low", "high")


def branches_document(tree: Branching, air: FlownAir | None) -> dict[str, Any]:
    """The content of the key ``branches``, of a plan or of one of its branches."""
    fix = tree.fix
    return {
        "fix": {
            "step": fix.step,
            "place": fix.place,
            "ahead": fix.ahead,
            "sd": fix.sd,
            "available": fix.available,
            "landmark": fix.landmark,
            **({"rejoin_steps": fix.rejoin} if fix.rejoin else {}),
            **({"counter_per_s": fix.counter} if fix.counter else {}),
        },
        "rate": asdict(tree.rate),
        "alone": asdict(tree.alone),
        "difference": dict(zip(DIFFERENCE, tree.difference, strict=True)),
        "length": tree.length,
        "point": tree.point,
        "bent": None if tree.bent is None else dict(zip(DIFFERENCE, tree.bent, strict=True)),
        "front": [
            {"leaves": row.leaves, "fixes": row.fixes, "length": row.length, **asdict(row.rate)}
            for row in tree.front
        ],
        "branches": [_branch_document(branch, air) for branch in tree.branches],
    }


def _branch_document(branch: Branch, air: FlownAir | None) -> dict[str, Any]:
    path, log = branch.path, branch.navigation
    calibrated = {} if air is None else {"airspeed_calibrated": air.calibrated(log.airspeed)}
    return {
        "name": branch.name,
        "where": branch.cell.words,
        "along": branch.cell.along,
        "left": branch.cell.left,
        "share": branch.share,
        "rate": asdict(branch.rate),
        "length": path.objectives.length,
        "origin": path.origin,
        "order": path.order,
        **{field.name: getattr(log, field.name) for field in fields(Navigation)},
        **calibrated,
        **{name: getattr(path, name) for name in BY_STEP},
        **({} if branch.then is None else {"branches": branches_document(branch.then, air)}),
    }


def read_branches(content: Mapping[str, Any]) -> Branching:
    """The branches as :func:`branches_document` wrote them; ValueError for what does not fit together."""
    fix = content["fix"]
    outline = fix["landmark"]
    read = BranchFix(
        fix["step"], np.array(fix["place"], float), np.array(fix["ahead"], float), float(fix["sd"]),
        float(fix["available"]), None if outline is None else np.array(outline, float),
        int(fix.get("rejoin_steps", 0)), float(fix.get("counter_per_s", 0.0)),
    )  # fmt: skip
    if abs(math.hypot(*read.ahead) - 1.0) > 1e-6:
        raise ValueError("branches/fix/ahead must be a unit vector")
    tree = Branching(
        fix=read,
        branches=tuple(_branch(row) for row in content["branches"]),
        rate=FailureRate.stated(content["rate"]),
        alone=FailureRate.stated(content["alone"]),
        difference=_difference(content["difference"]),
        length=float(content["length"]),
        point=content["point"],
        front=tuple(
            TreeRow(row["leaves"], FailureRate.stated(row), float(row["length"]), row.get("fixes", 1))
            for row in content["front"]
        ),
        bent=None if content.get("bent") is None else _difference(content["bent"]),
    )
    tree.chosen(read.place[None])
    return tree


def _branch(row: Mapping[str, Any]) -> Branch:
    x, u = np.array(row["x"], float), np.array(row["u"], float)
    size = len(x)
    unknown = math.nan
    path = PlannedPath(
        t=np.array(row["t"], float), x=x, cov=np.array(row["cov"], float), q=np.array(row["q"], np.int64),
        label=tuple(frozenset(names) for names in row["label"]), u=u,
        objectives=Objectives({"length": float(row["length"])}, unknown, unknown, unknown, unknown),
        origin=row["origin"], order=row["order"],
    )  # fmt: skip
    for name, shape in {"t": (size,), "x": (size, 2), "cov": (size, 2, 2), "u": (size - 1, 2)}.items():
        require_shape(f"branches: {name} of branch {row['name']}", getattr(path, name), *shape)
    log = read_navigation(row)
    if log is None:
        raise ValueError(f"branches: branch {row['name']} has no airspeeds")
    cell = Cell(_ends(row["along"], "along"), _ends(row["left"], "left"))
    then = read_branches(row["branches"]) if "branches" in row else None
    if then is not None and not 1 <= then.fix.step - round(path.t[0] / (path.t[1] - path.t[0])) < size - 1:
        raise ValueError(f"branches: the second fix of branch {row['name']} is not within it")
    return Branch(row["name"], cell, float(row["share"]), path, FailureRate.stated(row["rate"]), log, then)


def _difference(content: Mapping[str, Any]) -> tuple[float, float, float]:
    middle, low, high = (float(content[key]) for key in DIFFERENCE)
    return middle, low, high


def _ends(pair: tuple[float | None, float | None], name: str) -> tuple[float, float]:
    low, high = pair
    ends = -math.inf if low is None else float(low), math.inf if high is None else float(high)
    if not ends[0] < ends[1]:
        raise ValueError(f"branches: {name} must be two ends, the lower one first, got {pair}")
    return ends
