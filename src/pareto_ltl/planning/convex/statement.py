"""The convex programme of a step as one statement in cvxpy.

:mod:`~.programme` fills in its parameters and solves it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from pareto_ltl.planning.separation import ROWS

RELIEF = 50.0  # penalty for violating a constraint by a full step; above every multiplier observed
PIECES = (0.5, 1.0, 1.5, 2.0, 2.4, 2.8, 3.2, 3.6, 4.1)  # tangents of 1 - Φ for witnesses
LINE_PIECES = (1.5, 2.4)  # tangents of 1 - Φ for lines, besides the one at the iterate


@dataclass(frozen=True, slots=True)
class Shape:
    """All that the statement depends on: sizes, B⁻¹, and whether there is a least airspeed."""

    steps: int
    witnesses: int
    faces: int
    b_inv: tuple[tuple[float, float], ...]
    slowest: bool


@dataclass(frozen=True, slots=True)
class _Unknowns:
    """Variables of the programme: points, relief of each, lengths, risks of lines and of witnesses."""

    x: Any
    y: Any
    relief: Any
    length: Any
    chi: Any
    rho: Any
    at: Any


def _dot(c: Any, row: int, u: Any, v: Any) -> Any:
    """c' (u, v) of column pair ``row`` of ``c``."""
    import cvxpy as cp

    return cp.multiply(c[:, 2 * row], u) + cp.multiply(c[:, 2 * row + 1], v)


class LineLimit(NamedTuple):
    """A constraint of line ``k`` of each segment at one end, "0" or "1".

    A full step of clearance eases it by ``share`` times the length of the rows of the parameter ``per``,
    which is 1 without a name.
    """

    constraint: Any
    end: str
    k: int
    share: float
    per: str


@dataclass(frozen=True, slots=True)
class Statement:
    """The programme in cvxpy: its parameters by name, its variables, and the constraints that have prices."""

    form: Any
    given: Mapping[str, Any]
    unknowns: _Unknowns
    airspeed: Any
    longest: Any
    lines: tuple[LineLimit, ...]


def state(shape: Shape, sizes: Mapping[str, tuple[int, ...]]) -> Statement:
    """The programme about an iterate x̄ for paths of at most ``steps`` steps.

        minimise    λ_l Σ_t l_t + λ_r (Σ_tk χ_tk + Σ_wj ρ_wj) + g'x + ½ Σ_t ‖L_t' (x_t - x̄_t)‖² + relief
        subject to  ‖B⁻¹ (x_{t+1} - F_t x_t - g_t)‖ ≤ airspeed left,      F_t = A + dt Dμ(x̄_t)
                    û_t' B⁻¹ (x_{t+1} - F_t x_t - g_t) ≥ least airspeed    along the last control
                    ‖x_{t+1} - x_t‖ ≤ l_t,    Σ_t l_t ≤ L_max
                    c_tk' x_e ≥ h_tk + z σ_e      for both ends e of segment t and its closest lines k
                    χ_tk ≥ tangents of 1 - Φ at (c_tk' x_e - h_tk) / σ_e, one of them the tangent at x̄
                    Σ_k χ_tk ≤ left_t          of ε: see Programme._limits, Eq. (M51)
                    a_j' x_w ≤ b_j              at the witness steps
                    ρ_wj ≥ tangents of 1 - Φ at (b_j - a_j' x_w) / σ_j, one of them the tangent at x̄
                    |x_t - x̄_t| ≤ trust,       x_t on the map

    Relief, a penalised slack variable of each point, makes every instance feasible, so that an iterate which
    violates a constraint can be corrected. Lengths are in full steps (u_max dt); positions count from the
    middle of the map. ``sizes`` are the parameters, with the sizes of their values; scalars are not negative.

    Eq. (M50) of docs/mathematics_methods.md.
    """
    import cvxpy as cp

    n = shape.steps + 1
    v = _Unknowns(
        x=cp.Variable(n), y=cp.Variable(n), relief=cp.Variable(n, nonneg=True), length=cp.Variable(n - 1),
        chi=cp.Variable((n - 1, ROWS), nonneg=True),
        rho=cp.Variable((shape.witnesses, shape.faces), nonneg=True) if shape.witnesses else None,
        at=cp.Variable((shape.witnesses, 2)) if shape.witnesses else None,
    )  # fmt: skip
    given = {name: cp.Parameter(size, nonneg=not size) for name, size in sizes.items()}
    bend = [
        cp.multiply(given["root"][:, 0], v.x)
        + cp.multiply(given["root"][:, 1], v.y)
        - given["root_at"][:, 0],
        cp.multiply(given["root"][:, 2], v.y) - given["root_at"][:, 1],
    ]
    risks = cp.sum(v.chi) if v.rho is None else cp.sum(v.chi) + cp.sum(v.rho)
    cost = (
        given["per_length"] * cp.sum(v.length) + given["weight"] * risks + RELIEF * cp.sum(v.relief)
        + given["gradient"][:, 0] @ v.x + given["gradient"][:, 1] @ v.y
        + 0.5 * cp.sum_squares(cp.hstack(bend))
    )  # fmt: skip
    airspeed, longest = _airspeed(shape, given, v), cp.sum(v.length) <= given["longest"]
    lines = tuple(_clearance(given, v))
    constraints = [
        airspeed, longest, *_motion(shape, given, v), *(row.constraint for row in lines),
        cp.sum(v.chi, axis=1) <= given["left"] + 0.05 * (v.relief[:-1] + v.relief[1:]),
        *_visits(shape, given, v),
    ]  # fmt: skip
    return Statement(cp.Problem(cp.Minimize(cost), constraints), given, v, airspeed, longest, lines)


def _airspeed(shape: Shape, given: Mapping[str, Any], v: _Unknowns) -> Any:
    """B⁻¹ (x_{t+1} - F_t x_t - g_t), the control of each step, within the airspeed left, in u_max."""
    import cvxpy as cp

    x, y = v.x, v.y
    rows = (
        shape.b_inv[k][0] * x[1:] + shape.b_inv[k][1] * y[1:]
        - _dot(given["F"], k, x[:-1], y[:-1]) - given["g"][:, k]
        for k in (0, 1)
    )  # fmt: skip
    return cp.SOC(given["cap"] + v.relief[1:], cp.vstack(list(rows)), axis=0)


def _motion(shape: Shape, given: Mapping[str, Any], v: _Unknowns) -> Iterator[Any]:
    """The least airspeed, the length of each step, the trust region and the map."""
    import cvxpy as cp

    x, y = v.x, v.y
    if shape.slowest:
        along = _dot(given["ahead"], 0, x[1:], y[1:]) - _dot(given["behind"], 0, x[:-1], y[:-1])
        yield along + v.relief[1:] >= given["floor"]
    yield cp.SOC(v.length, cp.vstack([x[1:] - x[:-1], y[1:] - y[:-1]]), axis=0)
    for k, u in enumerate((x, y)):
        yield u >= given["low"][:, k]
        yield u <= given["high"][:, k]


def _clearance(given: Mapping[str, Any], v: _Unknowns) -> Iterator[LineLimit]:
    """Both ends of each segment beyond its lines, and the risk of being on the other side."""
    ends = {"0": (v.x[:-1], v.y[:-1], v.relief[:-1]), "1": (v.x[1:], v.y[1:], v.relief[1:])}
    for k in range(ROWS):
        for end, (x, y, relief) in ends.items():
            beyond = _dot(given["c"], k, x, y) + relief >= given[f"need{end}"][:, k]
            yield LineLimit(beyond, end, k, 1.0, "")
            s = _dot(given[f"c_sd{end}"], k, x, y) - given[f"h_sd{end}"][:, k]
            for at, piece in zip(LINE_PIECES, tail_tangents(LINE_PIECES, s), strict=True):
                yield LineLimit(v.chi[:, k] >= piece, end, k, density(at), "c_sd")
            level = given[f"level{end}"][:, k] - _dot(given[f"steep{end}"], k, x, y)
            yield LineLimit(v.chi[:, k] >= level, end, k, 1.0, "steep")


def _visits(shape: Shape, given: Mapping[str, Any], v: _Unknowns) -> Iterator[Any]:
    """Witness steps: inside the region, and the risk of missing it."""
    if not shape.witnesses:
        return
    yield v.at[:, 0] == given["pick"] @ v.x
    yield v.at[:, 1] == given["pick"] @ v.y
    for k in range(shape.faces):
        s = given["b"][:, k] - _dot(given["a"], k, v.at[:, 0], v.at[:, 1])
        yield s >= given["inside"][:, k]
        for piece in tail_tangents(PIECES, s):
            yield v.rho[:, k] >= piece
        yield v.rho[:, k] >= given["height"][:, k] + _dot(given["slope"], k, v.at[:, 0], v.at[:, 1])


def tail_tangents(points: Sequence[float], s: Any) -> list[Any]:
    """Tangents of 1 - Φ at ``points``: it is convex for s ≥ 0, and their maximum models it."""
    return [0.5 * math.erfc(m / math.sqrt(2)) - density(m) * (s - m) for m in points]


def density(z: float) -> float:
    """φ(z) of the standard normal law."""
    return math.exp(-z * z / 2) / math.sqrt(2 * math.pi)
