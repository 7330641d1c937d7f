"""Settings of the automaton, the trees, smoothing, the choice of a plan, its flights, and the stages."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from careful_io.messages import shown_value, wrong_value
from declared_settings import SEEDS, CheckedSettings, is_finite, setting
from pareto_ltl.settings.fidelity import LAWS
from pareto_ltl.support import extensions
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import kind_names

SELECTION_RULES = ("worth", "priority", "weighted", "threshold", "energy", "least", "knee", "length", "point")
ALWAYS_COSTS = ("length", "energy")  # of every front, if the robot has them
FURTHER_COSTS = tuple(name for name in kind_names("planning/costs") if name not in ALWAYS_COSTS)


@dataclass
class LogicConfig(CheckedSettings, section="logic"):
    """The automaton of the mission."""

    max_states: int = setting(
        10_000, "largest number of states of the automaton; a larger one is an error", "[2, 1e6]"
    )


@dataclass
class PlannerConfig(CheckedSettings, section="planner"):
    """The search trees."""

    trees: int = setting(10, "search trees grown in parallel", "[1, 10_000]")
    n_max: int = setting(2500, "vertices of a tree", "[2, 1e8]")
    epsilon: float | None = setting(
        0.05,
        "largest probability of a collision in one segment, obstacles, walls and forbidden regions together; "
        "with fidelity.collision_bound=step it is divided equally among the convex parts "
        "of the obstacles and the walls; null: no limit",
        "(0, 1)",
    )
    epsilon_strict: bool = setting(
        False,
        "refuse (exit code 2) if no path satisfies planner.epsilon in every segment, or if every simulated "
        "flight of every path fails; false: the path nearest to planner.epsilon is then the plan, with a "
        "warning; with fidelity.judge=bound, trees have no other path, and the mission is always refused",
    )
    delta: float = setting(
        0.8,
        "collision probability allowed on a whole path, with fidelity.collision_bound=path and judge=bound",
        "(0, 1)",
    )
    max_steps: int = setting(200, "largest number of steps of a path", "[1, 1e6]")
    near: int = setting(64, "largest number of candidate parents of a new vertex", "[0, 10_000]")
    beta_risk: float = setting(
        0.05, "the slack of Eq. (11) for risks is drawn between 0 and this", "[0, 1e6]"
    )
    beta_length: float = setting(
        1.0, "the slack of Eq. (11) for length is drawn between 0 and this many full steps", "[0, 1e6]"
    )
    explore: float = setting(
        0.1, "probability that a target is sampled beyond the next cell of the lead", "[0, 1]"
    )
    refresh: int = setting(16, "extensions between two leads of the high-level planner", "[1, 1e6]")
    max_seconds: float = setting(600.0, "growth ends after this time", "[1e-3, 1e9]", unit="s")
    budget_seconds: float | None = setting(
        None,
        "time limit for growth and refine=sampled together; Ctrl-C ends them early. null: no time limit, and "
        "results do not depend on the clock",
        "(0, 1e9]",
        unit="s",
    )
    threads: int = setting(0, "threads that grow trees; 0: one for each core", "[0, 1024]")


@dataclass
class SmoothingConfig(CheckedSettings, section="smoothing"):
    """Convex smoothing of the best paths."""

    candidates: int = setting(4, "largest number of paths of the front that are smoothed", "[1, 1000]")
    rounds: int = setting(3, "iterations of linearise, solve and propagate", "[1, 1000]")
    weights: list[float] = setting([1.0, 10.0, 100.0], "weights of risk against length", "[0, 1e6]")
    trust: float = setting(1.0, "trust region, in full steps", "(0, 1000]")

    def check_combinations(self) -> None:
        """Refuse an empty list of weights."""
        if not self.weights:
            raise ConfigError("smoothing.weights is empty: give at least one risk weight")


COARSE_EFFORT = {"points": 8, "flights": 500, "classes": 2}  # upper limits of the settings of a coarse search


@dataclass
class RefineConfig(CheckedSettings, section="refine"):
    """Sampled refinement, with fidelity.refine=sampled."""

    flights: int = setting(
        1500,
        "simulated flights, in the same winds for all paths, whose failure rate is minimised",
        "[10, 1e7]",
    )
    sweep_flights: int = setting(250, "of these, flights used in the sweep over lengths", "[10, 1e7]")
    classes: int = setting(
        4, "classes of paths (mission order, sides of the obstacles) that are swept", "[1, 1000]"
    )
    points: int = setting(26, "largest number of paths that are polished on all flights", "[2, 10_000]")
    seed: int | None = setting(
        0,
        "seed of the trees and of the flights that paths are fitted to, the same for every seed of a run: "
        "that seed then decides on the flights that judge the paths; null: the seed of the run",
        SEEDS,
    )

    def coarse(self) -> RefineConfig:
        """These settings within ``COARSE_EFFORT``: a third of the CPU time and less, worse plans."""
        return replace(self, **{name: min(getattr(self, name), at) for name, at in COARSE_EFFORT.items()})


@dataclass
class SelectionConfig(CheckedSettings, section="selection"):
    """Which path of the front becomes the plan."""

    # failure rate that rule=worth adds to all: below it, a lower one is worth little length
    SMALL: ClassVar[float] = 1e-3
    rule: str = setting(
        "worth", "how a path is chosen", choices=SELECTION_RULES, group=extensions.SELECTION_RULES
    )
    saving: float = setting(
        2.0,
        "per cent of the failures that one per cent more length must save, with rule=worth; 0: the "
        "safest path",
        "[0, 100]",
    )
    weights: list[float] = setting(
        [0.5, 0.25, 0.25],
        "weights of mission risk, collision risk and length, with rule=weighted, and of the further "
        "costs in the order of front.csv; a failure rate has the first two",
        "[0, 1e6]",
    )
    alpha: float = setting(
        0.05,
        "largest failure, with rule=threshold, energy and least: upper end of the rate, or bound with "
        "fidelity.judge=bound",
        "(0, 1)",
    )
    costs: list[str] = setting(
        [],
        "further costs that paths are compared by, besides length and energy (where it is known)",
        choices=FURTHER_COSTS,
        group=extensions.COSTS,
    )
    least: str = setting("energy", "cost of which the least is taken, with rule=least")
    length: float | None = setting(None, "longest path, with rule=length", "(0, 1e9]", unit="m")
    point: int = setting(0, "number of the path in front.csv, with rule=point", "[0, 1e6]")
    draws: int = setting(
        16_000,
        "most simulated flights of each path that rank the front, with fidelity.judge=flights",
        "[1, 1e8]",
    )
    runs: int = setting(
        20_000,
        "fresh flights of the chosen path for its promised failure rate, with fidelity.judge=flights",
        "[1, 1e8]",
    )
    options: dict[str, Any] = setting(
        {},
        "name: number, text or list, for a rule that another package adds; such a rule says which it reads",
    )
    examined: int = setting(
        5, "largest number of paths that are tested until fresh flights confirm one", "[1, 1000]"
    )
    extra_paths: str | None = setting(
        None, "front.npz, or a results directory with one, whose paths are judged with the paths of the run"
    )

    def check_combinations(self) -> None:
        """Refuse weights that are all zero or fewer than three, and rule=length without a length."""
        if len(self.weights) < 3 or sum(self.weights) <= 0:
            raise ConfigError(
                "selection.weights must be three numbers >= 0, not all 0 (mission risk, collision risk, "
                f"length; others are of further costs), got {shown_value(self.weights)}"
            )
        if self.rule == "length" and self.length is None:
            raise ConfigError(
                "selection.length is missing: selection.rule=length needs the longest path [m], "
                "e.g. selection.length=1.9e6"
            )
        self._check_options()

    def _check_options(self) -> None:
        """Refuse options that no rule reads, and those that plan.json cannot hold."""
        if self.options and self.rule in SELECTION_RULES:
            raise ConfigError(
                f"selection.options are for rules that other packages add; selection.rule={self.rule} reads "
                f"none: remove {', '.join(map(str, self.options))}"
            )
        for name, value in self.options.items():
            items = value if isinstance(value, list) else [value]
            if not all(isinstance(item, str | bool) or is_finite(item) for item in items):
                kinds = "be a finite number, a text, true or false, or a list of these"
                raise wrong_value(f"selection.options.{name}", kinds, value)


@dataclass
class DeploymentConfig(CheckedSettings, section="deployment"):
    """Simulated flights of the plan."""

    runs: int = setting(500, "flights simulated under each wind law", "[1, 1e8]")
    laws: list[str] = setting(list(LAWS), "wind laws that are simulated", choices=LAWS, distinct=True)


@dataclass
class PipelineConfig(CheckedSettings, section="pipelines"):
    """The stages of a run."""

    stages: list[str] = setting([], "stages in the order in which they run")
