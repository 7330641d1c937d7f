"""What planning makes: trees, paths, the front, the plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pareto_ltl.settings import FidelityConfig, models_of
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.display import Displayed, distance_text, interval_text, probability_text


@dataclass(frozen=True, slots=True)
class Tree:
    """One search tree; vertices in the order of their creation, the root first.

    A vertex keeps its path for ever, so the first n rows are the tree as it was at n vertices.

    Attributes
    ----------
    x : (N, 2) float
        Expected position [m].
    parent, step, q, cell : (N,) int
        Parent vertex (-1 at the root), time index, automaton state and cell.
    length : (N,) float
        Length of the expected path [m].
    risk : (N, P) float
        f_o^i of Theorem 1, one column a proposition of the mission.
    swaps : (S, 2, 2 + P) float
        Objectives (d_A, length, risk...) of the original parent and of the chosen one, for every
        re-selection of a parent.
    beta : (2,) float
        Slack of Eq. (11) for length [m] and for each risk.
    seconds : float
        Time that growth took.
    reach : mapping of str to float
        Why extensions ended: counts of each cause, for the user who finds no path.
    """

    x: FloatArray
    parent: IntArray
    step: IntArray
    q: IntArray
    cell: IntArray
    length: FloatArray
    risk: FloatArray
    swaps: FloatArray
    beta: FloatArray
    seconds: float
    reach: Mapping[str, float]

    def __len__(self) -> int:
        return len(self.parent)

    def path(self, vertex: int) -> FloatArray:
        """Expected positions from the root to ``vertex``, shape (T+1, 2) [m]."""
        rows = [vertex]
        while self.parent[rows[-1]] >= 0:
            rows.append(int(self.parent[rows[-1]]))
        return self.x[rows[::-1]]


@dataclass(frozen=True, slots=True, repr=False)
class Forest(Displayed):
    """The trees of one run and the vertices that complete the mission.

    Attributes
    ----------
    accepted : (A, 2) int
        Tree and vertex of every accepted vertex.
    mission_columns : int
        How many of the first columns of ``Tree.risk`` add up to the mission risk; the rest is collision risk.
    """

    trees: tuple[Tree, ...]
    accepted: IntArray
    seconds: float
    mission_columns: int = 1

    def facts(self) -> Mapping[str, str]:
        return {
            "trees": f"{len(self.trees)}",
            "vertices": f"{sum(map(len, self.trees)):,}",
            "accepted": f"{len(self.accepted):,}",
        }


@dataclass(frozen=True, slots=True)
class Objectives:
    """What a path costs: probabilities, and the length in metres.

    ``mission_risk`` is what a plan is judged by: the bound that ``fidelity.mission_bound`` names.
    ``collision_risk`` is R. For the record stand beside it ``mission_risk_paper``, the f_o of Theorem 2 with
    the paper's covariance, and ``mission_risk_ordered``, the ordered bound V.
    """

    length: float
    mission_risk_paper: float
    mission_risk: float
    collision_risk: float
    mission_risk_ordered: float


def objective_row(o: Objectives) -> FloatArray:
    """(mission risk, collision risk, length), what paths are compared by."""
    return np.array([o.mission_risk, o.collision_risk, o.length])


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """A path evaluated exactly: the Gaussian of the position at every step.

    Attributes
    ----------
    t : (T+1,) float
        [s since time_zero]
    x : (T+1, 2) float, cov : (T+1, 2, 2) float
        Mean [m] and covariance [m²] of the position.
    q : (T+1,) int
        Automaton state after reading the label of each step.
    label : tuple of T+1 frozensets
    u : (T, 2) float
        Air-relative velocity [m/s].
    origin : str
        Where it came from, e.g. ``tree 3 vertex 1207`` or ``smoothed, weight 100``.
    fixes : tuple of int
        Steps at which the plan counts on a position fix.
    """

    t: FloatArray
    x: FloatArray
    cov: FloatArray
    q: IntArray
    label: tuple[frozenset[str], ...]
    u: FloatArray
    objectives: Objectives
    origin: str
    fixes: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class FailureRate:
    """How often the flights of a path fail in the winds of one law.

    Attributes
    ----------
    law : str
        Wind law of the flights.
    failure : float
        Share of flights that fail.
    low, high : float
        95 % interval of the rate.
    runs : int
        Number of flights, or of draws of another method.
    method : str
        ``flights`` counts simulated flights.
    """

    law: str
    failure: float
    low: float
    high: float
    runs: int
    method: str = "flights"


@dataclass(frozen=True, slots=True, repr=False)
class Front(Displayed):
    """Non-dominated paths, sorted by mission risk.

    ``raw`` holds the objectives of the front before smoothing, for the record of what smoothing brought.
    ``estimates`` are failure rates by linear Monte Carlo, one a path, with ``fidelity.judge=flights``.
    ``models`` are those that the paths were planned with: every risk holds under their wind law.
    """

    paths: tuple[PlannedPath, ...]
    raw: tuple[Objectives, ...]
    hypervolume: float
    reference: FloatArray
    estimates: tuple[float, ...] = ()
    models: FidelityConfig = field(default_factory=FidelityConfig)

    def facts(self) -> Mapping[str, str]:
        lengths = [path.objectives.length for path in self.paths] or [0.0]
        risks = [path.objectives.mission_risk for path in self.paths] or [0.0]
        return {
            "paths": f"{len(self.paths)}",
            "length": f"{distance_text(min(lengths))} to {distance_text(max(lengths))}",
            f"mission risk {self.models.mission_symbol} in {self.models.law} winds": interval_text(
                min(risks), max(risks)
            ),
        }


@dataclass(frozen=True, slots=True)
class Acceptance:
    """The last check of a path with ``fidelity.judge=flights``: its bound, its estimate, its simulated rate.

    Attributes
    ----------
    bound : float
        V + R, at most 1.
    estimate : float
        Failure rate under the linearised coherent law; NaN where it was not asked for.
    runs, failures : int
        Nonlinear flights through the coherent law's winds.
    low, high : float
        95 % Clopper-Pearson interval of the failure rate.
    passed : bool
        False where the simulation contradicts the bound, low > V + R.
    linearity : float
        Largest standard deviation of the position over the wind's length scale there.
    """

    bound: float
    estimate: float
    runs: int
    failures: int
    low: float
    high: float
    passed: bool
    linearity: float


@dataclass(frozen=True, slots=True, repr=False)
class Plan(Displayed):
    """The path to fly, and what it was chosen by."""

    path: PlannedPath
    formula: str
    atoms: tuple[str, ...]
    dt: float
    u_max: float
    epsilon: float
    fidelity: str
    rule: str
    weights: tuple[float, ...]
    acceptance: Acceptance | None = None
    covered: str = ""  # what the probabilities cover of the wind's error, in words
    not_covered: str = ""

    def __post_init__(self) -> None:
        models_of(self.fidelity)

    @property
    def models(self) -> FidelityConfig:
        """The models that the plan was made with; its risks hold under their wind law."""
        return models_of(self.fidelity)

    def facts(self) -> Mapping[str, str]:
        o, models = self.path.objectives, self.models
        return {
            "formula": self.formula,
            "length": distance_text(o.length),
            "steps": f"{len(self.path.u)}",
            f"mission risk {models.mission_symbol} in {models.law} winds": probability_text(o.mission_risk),
            f"collision risk R in {models.law} winds": probability_text(o.collision_risk),
            "fidelity": self.fidelity,
        }
