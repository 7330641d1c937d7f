"""The stage of the plan: the path that the rule picks, the prices of its limits, and what helps a bad one."""

from __future__ import annotations

import logging
from dataclasses import replace

from numpy.random import SeedSequence

from pareto_ltl.planning.limits import remedies_text
from pareto_ltl.planning.prices import limits_of
from pareto_ltl.planning.problem import Problem
from pareto_ltl.planning.records import Front, Plan
from pareto_ltl.planning.selection_rules import bound_warning, choose_path, selection_rule, within_capacity
from pareto_ltl.planning.separation import keeps_epsilon, worst_segment
from pareto_ltl.run.remedies import HOPELESS, Trial, tried_remedies
from pareto_ltl.settings import Settings
from pareto_ltl.settings.heights import flight_air, flight_height, temperature_doubt
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.simulation.promise import promise_path
from pareto_ltl.support.seeds import named_child
from pareto_ltl.wind.coverage import EXACT, OwnErrors, coverage_of, held_warning
from pareto_ltl.wind.records import WindField

LOG = logging.getLogger(__name__)
PRICING = "prices"  # child of the seed of the flights that price limits
REMEDIES = "remedies"  # child of the seed of the flights that try changes
PRICING_BLOCKS, PRICING_RUNS = 8, 5_000  # blocks of these flights, and the flights of each


def chosen_plan(
    settings: Settings, problem: Problem, wind: WindField, front: Front, seeds: SeedSequence
) -> Plan:
    """The path of ``front`` that the rule picks; with ``judge=flights``, after a test with fresh flights."""
    front, height = within_capacity(settings.selection, front, problem), flight_height(settings)
    coverage = coverage_of(
        wind,
        problem.scene.time_zero,
        height.level if height.stated else "",
        by_default=settings.mission.start_time is None,
        robot=covered_errors(settings),
    )
    if front.rates:
        path, promise = promise_path(settings.selection, problem, wind, front, seeds)
    else:
        path, promise = choose_path(settings.selection, front), None
    held = held_warning(wind, float(path.t[-1]), problem.scene.time_zero)
    measured = None if wind.air is None else wind.air.during(path.t)
    doubt = "" if measured is None else temperature_doubt(settings, height, measured)
    for warning in filter(None, (bound_warning(path, settings.fidelity), held, doubt)):
        LOG.warning("%s", warning)
    plan = Plan(
        path=path,
        formula=problem.automaton.formula,
        atoms=tuple(problem.atoms),
        dt=problem.motion.dt,
        u_min=settings.robot.u_min,
        u_max=settings.robot.u_max,
        capacity=None if problem.energy is None else problem.energy.capacity,
        epsilon=problem.epsilon,
        fidelity=settings.fidelity.label,
        rule=settings.selection.rule,
        weights=tuple(settings.selection.weights),
        rule_settings=selection_rule(settings.selection).settings_read(settings.selection),
        promise=promise,
        navigation=problem.scene.frame.navigation(path.t, path.x, path.u),
        height=height,
        air=flight_air(settings, height, measured),
        covered=coverage.covered,
        not_covered=coverage.not_covered,
        worst=worst_segment(problem, path) if front.rates else None,
        epsilon_kept=not front.rates or keeps_epsilon(problem, path),
    )
    if not plan.epsilon_kept:
        LOG.warning("%s", plan.breach(problem.scene))
    return plan


def covered_errors(settings: Settings) -> OwnErrors:
    """The robot's own errors that the law of the plan covers: none under the independent law."""
    robot = settings.robot
    if settings.fidelity.law == "independent":
        return EXACT
    return OwnErrors(
        robot.airspeed_sd, robot.heading_sd, robot.clock_sd,
        (robot.airspeed_bias, robot.heading_bias, robot.clock_bias),
    )  # fmt: skip


def priced(problem: Problem, plan: Plan, seeds: SeedSequence) -> Plan:
    """``plan`` with the chance constraint of each of its segments, and the prices of its limits."""
    path = plan.path
    blocks = (
        simulate_flights(problem, path.u, PRICING_RUNS, problem.fidelity.law, child, path.x).x
        for child in named_child(seeds, PRICING).spawn(PRICING_BLOCKS)
    )
    limits, prices = limits_of(problem, path, blocks)
    return replace(plan, limits=limits, prices=prices)


def with_remedies(
    settings: Settings, problem: Problem, wind: WindField, plan: Plan, seeds: SeedSequence
) -> Plan:
    """``plan`` with the changes that help it, if it breaks ``planner.epsilon`` or hardly ever succeeds."""
    if plan.epsilon_kept and (plan.promise is None or plan.promise.rate.failure < HOPELESS):
        return plan
    remedies = tried_remedies(Trial(settings, problem, wind, plan, named_child(seeds, REMEDIES)))
    if remedies:
        LOG.info("what helps, %s", remedies_text(remedies))
    else:
        LOG.info("neither position feedback nor a beacon, a younger forecast or a larger region helps")
    return replace(plan, remedies=remedies)
