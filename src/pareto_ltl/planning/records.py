"""Records that planning makes: trees, paths, the front, the plan."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from careful_io.texts import distance_text, interval_text, probability_text
from flight_quantities.frames import Navigation
from flight_quantities.heights import FlownAir, Height
from pareto_ltl.planning.costs import cost_named
from pareto_ltl.planning.costs.duration import hours_text
from pareto_ltl.planning.limits import Price, Remedy, SegmentLimits, WorstSegment, remedies_text
from pareto_ltl.planning.rates import FailureRate, Promise
from pareto_ltl.settings import FidelityConfig
from pareto_ltl.settings.fidelity import models_of
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.support.display import Displayed, branched_text
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl.wind.coverage import level_gap
from pareto_ltl.world.projection import Frame
from pareto_ltl.world.scene import Scene

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

    from pareto_ltl.planning.branching.records import Branching

NO_PROMISE = "no failure rate is promised: the law of the plan does not explain what was measured"


@dataclass(frozen=True, slots=True, repr=False)
class Tree(Displayed):
    """One search tree; vertices in the order of their creation, the root first.

    The path to a vertex never changes, so the first n rows are the tree as it was at n vertices.

    Attributes
    ----------
    x : (N, 2) float
        Expected position [m].
    parent, step, q, cell : (N,) int
        Parent vertex (-1 at the root), time index, automaton state and cell.
    length : (N,) float
        Length of the expected path [m].
    risk : (N, P) float
        Mission risk: f_o^i of Theorem 1 for each proposition of the mission.
    swaps : (S, 2, 2 + P) float
        Objectives (d_A, length, risk...) of the original parent and of the chosen one, for every
        re-selection of a parent.
    beta : (2,) float
        Slack of Eq. (11) for length [m] and for each risk.
    seconds : float
        Time that growth took [s].
    reach : mapping of str to float
        Number of extensions that each cause ended; the message for a run without a path is made of them.
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

    def facts(self) -> Mapping[str, str]:
        """Numbers of vertices and automaton states, and the length of the longest path."""
        return {
            "vertices": f"{len(self):,}",
            "longest path": distance_text(float(self.length.max(initial=0.0))),
            "automaton states reached": f"{len(np.unique(self.q))}",
        }


@dataclass(frozen=True, slots=True, repr=False)
class Forest(Displayed):
    """The trees of one run and the vertices that complete the mission.

    Attributes
    ----------
    accepted : (A, 2) int
        Tree and vertex of every accepted vertex.
    """

    trees: tuple[Tree, ...]
    accepted: IntArray
    seconds: float

    def facts(self) -> Mapping[str, str]:
        """Numbers of trees, vertices and accepted vertices."""
        return {
            "trees": f"{len(self.trees)}",
            "vertices": f"{sum(map(len, self.trees)):,}",
            "accepted": f"{len(self.accepted):,}",
        }


@dataclass(frozen=True, slots=True)
class Objectives:
    """The costs and probabilities by which paths are compared.

    ``costs`` are by name (``planning/costs/``): length [m], energy [J] of a robot with a power curve, and
    the costs of ``selection.costs``; all paths of a front have the same ones.
    ``mission_risk`` is the bound that ``fidelity.mission_bound`` names; plans are judged by it.
    ``collision_risk`` is R. Two bounds are reported in every case: ``mission_risk_paper``, the f_o of Theorem
    2 with the paper's covariance, and ``mission_risk_ordered``, the ordered bound V.
    """

    costs: Mapping[str, float]
    mission_risk_paper: float
    mission_risk: float
    collision_risk: float
    mission_risk_ordered: float

    @property
    def length(self) -> float:
        """Length of the expected path [m]."""
        return self.costs["length"]

    @property
    def further_costs(self) -> dict[str, float]:
        """The costs other than length, by name."""
        return {name: value for name, value in self.costs.items() if name != "length"}

    def as_dict(self) -> dict[str, float]:
        """All numbers by name, as in ``plan.json``: length, probabilities, further costs."""
        risks = {name: getattr(self, name) for name in RISKS}
        return {"length": self.length} | risks | self.further_costs


RISKS = tuple(part.name for part in fields(Objectives) if part.name != "costs")


def objective_row(o: Objectives) -> FloatArray:
    """Mission risk, collision risk and all costs, the length first: paths are compared by these."""
    return np.array([o.mission_risk, o.collision_risk, *o.costs.values()])


BY_STEP = ("t", "x", "cov", "q", "label", "u")  # attributes of a path with an entry for each step


@dataclass(frozen=True, slots=True, repr=False)
class PlannedPath(Displayed):
    """A path evaluated exactly: the Gaussian of the position at every step.

    Attributes
    ----------
    t : (T+1,) float
        Times [s since time_zero].
    x : (T+1, 2) float
        Means of the position [m].
    cov : (T+1, 2, 2) float
        Covariances of the position [m²].
    q : (T+1,) int
        Automaton state after reading the label of each step.
    label : tuple of T+1 frozensets
        Propositions that hold at each step.
    u : (T, 2) float
        Air-relative velocity [m/s].
    origin : str
        How the path was made, e.g. ``tree 3 vertex 1207`` or ``smoothed, weight 100``.
    fixes : tuple of int
        Steps at which the plan counts on a position fix.
    order : str
        Mission order: the letters that change the automaton state, ``a>b>c`` (:meth:`Problem.mission_order`).
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
    order: str = ""

    def facts(self) -> Mapping[str, str]:
        """Length, steps, time, mission order and origin."""
        return {
            "length": distance_text(self.objectives.length),
            "steps": f"{len(self.u)}",
            "time": f"{(self.t[-1] - self.t[0]) / 3600:.1f} h",
            "order": self.order.replace(">", " > ") or "no visit",
            "origin": self.origin or "unknown",
        }


@dataclass(frozen=True, slots=True, repr=False)
class Front(Displayed):
    """Non-dominated paths.

    With ``fidelity.judge=bound`` they are compared by (mission risk, collision risk, length) and sorted by
    mission risk; with ``flights`` by (failure rate, length) and sorted by failure rate. Further costs are
    further objectives.

    Attributes
    ----------
    raw : tuple of Objectives
        The front before refinement, to show what refinement improved.
    hypervolume : float
        Share of the box between 0 and ``reference`` that the front dominates.
    reference : (1 + C,) or (2 + C,) float
        Upper corner of that box: 1 for each probability, then each of C costs, the length first.
    rates, raw_rates : tuple of FailureRate
        With ``flights``: the rate of each path and of each of ``raw``.
    failed : (P, n) bool
        With ``flights``: which flights fail. All paths meet the same winds, so a difference of two rates is
        more precise than each rate.
    models : FidelityConfig
        Models that the paths were planned with: every risk holds under their wind law.
    judged : (J, 2 + C) float
        A row for every path that was compared for the front, also for those that are not on it. With
        ``flights``: the number of its flights, how many of them fail, and all costs; a path that is certainly
        worse than another has fewer flights. With ``bound``: mission risk, collision risk and costs. Empty
        for fronts of earlier versions.
    """

    paths: tuple[PlannedPath, ...]
    raw: tuple[Objectives, ...]
    hypervolume: float
    reference: FloatArray
    rates: tuple[FailureRate, ...] = ()
    raw_rates: tuple[FailureRate, ...] = ()
    failed: BoolArray = field(default_factory=lambda: np.zeros((0, 0), bool))
    models: FidelityConfig = field(default_factory=FidelityConfig)
    judged: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        if self.rates and len(self.rates) != len(self.paths):
            raise ValueError(f"{len(self.paths)} paths need as many rates, got {len(self.rates)}")
        if self.failed.ndim != 2 or len(self.failed) != len(self.rates):
            raise ValueError(f"{len(self.rates)} rates need flights as rows, got shape {self.failed.shape}")

    def to_pandas(self) -> DataFrame:
        """The paths as a table of pandas, with the columns of ``front.csv``; its index is their number."""
        from pareto_ltl.planning.plan_files import front_table

        EXTRAS.require("netcdf", "Front.to_pandas")
        import pandas as pd

        columns, rows = front_table(self)
        return pd.DataFrame(rows, columns=list(columns)).set_index(columns[0])

    def to_xarray(self) -> Dataset:
        """The paths as a dataset of xarray: the columns of ``front.csv`` with units, positions and times."""
        from pareto_ltl.planning.front_dataset import front_dataset

        EXTRAS.require("netcdf", "Front.to_xarray")
        return front_dataset(self)

    def facts(self) -> Mapping[str, str]:
        """Number of paths, and the ranges of their objectives."""
        lengths = [path.objectives.length for path in self.paths] or [0.0]
        facts = {
            "paths": f"{len(self.paths)}",
            "length": f"{distance_text(min(lengths))} to {distance_text(max(lengths))}",
        }
        if self.rates:
            failures = [rate.failure for rate in self.rates]
            return facts | {
                f"failure in {self.rates[0].law} winds": interval_text(min(failures), max(failures))
            }
        risks = [path.objectives.mission_risk for path in self.paths] or [0.0]
        symbol = f"mission risk {self.models.mission_symbol} in {self.models.law} winds"
        return facts | {symbol: interval_text(min(risks), max(risks))}


@dataclass(frozen=True, slots=True, repr=False)
class Plan(Displayed):
    """The path to fly, and how it was chosen.

    Attributes
    ----------
    u_min, u_max : float
        Least and largest airspeed of the robot [m/s].
    rule : str
        Rule of selection; ``weights`` belong to rule ``weighted``.
    rule_settings : mapping of str
        The other settings that the rule read, if any, e.g. ``{"alpha": 0.02}``.
    promise : Promise or None
        With ``fidelity.judge=flights``.
    capacity : float or None
        Energy that the robot can use [J]; None where it is not known.
    covered, not_covered : str
        Sentences that say which parts of the wind's error the probabilities cover, and which not.
    limits : SegmentLimits or None
        None without barriers, and in files of earlier versions.
    prices : tuple of Price
        What easier limits would save, the largest of each kind first.
    height : Height or None
        The height of the flight; None in files of earlier versions.
    air : FlownAir or None
        The air there, which gives the calibrated airspeeds; None in the water, and in earlier files.
    worst : WorstSegment or None
        The segment that is most likely to collide, where flights judge; None in files of earlier versions.
    epsilon_kept : bool
        False if ``worst`` is above ``epsilon``: no path keeps it, and the plan is the nearest one.
    remedies : tuple of Remedy
        Changes that were tried if epsilon is not kept, or if hardly any flight succeeds.
    branching : Branching or None
        What to fly after a position fix (``branch.leaves``); None: the plan has no branches. Everything else
        is about the plan that is flown without a fix.
    """

    NO_PROMISE: ClassVar[str] = NO_PROMISE
    path: PlannedPath
    formula: str
    atoms: tuple[str, ...]
    dt: float
    u_max: float
    epsilon: float
    fidelity: str
    rule: str
    weights: tuple[float, ...]
    rule_settings: Mapping[str, Any] = field(default_factory=dict)
    promise: Promise | None = None
    navigation: Navigation | None = None  # None in files of schema pareto_ltl.plan/1
    covered: str = ""
    not_covered: str = ""
    u_min: float = 0.0
    capacity: float | None = None
    limits: SegmentLimits | None = None
    prices: tuple[Price, ...] = ()
    height: Height | None = None
    air: FlownAir | None = None
    worst: WorstSegment | None = None
    epsilon_kept: bool = True
    remedies: tuple[Remedy, ...] = ()
    branching: Branching | None = None

    def __post_init__(self) -> None:
        models_of(self.fidelity)

    def answer(self, flows: str) -> str:
        """How many flights fail, in a sentence, in ``flows``: winds or currents; empty without a promise.

        Of a plan with branches, how many fail if fixes are taken, and how many without.
        """
        if self.promise is None:
            return ""
        if self.branching is None:
            return self.promise.answer(flows, self.level_gap)
        sentence = replace(self.promise, rate=self.branching.rate).answer(flows, self.level_gap)
        return branched_text(sentence, self.promise.rate.failure, self.promise.floor)

    @property
    def __geo_interface__(self) -> dict[str, Any]:
        """The path as a GeoJSON line with formula, length and promise; in metres without a place on Earth."""
        from pareto_ltl.world.geo_interface import line_feature

        about: dict[str, Any] = {"formula": self.formula, "length_m": self.path.objectives.length}
        if self.promise is not None:
            about["failure"] = self.promise.rate.failure
        known = self.navigation
        return line_feature(Frame(None if known is None else known.crs), self.path.x, about)

    @property
    def models(self) -> FidelityConfig:
        """The models that the plan was made with; its risks hold under their wind law."""
        return models_of(self.fidelity)

    @property
    def level_gap(self) -> str:
        """That the wind has another level than the flight, so that nothing is promised; else empty."""
        return level_gap(self.not_covered)

    @property
    def alarmed(self) -> bool:
        """Whether the plan was made after an alarm: its law does not hold, and it has no probabilities."""
        return math.isnan(self.path.objectives.mission_risk)

    def breach(self, scene: Scene) -> str:
        """Where the plan, the path nearest to ``epsilon``, breaks it, with the names on the map ``scene``."""
        assert self.worst is not None
        begin, end = (hours_text(float(t)) for t in self.path.t[self.worst.step : self.worst.step + 2])
        fails = "" if self.promise is None else f"; it fails {self.promise.rate}"
        return (
            f"no path keeps planner.epsilon = {probability_text(self.epsilon)}, and the plan is the path "
            f"nearest to it: segment {self.worst.step + 1} of {len(self.path.u)}, {begin} to {end} after "
            f"departure, collides with a probability of {probability_text(self.worst.probability)}, "
            f"closest to {scene.barrier_title(self.worst.nearest)}{fails}"
        )

    @property
    def what_helps(self) -> str:
        """The figures of changes that were tried and help, for people; empty if there are none."""
        return remedies_text(self.remedies) if self.remedies else ""

    def without_promise(self) -> Plan:
        """The plan without any probability, for a flight whose wind is outside the law."""
        costs_alone = Objectives(self.path.objectives.costs, **dict.fromkeys(RISKS, math.nan))
        return replace(
            self, path=replace(self.path, objectives=costs_alone), promise=None, limits=None, prices=(),
            worst=None, remedies=(),
        )  # fmt: skip

    def facts(self) -> Mapping[str, str]:
        """Formula, length, steps, further costs and what the plan promises."""
        o, models = self.path.objectives, self.models
        promised = {} if self.promise is None else {"fails": str(self.promise.rate)}
        if (tree := self.branching) is not None:
            promised = {f"fails, with {len(tree.branches)} branches": str(tree.rate)} | promised
        risks = {
            f"mission risk {models.mission_symbol} in {models.law} winds": o.mission_risk,
            f"collision risk R in {models.law} winds": o.collision_risk,
        }
        return {
            "formula": self.formula,
            "length": distance_text(o.length),
            "steps": f"{len(self.path.u)}",
            **{name: cost_named(name).text(value) for name, value in o.further_costs.items()},
            **(
                {"fails": NO_PROMISE}
                if self.alarmed
                else promised | {name: probability_text(risk) for name, risk in risks.items()}
            ),
            "fidelity": self.fidelity,
        }
