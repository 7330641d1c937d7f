"""Explains why no path completes the mission, and which setting to change.

To find out whether the limits on risk exclude every path, the same trees are grown again with higher limits.
So the setting that the text advises has been tried.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import SeedSequence

from careful_io.texts import distance_text, probability_text, round_up
from pareto_ltl.logic.automaton import Automaton
from pareto_ltl.planning import shortest_mission as line
from pareto_ltl.planning.evaluate import completing_path, steps_flown
from pareto_ltl.planning.growth import grow_forest
from pareto_ltl.planning.pack import pack_barriers, pack_collision, pack_nearby
from pareto_ltl.planning.pack_logic import helpful_delta
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Forest, PlannedPath
from pareto_ltl.planning.refine.starts import first_starts
from pareto_ltl.planning.selection import tree_front
from pareto_ltl.settings import PlannerConfig, RobotConfig
from pareto_ltl.support.arrays import length_of
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.world.time_step import too_long
from plane_kernels.types import PathBound

EPSILONS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
LARGEST_DELTA = 0.999  # tried instead of no limit on the collision risk of a path
MORE_VERTICES = (4, 16)  # factors of planner.n_max, tried if higher limits alone give no path
FAR_TOO_LONG = 3.0  # a full step of this many widths of the narrowest place is the reason
MAX_VERTICES = 1_500_000  # in all trials of one kind; a time limit would make texts differ between machines

CAUSES = ("blocked", "windbound", "beyond", "trapped")


@dataclass(slots=True)
class _Budget:
    """Vertices that trials may still grow; the last trial may exceed them."""

    left: int = MAX_VERTICES


@dataclass(frozen=True, slots=True)
class _Trials:
    """Growths of the same trees under other limits, until the budget is spent."""

    cfg: PlannerConfig
    problem: Problem
    seeds: SeedSequence
    budget: _Budget = field(default_factory=_Budget)

    def spent(self) -> bool:
        return self.budget.left <= 0

    def paths(self, epsilon: float, delta: float, n_max: int) -> tuple[PlannedPath, ...]:
        """The front of the trees; empty where no path completes the mission within the limits."""
        cfg = replace(self.cfg, n_max=n_max)
        self.budget.left -= cfg.trees * n_max
        problem = with_limits(self.problem, epsilon, delta)
        seeds = SeedSequence(self.seeds.entropy, spawn_key=self.seeds.spawn_key)
        try:
            return tree_front(problem, grow_forest(cfg, problem, seeds))
        except InfeasibleError:
            return ()


def with_limits(problem: Problem, epsilon: float, delta: float) -> Problem:
    """``problem`` with other values of planner.epsilon and planner.delta, both enforced (``judge=bound``)."""
    barriers = pack_barriers(problem.scene, problem.obstacles)  # the border may be another one
    nearby = pack_nearby(barriers, problem.scene.bounds)
    collision = pack_collision(problem.fidelity.collision_bound, barriers, nearby, epsilon, delta)
    return replace(
        problem, epsilon=epsilon, world=problem.world._replace(collision=collision),
        fidelity=replace(problem.fidelity, judge="bound"),
    )  # fmt: skip


def explain_no_path(
    cfg: PlannerConfig, problem: Problem, forest: Forest, seeds: SeedSequence | None = None
) -> str:
    """The reason why no path completes the mission: how far the trees came, and which setting to change.

    Parameters
    ----------
    seeds : SeedSequence, optional
        Seeds of the forest; without them no other limits are tried.
    """
    long_step = _step_advice(cfg, problem, FAR_TOO_LONG)
    if not long_step and (fault := line.mission_fault(problem)):
        return fault
    trials = None if seeds is None or long_step else _Trials(cfg, problem, seeds)
    if trials and (fault := _longer_advice(trials, forest)):
        return fault
    open_border = _open_border_advice(trials) if trials else ""
    if trials and (advised := _tried_advice(trials, forest)):
        return advised + open_border
    if not long_step and len(problem.logic.delta) == 1 and (fault := line.cautious_fault(problem)):
        return fault + open_border
    distance = problem.automaton.distance
    best = min(float(distance[tree.q].min()) for tree in forest.trees)
    states = sorted({int(q) for tree in forest.trees for q in np.unique(tree.q)})
    return (
        f"no path completes the mission: {sum(map(len, forest.trees))} vertices reached automaton states "
        f"{states} of {problem.automaton.n_states}, the nearest still {best:.0f} transition(s) from "
        f"acceptance{_nearest_miss(problem, forest)}; {long_step or _advice(cfg, problem, forest)}"
        f"{open_border}"
    )


def explain_no_line(cfg: PlannerConfig, problem: Problem) -> str:
    """The reason why no line of the map can be flown: what stops the one that comes farthest.

    Empty without lines, and if one can be flown. Every refined path begins as such a line or in a tree.
    """
    if fault := line.mission_fault(problem):
        return fault
    starts = list(first_starts(problem).values())
    if not starts:
        return ""
    best = max(starts, key=lambda start: steps_flown(problem, start.x) / len(start.x))
    try:
        completing_path(problem, best.x, best.origin, tight=False)
    except InfeasibleError as error:
        length, advice = length_of(best.x), _step_advice(cfg, problem, FAR_TOO_LONG)
        return (
            f"no path completes the mission: of {len(starts)} lines of the map the one that comes farthest "
            f"({best.origin}, {distance_text(length)}, {len(best.x) - 1} steps) cannot be flown: {error}"
            + f"; {advice}"
            * bool(advice)
        )
    return ""


def explain_no_safe_path(cfg: PlannerConfig, problem: Problem, seeds: SeedSequence) -> str:
    """Text for paths that complete the mission but all exceed planner.delta; empty if there is no advice.

    With other models than the paper's, trees may also have only paths that exceed planner.epsilon.
    """
    trials = _Trials(cfg, problem, seeds)
    paths, open_border = trials.paths(problem.epsilon, LARGEST_DELTA, cfg.n_max), _open_border_advice(trials)
    if paths:
        return _risk_text(trials, problem.epsilon, paths) + open_border
    if not problem.is_published:
        found = _least_epsilon(trials)
        if advised := _risk_text(trials, *found) if found else _step_bound_advice(trials):
            return advised + open_border
    within = f"no path completes the mission within planner.delta = {cfg.delta:g}: raise it, or planner.n_max"
    return within + open_border if open_border else ""


def _open_border_advice(trials: _Trials) -> str:
    """The advice to open the border, where that alone gives a path within the limits; empty otherwise."""
    problem, cfg = trials.problem, trials.cfg
    if not problem.scene.walled:
        return ""
    free = replace(problem, scene=replace(problem.scene, border="open"))
    if not replace(trials, problem=free, budget=_Budget()).paths(problem.epsilon, cfg.delta, cfg.n_max):
        return ""
    return "; or, if the robot may leave the map, set scene.border=open, which finds one"


def _longer_advice(trials: _Trials, forest: Forest) -> str:
    """The text where more time alone gives a path: wind data that go on, or more steps; empty otherwise."""
    problem, cfg = trials.problem, trials.cfg
    if not sum(tree.reach["beyond"] for tree in forest.trees) or len(problem.logic.delta) > 1:
        return ""
    longer = line.with_longer_wind(problem, line.TIMES_LONGER)
    more = replace(trials, problem=longer, cfg=replace(cfg, max_steps=longer.max_steps), budget=_Budget())
    paths = more.paths(problem.epsilon, cfg.delta, cfg.n_max)
    steps = min((len(path.u) for path in paths), default=0)
    return line.longer_fault(problem, steps * problem.motion.dt) if steps > problem.horizon else ""


def _tried_advice(trials: _Trials, forest: Forest) -> str:
    """The advice that a growth under other limits has confirmed; empty if there is none."""
    cfg, problem = trials.cfg, trials.problem
    blocked = sum(tree.reach["blocked"] for tree in forest.trees) > 0
    for n_max in (cfg.n_max, *(times * cfg.n_max for times in MORE_VERTICES)):
        if trials.spent():
            return ""
        if n_max > cfg.n_max and trials.paths(problem.epsilon, cfg.delta, n_max):
            return (
                f"no path completes the mission with {sum(map(len, forest.trees)):,} vertices"
                f"{_nearest_miss(problem, forest)}: set planner.n_max={n_max}, which finds one"
            )
        wider = replace(trials, cfg=replace(cfg, n_max=n_max))
        if blocked and (found := _least_epsilon(wider)):
            return _risk_text(wider, *found, more=n_max > cfg.n_max)
    return _step_bound_advice(trials) if blocked else ""


def _step_bound_advice(trials: _Trials) -> str:
    """The advice where R of every path is above 1: the step bound limits only the risk of single steps."""
    problem = trials.problem
    if not isinstance(problem.world.collision, PathBound):
        return ""
    models = replace(problem.fidelity, collision_bound="step")
    stepwise = with_limits(replace(problem, fidelity=models), EPSILONS[0], trials.cfg.delta)
    trials = replace(trials, budget=_Budget())
    for n_max in (trials.cfg.n_max, MORE_VERTICES[0] * trials.cfg.n_max):
        cfg = replace(trials.cfg, n_max=n_max)
        if found := _least_epsilon(replace(trials, cfg=cfg, problem=stepwise)):
            break
    else:
        return ""
    epsilon, paths = found
    more = f" planner.n_max={n_max}" if n_max > trials.cfg.n_max else ""
    least = min(path.objectives.mission_risk + path.objectives.collision_risk for path in paths)
    return (
        f"no plan keeps the collision risk R within any planner.epsilon and planner.delta in {models.law} "
        f"winds; the least risk found, {models.mission_symbol} + R, is {probability_text(least)}: allow it "
        f"with fidelity.collision_bound=step planner.epsilon={epsilon:g}{more}, which limits each step, "
        "or make the passages wider"
    )


def _least_epsilon(trials: _Trials) -> tuple[float, tuple[PlannedPath, ...]] | None:
    """The smallest of ``EPSILONS`` that gives a path, and the paths; None where the largest gives none."""
    delta, n_max = max(LARGEST_DELTA, trials.cfg.delta), trials.cfg.n_max
    ladder = [epsilon for epsilon in EPSILONS if epsilon > trials.problem.epsilon]
    if not ladder or not (paths := trials.paths(ladder[-1], delta, n_max)):
        return None
    low, high = -1, len(ladder) - 1
    while high - low > 1 and not trials.spent():
        middle = (low + high) // 2
        if seen := trials.paths(ladder[middle], delta, n_max):
            high, paths = middle, seen
        else:
            low = middle
    return ladder[high], paths


def _risk_text(trials: _Trials, epsilon: float, paths: tuple[PlannedPath, ...], *, more: bool = False) -> str:
    """Text with the least risk of ``paths`` and the limits that allow it; ``more``: with more vertices."""
    problem, models = trials.problem, trials.problem.fidelity
    least = min(path.objectives.mission_risk + path.objectives.collision_risk for path in paths)
    settings = [f"planner.epsilon={epsilon:g}"] if epsilon > problem.epsilon else []
    limits = f"planner.epsilon = {problem.epsilon:g}"
    if isinstance(problem.world.collision, PathBound):
        limits += f" and planner.delta = {trials.cfg.delta:g}"
        settings += _delta_settings(trials, epsilon, paths)
    if more:
        settings.append(f"planner.n_max={trials.cfg.n_max}")
    return (
        f"no plan keeps the collision risk within {limits} in {models.law} winds; the least risk found, "
        f"{models.mission_symbol} + R, is {probability_text(least)}: allow it with {' '.join(settings)}, or "
        f"make the passages wider or the time in the wind shorter"
    )


def _delta_settings(trials: _Trials, epsilon: float, paths: tuple[PlannedPath, ...]) -> Iterator[str]:
    """planner.delta where it must be raised: to the least value that has been seen to give a path."""
    cfg = trials.cfg
    if not trials.spent() and trials.paths(epsilon, cfg.delta, cfg.n_max):
        return
    least = round_up(min(path.objectives.collision_risk for path in paths))
    enough = 0.0 < least < 1.0 and not trials.spent() and trials.paths(epsilon, least, cfg.n_max)
    yield f"planner.delta={least if enough else LARGEST_DELTA:g}"


def _step_advice(cfg: PlannerConfig, problem: Problem, times: float) -> str:
    """Text on a step longer than ``times`` the narrowest place of the map."""
    robot = RobotConfig(dt=problem.motion.dt, u_max=problem.motion.u_max)
    return too_long(robot, problem.scene, cfg.max_steps, times)


def _advice(cfg: PlannerConfig, problem: Problem, forest: Forest) -> str:
    """The cause that ended most extensions, and the setting that changes it."""
    counts = {cause: sum(tree.reach[cause] for tree in forest.trees) for cause in CAUSES}
    worst = max(counts, key=lambda cause: counts[cause])
    late = forest.seconds >= cfg.max_seconds
    more = f"raise planner.n_max (now {cfg.n_max})"
    if late:
        more = f"raise planner.max_seconds (now {cfg.max_seconds:g} s), which ended the growth"
    if counts[worst] == 0:
        return more
    end = problem.horizon * problem.motion.dt / 3600
    speed, least = float(np.median(np.linalg.norm(problem.wind.mean, axis=-1))), problem.motion.u_min
    advice = {
        "blocked": "came too close to obstacles: make the passages wider, or let the robot reach them sooner",
        "windbound": f"had too little airspeed against the wind (half the map has {speed:.1f} m/s or more): "
        f"raise robot.u_max (now {problem.motion.u_max:g} m/s)"
        f"{f' or lower robot.u_min (now {least:g} m/s)' if least > 0.0 else ''}",
        "beyond": f"outlasted the wind data or planner.max_steps ({end:.1f} h"
        f"{f'; {problem.wind_ends}' if problem.wind_ends else ''}): give later wind fields, "
        "set wind.hold_last=true, or raise planner.max_steps",
        "trapped": _lost_mission(problem.automaton),
    }
    return f"{counts[worst]:.0f} extensions {advice[worst]}; or {more}"


def _lost_mission(automaton: Automaton) -> str:
    """The cause of a failed mission: a forbidden region, or the end of a time span of the formula or map."""
    ends = line.late_spans(automaton)
    spans = f"make its time spans longer ({'; '.join(ends)}), or let the robot fly faster" if ends else ""
    if automaton.trap < 0 and ends:  # no region that the robot can enter makes the mission fail
        return f"were too late for the mission: {spans}"
    return f"broke the mission: move the regions that it forbids{f', or {spans}' if spans else ''}"


def _nearest_miss(problem: Problem, forest: Forest) -> str:
    """Distance of the most advanced vertices from a region that would bring them closer to acceptance."""
    logic, faces = problem.logic, problem.cells.faces
    delta = helpful_delta(logic)
    best = min(float(logic.distance[tree.q].min()) for tree in forest.trees)
    miss, name = np.inf, ""
    for tree in forest.trees:
        for q in np.unique(tree.q[logic.distance[tree.q] == best]):
            points = tree.x[tree.q == q]
            for cell in np.flatnonzero(logic.distance[delta[q, :-1]] < best):
                own = slice(faces.ptr[cell], faces.ptr[cell + 1])
                gaps = (points @ faces.normal[own].T - faces.offset[own]).max(axis=1)
                if gaps.min() < miss:
                    miss, name = float(gaps.min()), "/".join(sorted(problem.labels[cell]))
    return f", {max(miss, 0.0) / 1000:.1f} km short of {name or 'open space'}" if np.isfinite(miss) else ""
