"""Another path of a front as the plan, without planning again.

The records of a run (map, wind, cells, automaton, trees, front) are reused; the stages from the plan on run
with another selection. Their files are identical to the files of a whole run with that selection.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from careful_io.texts import distance_text, probability_text, round_up
from declared_settings import settings_of
from pareto_ltl.run.directory import claimed_directory
from pareto_ltl.run.pipeline import carry_out, files_of, stages_by_name
from pareto_ltl.run.plan_run import Run
from pareto_ltl.run.results import Planned, load_results, planned_run
from pareto_ltl.settings import SelectionConfig
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError

if TYPE_CHECKING:
    from pareto_ltl.planning.records import Front

KEPT = ("scene", "cells", "automaton", "wind", "forest", "front")
RAW = ("readings", "observations")  # from which the wind was made


def choose(
    planned: Planned,
    *,
    failure: float | None = None,
    length: float | None = None,
    knee: bool = False,
    point: int | None = None,
    energy: float | None = None,
    selection: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
) -> Run:
    """Select another path of a front as the plan, without planning again. Give exactly one criterion.

    Parameters
    ----------
    planned : Run or path
        What :func:`plan` returned, or a results directory.
    failure : float, optional
        The shortest path with at most this failure rate (upper end of its interval in the front).
    length : float, optional
        The safest path of at most this length [m].
    knee : bool
        The knee of the front: beyond it, a lower failure rate costs much more length.
    point : int, optional
        The path of that number in ``result.front.paths`` and ``front.csv``.
    energy : float, optional
        The path with the least energy and at most this failure rate; needs a robot with a power curve.
    selection : mapping, optional
        The path that a rule picks: the same mapping as for :func:`plan`, e.g.
        ``{"rule": "weighted", "weights": [0.8, 0.1, 0.1]}``; other settings of the selection stay.
    out : path, optional
        Write a whole results directory there, identical to a run with that selection; ``planned`` must
        then be a results directory. Without it, nothing is written.

    Raises
    ------
    InfeasibleError
        If the front has no such path.
    """
    choice = Choice(failure, length, knee, point, energy, selection)
    if out is not None and isinstance(planned, Run) and planned.stored is None:
        raise ConfigError("choose writes from a results directory: plan with out=DIR and give choose DIR")
    return chosen_run(planned, choice, None if out is None else Path(out))


# --- criteria -----------------------------------------------------------------------------------

# The rule that expresses a criterion, the setting that holds its value, and the value in a name of a folder.
RULES: dict[str, tuple[str, str, Callable[[Any], str]]] = {
    "failure": ("threshold", "alpha", "{:g}".format),
    "energy": ("energy", "alpha", "{:g}".format),
    "length": ("length", "length", lambda metres: f"{metres / 1e3:.10g}km"),
    "point": ("point", "point", str),
}


@dataclass(frozen=True, slots=True)
class Choice:
    """The criterion for a path of a front; give exactly one.

    Attributes
    ----------
    failure : float or None
        The shortest path with at most this failure rate (upper end of its interval).
    length : float or None
        The safest path of at most this length [m].
    knee : bool
        The knee of the front.
    point : int or None
        The path of that number in ``front.csv``.
    energy : float or None
        The path with the least energy and at most this failure rate.
    selection : mapping or None
        The path that these settings of ``selection`` pick: a rule and what it reads.
    """

    failure: float | None = None
    length: float | None = None
    knee: bool = False
    point: int | None = None
    energy: float | None = None
    selection: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if len(self._values()) + self.knee + (self.selection is not None) != 1:
            raise ConfigError("give one of failure, energy, length, knee, point and selection")
        if self.selection is not None and "rule" not in self.selection:
            raise ConfigError(
                "selection names no rule; expected e.g. {'rule': 'weighted', 'weights': [1, 0, 0]}"
            )
        if self.point is not None and self.point < 0:
            raise ConfigError(f"point must be the number of a path, 0 or more, got {self.point}")

    def _values(self) -> dict[str, Any]:
        """The given criterion of :data:`RULES` with its value, if there is one."""
        return {name: value for name in RULES if (value := getattr(self, name)) is not None}

    def settings(self, cfg: SelectionConfig) -> SelectionConfig:
        """``cfg`` with the rule for this criterion; raises ConfigError for a value out of range."""
        changes = {"rule": "knee"} if self.selection is None else dict(self.selection)
        for name, value in self._values().items():
            rule, key, _ = RULES[name]
            changes = {"rule": rule, key: value}
        values = {field.name: getattr(cfg, field.name) for field in fields(cfg)}
        if changes["rule"] != cfg.rule:
            values["options"] = {}  # options belong to one rule
        changed = settings_of(SelectionConfig, values | changes, "selection.")
        assert isinstance(changed, SelectionConfig)
        return changed

    def make(self, planned: Planned, place: Path | None = None, argv: Sequence[str] = ()) -> Run:
        """The run of ``planned`` with this plan, as :func:`chosen_run` makes it."""
        return chosen_run(planned, self, place, argv)

    def place(self, directory: Path) -> Path:
        """A folder beside ``directory``, with the choice in its name."""
        directory = directory.resolve()
        return directory.with_name(f"{directory.name}_{self.name}")

    @property
    def name(self) -> str:
        """The choice as part of the name of a folder: ``failure_0.02``, ``length_1900km``, ``point_3``."""
        if self.selection is not None:
            return f"rule_{self.selection['rule']}"
        return next((f"{name}_{RULES[name][2](value)}" for name, value in self._values().items()), "knee")


def require_choice(choice: Choice, front: Front, where: str) -> None:
    """Raise InfeasibleError if ``front`` has no such path; the text begins with ``where``."""
    lengths = [path.objectives.length for path in front.paths]
    if choice.point is not None and choice.point >= len(lengths):
        raise InfeasibleError(
            f"{where}: there is no point {choice.point}; the front has points 0 to {len(lengths) - 1}"
        )
    if choice.length is not None and choice.length < min(lengths):
        raise InfeasibleError(
            f"{where}: no path is as short as {distance_text(choice.length)}; the shortest of the front, "
            f"point {lengths.index(min(lengths))}, has {distance_text(min(lengths))}"
        )
    limits = [rate.high for rate in front.rates] or [
        path.objectives.mission_risk + path.objectives.collision_risk for path in front.paths
    ]
    if choice.energy is not None and "energy" not in front.paths[0].objectives.costs:
        raise ConfigError(
            f"{where}: the paths have no energy; plan with a robot that has a power curve, e.g. "
            "robot=fixed_wing"
        )
    wanted = choice.failure if choice.energy is None else choice.energy
    if wanted is not None and wanted < min(limits):
        named = "upper end of 95 %" if front.rates else f"bound {front.models.mission_symbol} + R"
        raise InfeasibleError(
            f"{where}: no path has a failure rate of at most {probability_text(wanted)} in "
            f"{front.models.law} winds ({named}); the safest path of the front, "
            f"point {limits.index(min(limits))}, has {probability_text(min(limits))}: use "
            f"{round_up(min(limits)):g} or more"
        )


# --- the run with another plan ------------------------------------------------------------------


def chosen_run(planned: Planned, choice: Choice, place: Path | None = None, argv: Sequence[str] = ()) -> Run:
    """The run of ``planned`` with the plan of ``choice``; with ``place``, all its later stages write there.

    Raises
    ------
    ConfigError
        If ``place`` is the directory of ``planned``.
    DataError
        If ``planned`` is a directory without a finished plan, or later stages use files elsewhere.
    InfeasibleError
        If the front has no such path.
    """
    run, source = planned_run(planned, ("front", "plan")), load_results(planned).source(place)
    settings = replace(run.settings, selection=choice.settings(run.settings.selection))
    require_choice(choice, run.front, str(source or "the front"))
    other = Run(settings, run.make(*KEPT), directory=place, read=run.read)
    if place is None:
        other.records["problem"] = run.problem
        other.make("plan")
        return other
    table = stages_by_name(settings)
    left = [table[name] for name in settings.pipelines.stages if table[name].name not in (*KEPT, *RAW)]
    if elsewhere := [stage.stage for stage in left if stage.elsewhere]:
        raise DataError(
            f"{source}: the stages after its plan read or write files elsewhere ({', '.join(elsewhere)}), "
            "which the settings of a directory may not; run the whole pipeline with another selection.rule"
        )
    with claimed_directory(place, files_of(table.values())):
        carry_out(other, left, argv)
    return other
