"""The planning problem: its records, and the arrays that kernels read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.planning.costs import ALWAYS, Cost
from pareto_ltl.planning.pack_logic import Reading
from pareto_ltl.planning.power import EnergyModel
from pareto_ltl.planning.turns import Turns, TurnsOnTheSpot
from pareto_ltl.settings import FidelityConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.display import Displayed
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene


@dataclass(frozen=True, slots=True, eq=False, repr=False, weakref_slot=True)
class Problem(Displayed):
    """The planning problem; every later stage reads the same arrays, so that a path costs the same anywhere.

    Attributes
    ----------
    world : kernels.data.World
        The models that planning uses, their types picked by ``fidelity``.
    laws : mapping of name to law
        Every wind law, for forecasts and simulation.
    theorem2, ordered : mission bounds
        Both, since every path reports both.
    labels : tuple of frozenset of str
        The propositions that hold in each cell at any time.
    obstacles : Faces
        Convex parts of the obstacles; the collision bound also has the walls (:attr:`barriers`).
    start_variance : float
        Variance of the start position, in each direction [m²].
    epsilon : float
        Collision probability allowed at a step (Eq. 4).
    max_steps : int
        Longest path.
    energy : EnergyModel or None
        Power curve and capacity of a robot that has them.
    costs : tuple of Cost
        The costs that paths are compared by.
    turns : Turns
        How the robot turns between two legs; the leg sheets for pilots allow for it.
    wind_ends : str
        Why the wind is not known for longer, for messages.
    """

    scene: Scene
    decomposition: Decomposition
    world: kd.World
    laws: Mapping[str, kd.Law]
    theorem2: kd.Theorem2
    ordered: kd.Ordered
    automaton: Automaton
    labels: tuple[frozenset[str], ...]
    fidelity: FidelityConfig
    obstacles: kd.Faces
    start_variance: float
    epsilon: float
    max_steps: int
    wind_ends: str = ""
    energy: EnergyModel | None = None
    costs: tuple[Cost, ...] = ALWAYS
    turns: Turns = field(default_factory=TurnsOnTheSpot)

    def facts(self) -> Mapping[str, str]:
        """Formula, size of the automaton and of the map, step, and the end of the known wind."""
        return {
            "formula": self.automaton.formula,
            "automaton": f"{self.automaton.n_states} states",
            "cells": f"{len(self.decomposition.cells):,}",
            "step": f"{self.motion.dt:,.8g} s",
            "wind law": self.fidelity.law,
            "wind known for": f"{self.horizon} steps",
        }

    @property
    def atoms(self) -> tuple[str, ...]:
        """Propositions of the mission, in the order of the risks of Theorem 2."""
        return tuple(self.automaton.atoms)

    @property
    def cells(self) -> kd.Cells:
        """Convex cells of the map."""
        return self.world.mission.cells

    @property
    def logic(self) -> kd.Logic:
        """The automaton on the letters that cells show."""
        return self.world.mission.logic

    @property
    def motion(self) -> kd.Motion:
        """Motion of the robot."""
        return self.world.law.motion

    @property
    def wind(self) -> kd.Wind:
        """Expected wind and its variance on the lattice."""
        return self.world.law.wind

    @property
    def barriers(self) -> kd.Faces:
        """Convex parts of the obstacles and, where the border is a wall, its four sides."""
        return self.world.collision.barriers

    @property
    def modes(self) -> kd.Modes:
        """Modes of the coherent law, in which plans of every fidelity are simulated."""
        coherent = self.laws["coherent"]
        assert not isinstance(coherent, kd.IndependentLaw)
        return coherent.modes

    @property
    def landmarks(self) -> tuple[FloatArray, ...]:
        """Landmarks at which the robot measures its position; none if its laws do not use them."""
        return self.scene.landmarks if isinstance(self.laws["coherent"], kd.LandmarkLaw) else ()

    @property
    def horizon(self) -> int:
        """Number of steps for which the wind is known, at most ``planner.max_steps``."""
        return min(len(self.wind.slot), self.max_steps)

    @property
    def reach(self) -> float:
        """Longest step in still air [m]."""
        return self.motion.u_max * self.motion.dt

    def reading(self, step: int) -> Reading:
        """The automaton as it reads the letters of ``step``, and those on the way to it."""
        logic = self.logic
        e = int(logic.epoch[min(step, len(logic.epoch) - 1)])
        return Reading(
            logic.delta[e], logic.way[e], logic.harm[e], logic.loses[e], logic.ahead[e],
            logic.covers, logic.initial, logic.hazards,
        )  # fmt: skip

    def locate(self, points: FloatArray) -> IntArray:
        """Cell of each row of ``points`` (P, 2); -1 in an obstacle or off the map."""
        from pareto_ltl.kernels.geometry import locate_cells

        cells: IntArray = locate_cells(self.cells, np.ascontiguousarray(points))
        return cells

    def states(self, x: FloatArray) -> IntArray:
        """Automaton state after each step of the positions ``x`` (T+1, 2), flyable or not, (T+1,)."""
        from pareto_ltl.kernels.letters import states_along

        states: IntArray = states_along(self.cells, self.logic, np.ascontiguousarray(x))
        return states


def unaided(law: kd.Law) -> kd.IndependentLaw | kd.CoherentLaw:
    """``law`` for a robot that takes no position fixes."""
    return kd.CoherentLaw(law.wind, law.modes, law.motion) if isinstance(law, kd.LandmarkLaw) else law
