"""The records from which the page is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from pareto_ltl.support.medium import WATER, Medium, medium_of

if TYPE_CHECKING:
    from numpy.random import SeedSequence

    from pareto_ltl.exports.exported import Height
    from pareto_ltl.logic import Automaton
    from pareto_ltl.planning.evaluate import Forecast
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Forest, Front, Plan
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.world.scene import Scene


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


@dataclass(frozen=True, slots=True)
class ShownRun:
    """The records of a run that its page shows; None for a record that the run did not make.

    Attributes
    ----------
    height : Height
        Height of the flight in exported files.
    why : str
        Why there is no plan; empty if there is one.
    runs : int
        Number of simulated flights of each point of the front, for the times of failures.
    seeds : SeedSequence
        Seeds of the flights of the stage ``deployment``, so that all points meet the same winds.
    """

    name: str
    scene: Scene
    wind: WindField
    seeds: SeedSequence
    origin: Origin
    height: Height
    runs: int = 500
    why: str = ""
    automaton: Automaton | None = None
    problem: Problem | None = None
    forest: Forest | None = None
    front: Front | None = None
    plan: Plan | None = None
    deployments: Mapping[str, Deployment] = field(default_factory=dict)
    forecasts: Mapping[str, Forecast] = field(default_factory=dict)

    @property
    def medium(self) -> Medium:
        """What the robot moves in: water if it is at a depth, or the wind is a current."""
        return WATER if self.height.metres < 0.0 else medium_of(self.wind.level)
