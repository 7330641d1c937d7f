"""How the obstacles share the collision probability allowed at a step, in the convex programme."""

# ruff: noqa: ARG002 - one signature for both kinds, though not each needs all of it

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pareto_ltl.kernels.data import CollisionBound, PathBound
from pareto_ltl.planning.problem import Problem
from pareto_ltl.support.arrays import FloatArray

ROWS = 3  # half planes that bound a point, the tightest ones
KEPT = 1.4  # standard deviations that a taut line keeps from obstacles if risk is allocated
SHARE = 0.995  # share of epsilon to plan with: tangents lie below the curve, and σ changes with the path


class RiskSharing(Protocol):
    """What a collision bound requires of the programme."""

    @property
    def columns(self) -> int:
        """Columns of the variable ``near``."""

    @property
    def tangents(self) -> tuple[float, ...]:
        """Where 1 - Φ has tangents, in standard deviations."""

    @property
    def deviations(self) -> float:
        """Standard deviations kept from every face at least."""

    @property
    def kept(self) -> float:
        """Standard deviations that taut lines keep from obstacles."""

    def column(self, row: int) -> int:
        """The column of ``near`` that models half plane ``row``."""

    def room(self, gap: FloatArray, sd: FloatArray, finest: float) -> FloatArray:
        """How far each point is from violating a half plane; the largest value chooses the face."""

    def parameters(self, n: int) -> dict[str, Any]:
        """Further parameters of a programme of ``n`` points."""

    def row_constraints(
        self, given: Mapping[str, Any], near: Any, dot: Callable[[Any], Any], row: int
    ) -> list[Any]:
        """Further constraints on the risk of half plane ``row``."""

    def limits(self, given: Mapping[str, Any], near: Any, relief: Any) -> list[Any]:
        """Constraints on the risk of each step."""


@dataclass(frozen=True, slots=True)
class EqualShares:
    """Eq. (9): every obstacle has an equal share of epsilon, and every face is kept z deviations away."""

    z: float
    columns: int = 1
    tangents: tuple[float, ...] = (2.6, 3.4)  # where s ≥ z

    @property
    def deviations(self) -> float:
        """Every face is z standard deviations away."""
        return self.z

    @property
    def kept(self) -> float:
        """Taut lines keep the same z."""
        return self.z

    def column(self, row: int) -> int:
        """All half planes share one column."""
        return 0

    def room(self, gap: FloatArray, sd: FloatArray, finest: float) -> FloatArray:
        """In metres."""
        return np.asarray(gap - self.z * sd, float)

    def parameters(self, n: int) -> dict[str, Any]:
        """No further ones: z is a number."""
        return {}

    def row_constraints(
        self, given: Mapping[str, Any], near: Any, dot: Callable[[Any], Any], row: int
    ) -> list[Any]:
        """No further ones: the distance z σ limits the risk."""
        return []

    def limits(self, given: Mapping[str, Any], near: Any, relief: Any) -> list[Any]:
        """No further ones: the shares are equal beforehand."""
        return []


@dataclass(frozen=True, slots=True)
class AllocatedRisk:
    """Σ_k χ_tk ≤ epsilon: the faces of a step share it as they need it; each has a tangent at the iterate.

    Eq. (M51) of docs/mathematics_methods.md.
    """

    epsilon: float
    columns: int = ROWS
    tangents: tuple[float, ...] = (0.5, 1.2, 1.8, 2.4, 3.0)

    @property
    def deviations(self) -> float:
        """0: no face has a fixed distance."""
        return 0.0

    @property
    def kept(self) -> float:
        """``KEPT``, as the shares are not known beforehand."""
        return KEPT

    def column(self, row: int) -> int:
        """Each half plane has a column."""
        return row

    def room(self, gap: FloatArray, sd: FloatArray, finest: float) -> FloatArray:
        """In standard deviations, as faces are chosen by their risk."""
        return np.asarray(gap / np.maximum(sd, finest), float)

    def parameters(self, n: int) -> dict[str, Any]:
        """Which half planes are counted at each point, and the tangent of each at the iterate."""
        import cvxpy as cp

        return {
            "counted": cp.Parameter((n, ROWS), nonneg=True),
            "steep": cp.Parameter((n, 2 * ROWS)),
            "level": cp.Parameter((n, ROWS)),
        }

    def row_constraints(
        self, given: Mapping[str, Any], near: Any, dot: Callable[[Any], Any], row: int
    ) -> list[Any]:
        """``near`` lies above the tangent at the iterate."""
        return [near >= given["level"][:, row] - dot(given["steep"])]

    def limits(self, given: Mapping[str, Any], near: Any, relief: Any) -> list[Any]:
        """The risks that are counted sum to at most ``SHARE`` of epsilon."""
        import cvxpy as cp

        counted = cp.sum(cp.multiply(given["counted"], near), axis=1)
        return [counted <= SHARE * self.epsilon + 0.05 * relief]


def risk_sharing(problem: Problem) -> RiskSharing:
    """How the risk of a step is shared under the collision bound of ``problem``."""
    bound: CollisionBound = problem.world.collision
    return (
        AllocatedRisk(float(bound.epsilon)) if isinstance(bound, PathBound) else EqualShares(float(bound.z))
    )
