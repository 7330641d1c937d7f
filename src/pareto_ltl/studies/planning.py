"""Plans for studies: the stages of ``pipelines/plan.yaml``, called by name, without a results directory.

A plan made here is the plan that the command line makes with the same settings: the stages are the same
functions, and each draws from the stream that the runner gives it.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any
from zlib import crc32

from numpy.random import SeedSequence

from pareto_ltl.run import stages
from pareto_ltl.settings import Settings

if TYPE_CHECKING:
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.support.arrays import FloatArray
    from pareto_ltl.wind.records import WindField

OF_THE_LATTICE = ("origin", "spacing", "times", "hold_last", "score", "source")


def stream(seed: int, stage: str) -> SeedSequence:
    """What the runner gives ``stage`` in a run with ``seed``; always a fresh one, since spawning counts."""
    return SeedSequence(seed, spawn_key=(crc32(stage.encode()),))


@dataclass(slots=True)
class Workshop:
    """Makes records by name from ``settings`` and the records it was given."""

    settings: Settings
    records: dict[str, Any] = field(default_factory=dict)

    def make(self, name: str) -> Any:
        """Record ``name``, and before it all that it needs."""
        if name not in self.records:
            self.records[name] = self._call(stages.STAGES.get(name) or stages.INGREDIENTS[name], name)
        return self.records[name]

    def _call(self, function: Any, name: str) -> Any:
        sections = {f"{f.name}_cfg": getattr(self.settings, f.name) for f in fields(self.settings)}
        ambient = {"settings": self.settings, "seeds": stream(self.settings.seed, name), "progress": None}
        known = ambient | sections
        arguments = {}
        for parameter in inspect.signature(function).parameters.values():
            if parameter.name in known:
                arguments[parameter.name] = known[parameter.name]
            elif parameter.default is parameter.empty or parameter.name in self.records:
                arguments[parameter.name] = self.make(parameter.name)
        return function(**arguments)

    def with_seed(self, seed: int) -> Workshop:
        """The same problem for another seed; nothing random is taken along."""
        return Workshop(replace(self.settings, seed=seed), dict(self.records))


def with_wind(settings: Settings, world: Mapping[str, Any]) -> dict[str, Any]:
    """``world`` with its wind field, for all planners that believe in the same one."""
    return dict(world) | {"wind": Workshop(settings, dict(world)).make("wind")}


def still(wind: WindField) -> WindField:
    """The field of a planner that knows of no wind: no mean, no uncertainty, whatever a field consists of."""
    import numpy as np

    values = {f.name: getattr(wind, f.name) for f in fields(wind) if f.name not in OF_THE_LATTICE}
    zeros: dict[str, Any] = {
        name: np.zeros_like(value) for name, value in values.items() if isinstance(value, np.ndarray)
    }
    gone: dict[str, Any] = {name: None for name, value in values.items() if is_dataclass(value)}  # modes
    return replace(wind, **zeros, **gone)


def unsmoothed(settings: Settings) -> Settings:
    """The published planner: the paths of the trees as they are."""
    return replace(settings, fidelity=replace(settings.fidelity, refine="none"))


def fly(
    truth: Problem, u: FloatArray, runs: int, law: str, seed: int, mean: FloatArray | None = None
) -> Deployment:
    """Fly ``u`` in the winds that the deployment of a run with ``seed`` draws; feedback holds on to ``mean``.

    One seed, one law: the same winds for all plans (common random numbers).
    """
    from pareto_ltl.simulation import flights as deployment

    children = dict(zip(deployment.LAWS, stream(seed, "deployment").spawn(len(deployment.LAWS)), strict=True))
    return deployment.fly(truth, u, runs, law, children[law], mean)
