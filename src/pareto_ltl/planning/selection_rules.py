"""Rules that pick the path to fly from the front (Section IV-D), one for each value of ``selection.rule``.

The risk of a path is its failure rate if flights judge (``front.rates``), and otherwise the sum of its
mission risk and its collision risk, which bounds it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from careful_io.messages import shown_value
from careful_io.texts import distance_text, energy_text, in_kilometres, probability_text, round_up
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front, PlannedPath, objective_row
from pareto_ltl.planning.selection import chance_of_failures, hypervolume
from pareto_ltl.settings import FidelityConfig, SelectionConfig
from pareto_ltl.support import extensions
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, InfeasibleError

LOG = logging.getLogger(__name__)
FAR, NEGLIGIBLE = 2.0, 1e-3  # ratio of V to the mission risk, and mission risk, that need no warning
WORSE = 0.025  # p value below which a path is not as safe as another


@dataclass(frozen=True, slots=True)
class SelectionRule:
    """A rule of selection, with its properties.

    Attributes
    ----------
    pick : callable
        Takes the settings of the selection and a front that is not empty; returns the index of the path.
    reads : tuple of str
        Settings that ``pick`` reads, without the weights; ``plan.json`` records them.
    names_one : bool
        The rule names one path: its energy is not limited, and there is no next choice.
    keeps_alpha : bool
        The fresh flights of the plan must satisfy ``selection.alpha`` too.
    meaning : str
        What the rule picks, in words, with the settings that it reads in braces.
    """

    pick: Callable[[SelectionConfig, Front], int]
    reads: tuple[str, ...] = ()
    names_one: bool = False
    keeps_alpha: bool = False
    meaning: str = ""

    def settings_read(self, cfg: SelectionConfig) -> dict[str, Any]:
        """The settings that the rule reads, by name."""
        return {name: getattr(cfg, name) for name in self.reads}

    def in_words(self, cfg: SelectionConfig) -> str:
        """The choice of the rule with the settings ``cfg``, in words; empty for a rule of another package."""
        values = self.settings_read(cfg)
        if values.get("length"):
            far = in_kilometres(metres := float(values["length"]))
            values["length"] = f"{metres / 1e3:,.10g} km" if far else f"{metres:,.10g} m"
        return self.meaning.format(**values)


RULES: dict[str, SelectionRule] = {}  # the rules of this package, in the order of the file
Pick = Callable[[SelectionConfig, Front], int]


def rule(
    name: str,
    meaning: str,
    *,
    reads: tuple[str, ...] = (),
    names_one: bool = False,
    keeps_alpha: bool = False,
) -> Callable[[Pick], Pick]:
    """Make the decorated function the rule ``name``; the others are attributes of :class:`SelectionRule`."""

    def add(pick: Pick) -> Pick:
        RULES[name] = SelectionRule(pick, reads, names_one, keeps_alpha, meaning)
        return pick

    return add


def selection_rule(cfg: SelectionConfig) -> SelectionRule:
    """The rule ``cfg.rule``: one of :data:`RULES`, or of another package, where a function reads the options.

    Raises
    ------
    ConfigError
        If a rule of another package cannot be loaded, or reads a setting that does not exist.
    """
    found = extensions.SELECTION_RULES.kind(
        RULES, cfg.rule, lambda loaded: isinstance(loaded, SelectionRule) or callable(loaded)
    )
    chosen = found if isinstance(found, SelectionRule) else SelectionRule(found, reads=("options",))
    if unknown := [name for name in chosen.reads if not hasattr(cfg, name)]:
        raise ConfigError(
            f"selection.rule={cfg.rule} reads {shown_value(unknown[0])}, no setting of selection; "
            f"expected some of {', '.join(field.name for field in fields(cfg))}"
        )
    return chosen


def choose_path(cfg: SelectionConfig, front: Front) -> PlannedPath:
    """The path of ``front`` that the rule ``cfg.rule`` picks.

    Raises
    ------
    InfeasibleError
        If the rule accepts no path of the front.
    ConfigError
        If a rule that another package adds does not return the index of a path.
    """
    number: object = selection_rule(cfg).pick(cfg, front)
    if not isinstance(number, int | np.integer) or not 0 <= number < len(front.paths):
        raise ConfigError(
            f"selection.rule={cfg.rule} returned {shown_value(number)}, which is not a path of the front; "
            f"expected a number from 0 to {len(front.paths) - 1}: correct the rule, or take another one"
        )
    return front.paths[int(number)]


def bound_warning(path: PlannedPath, models: FidelityConfig) -> str | None:
    """The warning for a path whose mission risk is far below the ordered bound V under the same wind law.

    Theorem 2 of the paper then counted a visit that comes too early (docs/fidelity.md, fault 1). None if the
    mission risk is V itself, or close to it.
    """
    risk, ordered = path.objectives.mission_risk, path.objectives.mission_risk_ordered
    if ordered <= FAR * max(risk, NEGLIGIBLE):
        return None
    return (
        f"mission risk {models.mission_symbol} of the plan, {probability_text(risk)}, is too low: Theorem 2 "
        "of the paper counts visits that come too early; the ordered bound V is "
        f"{probability_text(ordered)} in {models.law} winds; plan with fidelity.mission_bound=ordered "
        "(docs/fidelity.md, fault 1)"
    )


@rule(
    "worth",
    "the shortest path that is not worth lengthening: 1 % more length would save less than {saving:g} % of "
    "the failures (selection.saving)",
    reads=("saving",),
)
def by_worth(cfg: SelectionConfig, front: Front) -> int:
    """The shortest path whose failure rate is not worth more length; with bounds, the path of ``priority``.

    It has the least (p + ``SMALL``) l^s, p the failure rate, l the length and s = ``cfg.saving``: where the
    front is smooth, one per cent more length would save less than s per cent of the failures. The safest end
    of a front is its noisiest point, and is often reached by laps; this rule stops before it.

    Eq. (M49a) of docs/mathematics_methods.md.
    """
    if not front.rates:
        return by_priority(cfg, front)
    lengths = _lengths(front)
    score = np.log(_risks(front) + cfg.SMALL) + cfg.saving * np.log(lengths)
    return int(np.lexsort((lengths, score.round(12)))[0])


@rule("priority", "the shortest of the safest paths")
def by_priority(_cfg: SelectionConfig, front: Front) -> int:
    """The least mission risk, then the least collision risk, then the shortest (the paper's rule).

    Where flights judge: the shortest of the paths that are as safe as the safest one. A path is as safe
    unless it fails more often with a confidence of 97.5 %. All paths meet the same winds, so the flights that
    only one of two paths completes decide, even if the intervals of their rates overlap.

    Eq. (M49) of docs/mathematics_methods.md.
    """
    rows = _objective_rows(front)
    if not front.rates:
        return int(np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))[0])
    least = int(np.lexsort((rows[:, 2], front.failed.mean(axis=1)))[0])
    as_safe = np.flatnonzero(chance_of_failures(front.failed, front.failed[least]) >= WORSE)
    return int(as_safe[np.argmin(rows[as_safe, 2])])


@rule("weighted", "the least weighted sum of risk and length")
def by_weights(cfg: SelectionConfig, front: Front) -> int:
    """The least g_w(ξ, λ) = Σ_j λ_j f_j, with length in units of the shortest path of the front.

    Further weights belong to the further costs, each in units of the least one of the front.
    Where flights judge, the failure rate replaces both risks, with the sum of their weights.

    Eq. (M47) of docs/mathematics_methods.md.
    """
    rows = _objective_rows(front)
    weights = np.array(cfg.weights) / sum(cfg.weights)
    least = rows[:, 2:].min(axis=0)
    if any(weights[rows.shape[1] :]):
        raise ConfigError(
            f"selection.weights has {len(weights)} numbers, and the front has {rows.shape[1] - 2} costs "
            f"besides both risks; expected at most {rows.shape[1]} numbers"
        )
    weights = weights[: rows.shape[1]]
    costs = (rows[:, 2:] / np.where(least > 0.0, least, 1.0))[:, : len(weights) - 2]
    if front.rates:
        return int(np.argmin((weights[0] + weights[1]) * _risks(front) + costs @ weights[2:]))
    return int(np.argmin(np.column_stack([rows[:, :2], costs]) @ weights))


@rule(
    "threshold",
    "the shortest path that fails in at most {alpha:g} of the flights (selection.alpha)",
    reads=("alpha",),
    keeps_alpha=True,
)
def by_threshold(cfg: SelectionConfig, front: Front) -> int:
    """The shortest of the paths that are safe enough; errors as in :func:`by_least`."""
    return by_least("length", cfg, front)


@rule(
    "energy",
    "the least energy of paths that fail in at most {alpha:g} of the flights (selection.alpha)",
    reads=("alpha",),
    keeps_alpha=True,
)
def by_energy(cfg: SelectionConfig, front: Front) -> int:
    """The path of least energy among those that are safe enough; errors as in :func:`by_least`."""
    return by_least("energy", cfg, front)


@rule(
    "least",
    "the least {least} of paths that fail in at most {alpha:g} of the flights (selection.alpha)",
    reads=("alpha", "least"),
    keeps_alpha=True,
)
def by_cost(cfg: SelectionConfig, front: Front) -> int:
    """The path of the least ``selection.least`` that is safe enough; errors as in :func:`by_least`."""
    return by_least(cfg.least, cfg, front)


def by_least(name: str, cfg: SelectionConfig, front: Front) -> int:
    """The least cost ``name`` of the paths whose risk is at most ``cfg.alpha``, of equal ones the shortest.

    For a failure rate its upper limit counts.

    Raises
    ------
    ConfigError
        If the paths have no such cost.
    InfeasibleError
        If no path is safe enough; the text gives the least risk there is.
    """
    if not all(name in path.objectives.costs for path in front.paths):
        raise ConfigError(
            "selection.rule=energy needs the power curve of the robot: set robot.power.kind and plan again"
            if name == "energy"
            else f"selection.least={name}: the front has no such cost; plan with selection.costs=[{name}]"
        )
    limits = np.array([rate.high for rate in front.rates]) if front.rates else _risks(front)
    safe = np.flatnonzero(limits <= cfg.alpha)
    if len(safe) == 0:
        raise _no_safe_path(cfg, front, float(limits.min()))
    costs = np.array([path.objectives.costs[name] for path in front.paths])
    return int(safe[np.lexsort((_lengths(front)[safe], costs[safe]))[0]])


def _no_safe_path(cfg: SelectionConfig, front: Front, least: float) -> InfeasibleError:
    """The error that no path is safe enough; ``least`` is the least risk, or upper limit of a rate."""
    law, alpha = front.models.law, round_up(least)
    risk, kind, advice = f"{front.models.mission_symbol} + R in {law} winds", "risk", "lower planner.epsilon"
    if front.rates:
        risk, kind = f"the failure rate in {law} winds (upper end of 95 %)", "upper end"
        advice = "raise selection.draws"
    accept = f"set selection.alpha={alpha:g}, " if alpha < 1.0 else ""
    return InfeasibleError(
        f"no path keeps {risk} within selection.alpha = {cfg.alpha:g}; the least {kind} is "
        f"{probability_text(least)}: {accept}{advice}, or raise planner.n_max"
    )


@rule("knee", "the path farthest below the chord of the front")
def by_knee(_cfg: SelectionConfig, front: Front) -> int:
    """The path farthest below the chord of the front: further reduction of risk costs much more length.

    Risk and length are scaled to 0..1 between the safest and the shortest path of the front, whose chord is
    the line x + y = 1 (Das, Structural Optimization 18, 1999, doi:10.1007/BF01195985). A front of fewer than
    three paths has no knee: the safest is taken.

    Eq. (M48) of docs/mathematics_methods.md.
    """
    rows = np.column_stack([_risks(front), _lengths(front)])
    span = np.ptp(rows, axis=0)
    scaled = (rows - rows.min(axis=0)) / np.where(span > 0.0, span, 1.0)
    below = 1.0 - scaled.sum(axis=1)
    best = np.flatnonzero(below >= below.max() - 1e-12)
    return int(best[np.lexsort((rows[best, 1], rows[best, 0]))[0]])


@rule("length", "the safest path of at most {length} (selection.length)", reads=("length",))
def by_length(cfg: SelectionConfig, front: Front) -> int:
    """The least risk among the paths no longer than ``cfg.length``.

    Raises
    ------
    InfeasibleError
        If even the shortest is longer; the text gives its length.
    """
    assert cfg.length is not None  # checked by SelectionConfig
    lengths, risks = _lengths(front), _risks(front)
    short = np.flatnonzero(lengths <= cfg.length)
    if len(short) == 0:
        raise InfeasibleError(
            f"no path of the front is as short as selection.length = {distance_text(cfg.length)}; the "
            f"shortest has {distance_text(float(lengths.min()))}: set "
            f"selection.length={np.ceil(lengths.min()):.0f}"
        )
    return int(short[np.lexsort((lengths[short], risks[short]))[0]])


@rule("point", "point {point} of the front (selection.point)", reads=("point",), names_one=True)
def by_number(cfg: SelectionConfig, front: Front) -> int:
    """Path number ``cfg.point`` of the front, counted as in ``front.csv``.

    Raises
    ------
    InfeasibleError
        If the front has no such path.
    """
    size = len(front.paths)
    if cfg.point >= size:
        raise InfeasibleError(
            f"selection.point = {cfg.point}: the front has {size} path{'s' if size > 1 else ''}; expected "
            f"0{f' to {size - 1}' if size > 1 else ''} (column path of front.csv)"
        )
    return cfg.point


def _risks(front: Front) -> FloatArray:
    """The risk of each path, (P,): its failure rate, or the sum of both bounds."""
    if front.rates:
        return np.array([rate.failure for rate in front.rates])
    return np.asarray(_objective_rows(front)[:, :2].sum(axis=1), float)


def _lengths(front: Front) -> FloatArray:
    return np.asarray(_objective_rows(front)[:, 2], float)


def _objective_rows(front: Front) -> FloatArray:
    """Mission risk, collision risk and all C costs of every path, (P, 2 + C)."""
    return np.array([objective_row(path.objectives) for path in front.paths])


# --- what the battery holds ---------------------------------------------------------------------


def within_capacity(cfg: SelectionConfig, front: Front, problem: Problem) -> Front:
    """``front`` without paths that need more energy than the robot has; unchanged if the rule names one path.

    Raises
    ------
    InfeasibleError
        If every path needs more.
    """
    model = problem.energy
    if model is None or model.capacity is None:
        return front
    energies = np.array([path.objectives.costs["energy"] for path in front.paths])
    possible = np.flatnonzero(energies <= model.capacity)
    if selection_rule(cfg).names_one:
        if len(possible) < len(energies):
            LOG.warning(
                "%d of %d paths of the front need more than robot.power.capacity = %s; selection.rule=%s "
                "selects its path in any case",
                len(energies) - len(possible), len(energies), energy_text(model.capacity), cfg.rule,
            )  # fmt: skip
        return front
    if len(possible) == 0:
        from pareto_ltl.planning.shortest_mission import capacity_advice

        raise InfeasibleError(
            f"every path of the front needs more than robot.power.capacity = {energy_text(model.capacity)}; "
            f"the least is {energy_text(energies.min())}: {capacity_advice(problem, front)}"
        )
    return front if len(possible) == len(energies) else part_of_front(front, possible.tolist())


def safest_of_front(front: Front) -> Front:
    """The front with only its path of the least failure rate, of equal ones the shortest."""
    rows = [
        (rate.failure, *path.objectives.costs.values())
        for rate, path in zip(front.rates, front.paths, strict=True)
    ]
    best = min(range(len(rows)), key=lambda k: rows[k])
    volume = hypervolume(np.array(rows[best : best + 1]), front.reference)
    return replace(part_of_front(front, [best]), hypervolume=volume)


def part_of_front(front: Front, kept: Sequence[int]) -> Front:
    """The front with only the paths of the indices ``kept``."""
    return replace(
        front,
        paths=tuple(front.paths[k] for k in kept),
        rates=tuple(front.rates[k] for k in kept) if front.rates else (),
        failed=front.failed[list(kept)] if front.rates else front.failed,
    )
