"""Frozen records that travel between stages. SI units, x east, y north, one planar frame.

A stage takes settings and records and returns one new record; nothing here is changed after it
was made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.arrays import BoolArray, FloatArray, IntArray


def _shape(name: str, array: NDArray[Any], *shape: int | None) -> None:
    wanted = (
        tuple(array.shape[i] if s is None else s for i, s in enumerate(shape))
        if array.ndim == len(shape)
        else shape
    )
    if array.shape != wanted:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")


@dataclass(frozen=True, slots=True)
class Scene:
    """A map: where the robot starts, what it must visit and what it must not touch.

    Attributes
    ----------
    bounds : (2, 2) float
        South-west and north-east corner [m].
    start : (2,) float
        Position at departure [m].
    regions : mapping of name to (n, 2) float
        Regions of interest, simple polygons, counter-clockwise [m].
    obstacles : tuple of (n, 2) float
        Simple polygons, counter-clockwise [m].
    landmarks : tuple of (n, 2) float
        Convex polygons in which the robot learns its position [m] (fidelity=full).
    crs : str or None
        PROJ string of the plane; None for a plane that lies nowhere on Earth.
    time_zero : str or None
        Departure, ISO 8601 UTC; times everywhere else are seconds since then.
    """

    bounds: FloatArray
    start: FloatArray
    regions: Mapping[str, FloatArray]
    obstacles: tuple[FloatArray, ...] = ()
    crs: str | None = None
    time_zero: str | None = None
    landmarks: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        _shape("bounds", self.bounds, 2, 2)
        _shape("start", self.start, 2)
        for polygon in (*self.regions.values(), *self.obstacles, *self.landmarks):
            _shape("polygon", polygon, None, 2)


@dataclass(frozen=True, slots=True)
class WindObservations:
    """Wind readings in the plane of the scene.

    Attributes
    ----------
    times : (K,) float
        Increasing [s since time_zero].
    points : tuple of (n_k, 2) float
        Where each time's readings were taken [m].
    winds : tuple of (n_k, 2) float
        Towards +x and +y of the plane [m/s].
    source : str
        What the readings are, for the records of the run.
    """

    times: FloatArray
    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    source: str

    def __post_init__(self) -> None:
        if not len(self.times) == len(self.points) == len(self.winds):
            raise ValueError("times, points and winds must have one entry per observation time")
        if np.any(np.diff(self.times) <= 0):
            raise ValueError("observation times must increase")


@dataclass(frozen=True, slots=True)
class WindModes:
    """Karhunen-Loeve modes of the posterior: w(x) = μ(x) + ψ(x)' θ, one θ ~ N(0, I) a flight, slot and
    component.

    Attributes
    ----------
    origin : (2,) float
        South-west node of the modes' own lattice [m]; neighbours are ``spacing`` [m] apart.
    psi : (K, MX, MY, 2, P) float32
        U √Λ [m/s]; modes that a slot does not need are 0.
    rho : float
        θ_{k+1} = ρ θ_k + √(1 - ρ²) η between slots ``gap`` [s] apart; 0 independent, 1 frozen.
    gap : float
        Median time between slots [s].
    length : (K, 2) float
        Length scale of the Gaussian process [m].
    energy : (K, 2) float
        Share of the posterior variance that the modes carry.
    """

    origin: FloatArray
    spacing: float
    psi: NDArray[np.float32]
    rho: float
    gap: float
    length: FloatArray
    energy: FloatArray

    def __post_init__(self) -> None:
        _shape("psi", self.psi, None, None, None, 2, None)
        _shape("length", self.length, len(self.psi), 2)
        _shape("energy", self.energy, len(self.psi), 2)
        if not 0.0 <= self.rho <= 1.0:
            raise ValueError(f"rho must lie in [0, 1], got {self.rho}")


@dataclass(frozen=True, slots=True)
class WindField:
    """Posterior wind on a regular lattice, linear in time between its slots.

    Attributes
    ----------
    origin : (2,) float
        South-west node [m]; neighbours are ``spacing`` [m] apart.
    times : (K,) float
        Slots [s since time_zero].
    mean : (K, NX, NY, 2) float
        Expected wind [m/s]; axis 1 runs east, axis 2 runs north.
    latent_var : (K, NX, NY, 2) float
        Variance of the smooth field, per component [m²/s²].
    gust_var : (K, 2) float
        Variance of the white part, independent from step to step [m²/s²].
    hold_last : bool
        Whether the last slot stands in for all later times.
    score : mapping of name to float
        How well the fit predicts held-out readings (``gp_z_sd``, ``gp_coverage_90``).
    source : str
        What the field was made from.
    modes : WindModes or None
        How the smooth part hangs together over a flight; None where nothing is uncertain.
    gust_time : float
        Integral time scale of the white part [s] in the coherent law.
    """

    origin: FloatArray
    spacing: float
    times: FloatArray
    mean: FloatArray
    latent_var: FloatArray
    gust_var: FloatArray
    hold_last: bool = False
    score: Mapping[str, float] = field(default_factory=dict)
    source: str = ""
    modes: WindModes | None = None
    gust_time: float = 1800.0

    def __post_init__(self) -> None:
        _shape("mean", self.mean, len(self.times), None, None, 2)
        if self.latent_var.shape != self.mean.shape:
            raise ValueError(f"latent_var must match mean {self.mean.shape}, got {self.latent_var.shape}")
        _shape("gust_var", self.gust_var, len(self.times), 2)
        if self.modes is not None and len(self.modes.psi) != len(self.times):
            raise ValueError(f"modes must have {len(self.times)} slots, got {len(self.modes.psi)}")


@dataclass(frozen=True, slots=True)
class Decomposition:
    """Free space as convex cells that touch along edges and overlap nowhere.

    Attributes
    ----------
    cells : tuple of (n, 2) float
        Convex, counter-clockwise [m]. Cells with more labels come first, so that the first cell that
        holds a point on a shared boundary is the one inside the region.
    labels : tuple of frozenset of str
        The regions each cell lies in.
    doors : (D, 2) int
        Pairs of cells (i < j) that share an edge of positive length.
    obstacles : tuple of (n, 2) float
        Convex parts of the obstacles, counter-clockwise, at most 32 faces each.
    regions : mapping of name to tuple of (n, 2) float
        Convex parts of each region.
    """

    cells: tuple[FloatArray, ...]
    labels: tuple[frozenset[str], ...]
    doors: IntArray
    obstacles: tuple[FloatArray, ...]
    regions: Mapping[str, tuple[FloatArray, ...]]

    @property
    def letters(self) -> tuple[frozenset[str], ...]:
        """The label sets that a robot can read, smallest first, then by name.

        The empty one is always among them: obstacles and what lies off the map show it.
        """
        return tuple(sorted({frozenset[str](), *self.labels}, key=lambda s: (len(s), sorted(s))))


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


@dataclass(frozen=True, slots=True)
class Forest:
    """The trees of one run and the vertices that complete the mission.

    Attributes
    ----------
    accepted : (A, 2) int
        Tree and vertex of every accepted vertex.
    """

    trees: tuple[Tree, ...]
    accepted: IntArray
    seconds: float


@dataclass(frozen=True, slots=True)
class Objectives:
    """What a plan costs. ``mission_risk_paper`` is Theorem 2's f_o, ``mission_risk`` the ordered bound V,
    ``collision_risk`` the path bound R (probabilities), ``length`` in metres."""

    length: float
    mission_risk_paper: float
    mission_risk: float
    collision_risk: float


@dataclass(frozen=True, slots=True)
class Path:
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
class Front:
    """Non-dominated paths, sorted by mission risk.

    ``raw`` holds the objectives of the front before smoothing, for the record of what smoothing brought;
    ``full`` says whether mission risk is V or the paper's f_o. ``estimates`` are the failure rates of full
    fidelity's linear Monte Carlo, one a path.
    """

    paths: tuple[Path, ...]
    raw: tuple[Objectives, ...]
    hypervolume: float
    reference: FloatArray
    full: bool = False
    estimates: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Acceptance:
    """The last examination of a path of full fidelity: bound, linear estimate and simulated failure rate.

    Attributes
    ----------
    bound : float
        V + R.
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


@dataclass(frozen=True, slots=True)
class Plan:
    """The path to fly, and what it was chosen by."""

    path: Path
    formula: str
    atoms: tuple[str, ...]
    dt: float
    u_max: float
    epsilon: float
    fidelity: str
    rule: str
    weights: tuple[float, ...]
    acceptance: Acceptance | None = None


@dataclass(frozen=True, slots=True)
class Deployment:
    """Simulated flights of one plan under one wind law.

    Attributes
    ----------
    x : (n, T+1, 2) float
        Positions [m].
    accepted, collided : (n,) bool
    """

    law: str
    x: FloatArray
    accepted: BoolArray
    collided: BoolArray


@dataclass(frozen=True, slots=True)
class Study:
    """What an evaluation found.

    Attributes
    ----------
    tables : mapping of name to rows
        Each row maps column to value; a table becomes ``name.csv``.
    numbers : mapping of name to float
        Its share of ``metrics.json``.
    text : str
        The main tables as Markdown, for documents and the screen.
    pictures : mapping of name to object
        What figures draw beyond the tables (paths, flights); not written to disk.
    """

    tables: Mapping[str, tuple[Mapping[str, Any], ...]]
    numbers: Mapping[str, float]
    text: str
    pictures: Mapping[str, Any] = field(default_factory=dict)
