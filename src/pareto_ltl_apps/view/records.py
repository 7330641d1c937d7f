"""The records from which figures are drawn, of a run or of a study, and from which a page is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from flight_quantities.medium import WATER, Medium, medium_of

if TYPE_CHECKING:
    from numpy.random import SeedSequence

    from pareto_ltl import Scene, WindField
    from pareto_ltl.extend import (
        Automaton,
        Decomposition,
        Deployment,
        FlownAir,
        Forecast,
        Forest,
        Front,
        Height,
        Plan,
        Problem,
    )
    from pareto_ltl.support.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """The records of a run that its figures show.

    Attributes
    ----------
    decomposition, wind : or None
        None in the figure of a single record, which shows neither cells nor wind.
    forest, front, plan : or None
        None if the run did not make it; the map then states that there is no plan.
    deployments : mapping of wind law to Deployment
        Simulated flights; the first ``report.paths`` of each law are drawn.
    forecasts : mapping of wind law to Forecast
        V and R of the plan under each law.
    """

    scene: Scene
    decomposition: Decomposition | None = None
    wind: WindField | None = None
    forest: Forest | None = None
    front: Front | None = None
    plan: Plan | None = None
    deployments: Mapping[str, Deployment] = field(default_factory=dict)
    forecasts: Mapping[str, Forecast] = field(default_factory=dict)

    @property
    def medium(self) -> Medium:
        """Water if the wind is a current, else air."""
        return medium_of(None if self.wind is None else self.wind.level)


@dataclass(frozen=True, slots=True)
class Origin:
    """The origin of a result, from ``run.json`` and ``config_resolved.yaml``.

    Attributes
    ----------
    command : str
        The command line as typed; empty for a run from Python.
    facts : mapping of str to str
        Seed, versions, fingerprints.
    inputs : mapping of str to str
        SHA-256 of each file that was read, by its name without folders.
    settings : str
        All settings as YAML.
    """

    command: str
    facts: Mapping[str, str]
    inputs: Mapping[str, str]
    settings: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownRun(DrawnRun):
    """The records of a run that its page shows; None for a record that the run did not make.

    Attributes
    ----------
    height : Height
        The height of the flight.
    air : FlownAir or None
        The air there; None in the water.
    why : str
        Why there is no plan; empty if there is one.
    runs : int
        Number of simulated flights of each point of the front, for the times of failures.
    seeds : SeedSequence
        Seeds of the flights of the stage ``deployment``, so that all points meet the same winds.
    """

    wind: WindField
    name: str
    seeds: SeedSequence
    origin: Origin
    height: Height
    air: FlownAir | None
    runs: int
    why: str
    automaton: Automaton | None
    problem: Problem | None

    @property
    def medium(self) -> Medium:
        """What the robot moves in: water if it is at a depth, or the wind is a current."""
        return WATER if self.height.metres < 0.0 else medium_of(self.wind.level)


@dataclass(frozen=True, slots=True)
class Compared:
    """Scores of promises minus scores of others for the same missions; below 0, the promises are better.

    Attributes
    ----------
    name : str
        Of the others.
    missions, situations : int
        Numbers of missions that both have, and of their weather situations.
    brier : float
        Brier score of the others.
    mean, low, high, p_value : float
        Difference of the Brier scores with its 95 % interval and two-sided p value (Diebold and Mariano);
        NaN if the scores never differ.
    situation_low, situation_high : float
        95 % interval with a situation as one trial; infinite for one situation.
    curve, curve_low, curve_high : (T,) float
        Difference of the elementary scores at the thresholds of the diagrams, with 95 % intervals for each.
    """

    name: str
    missions: int
    situations: int
    brier: float
    mean: float
    low: float
    high: float
    p_value: float
    situation_low: float
    situation_high: float
    curve: FloatArray
    curve_low: FloatArray
    curve_high: FloatArray


@dataclass(frozen=True, slots=True)
class PromiseDiagrams:
    """The promises of a forecast test against what came, as ``pareto-ltl scores`` draws them.

    Attributes
    ----------
    fidelity : str
        The preset of planning; the promises are made in its wind law.
    promised, realised : (N,) float
        Rates of failure, in the order of the promises.
    isotonic, low, high : (N,) float
        The isotonic rates, and the range in which the isotonic rates of exact promises lie.
    parts : mapping of name to float
        The Brier score and its parts.
    thresholds : (T,) float
        Probabilities above which somebody decides not to fly.
    curves : mapping of name to (T,) float
        Mean elementary scores: of the promises, of simple ones, of another test.
    difference : Compared
        The comparison that is drawn.
    """

    fidelity: str
    promised: FloatArray
    realised: FloatArray
    isotonic: FloatArray
    low: FloatArray
    high: FloatArray
    parts: Mapping[str, float]
    thresholds: FloatArray
    curves: Mapping[str, FloatArray]
    difference: Compared
