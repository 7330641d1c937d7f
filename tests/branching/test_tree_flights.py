"""What a cell tells of position, wind and own errors, against flights sorted into the cell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.random import SeedSequence

from coherent import STEPS, coherent_problem
from pareto_ltl.extend import BranchFix, Cell, RobotConfig, cells_of
from pareto_ltl.kernels.pilots import RejoiningPilot, command
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.support.arrays import square_matrices
from pareto_ltl_apps.branching.belief import Course, Passed, learnt_in_cell, noise_of, prior_at
from pareto_ltl_apps.branching.moments import Moments
from pareto_ltl_apps.branching.rest_problem import Countered
from pareto_ltl_apps.branching.tree_flights import TRUNK, TreeFlights, fly_rests
from pareto_ltl_apps.conditioning import Fix, learn
from plane_kernels.types import Point

RUNS, STEP = 40_000, 15
ROBOT = RobotConfig(dt=100.0, u_max=20.0, start_sd=50.0, heading_sd=2.0, airspeed_sd=0.02, clock_sd=1.0)
CELLS = [
    Cell(left=(0.0, math.inf)),
    Cell((0.0, math.inf), (-math.inf, 0.0)),
    Cell((-math.inf, 0.0), (-math.inf, 0.0)),
]


@pytest.fixture(scope="module")
def sorted_flights():
    """Flights of a plan in coherent winds, and the cell that the measured position of each lies in."""
    problem = coherent_problem(robot=ROBOT)
    flight = propagate(problem, STEPS)
    winds = TreeFlights.drawn(problem, RUNS, SeedSequence(11))
    x = winds.flown(flight.u)
    ahead = STEPS[STEP] - STEPS[STEP - 1]
    sd = 0.3 * float(np.sqrt(flight.cov[STEP, 0]))
    fix = BranchFix(STEP, STEPS[STEP], ahead / np.hypot(*ahead), sd)
    y, taken = winds.measured(fix, x[:, STEP])
    assert taken.all()
    return problem, flight, winds, x, fix, cells_of(tuple(CELLS), fix.distances(y))


@pytest.mark.parametrize("number", range(len(CELLS)))
def test_position_and_wind_in_a_cell_are_those_of_its_flights(sorted_flights, number: int) -> None:
    """Means within 6 standard errors and 3 % of the spread, covariances within 6 standard errors and 5 %."""
    problem, flight, winds, x, fix, cell = sorted_flights
    cov = square_matrices(flight.cov)[STEP]
    passed = (Passed(fix, CELLS[number]),)
    told = Course.of(problem, flight.x).told(passed)
    rows = np.flatnonzero(cell == number)
    n = len(rows)
    assert n / RUNS == pytest.approx(told.share, abs=6 * 0.5 / math.sqrt(RUNS) + 0.01)
    learnt = learnt_in_cell(prior_at(problem, passed, flight.x), told, noise_of(passed))
    own = x[rows, STEP]
    sd = np.sqrt(np.diag(cov))
    assert (np.abs(own.mean(axis=0) - learnt.mean) < (6 / math.sqrt(n) + 0.03) * sd).all()
    assert np.abs(np.cov(own.T) - learnt.cov).max() < (6 * math.sqrt(2 / n) + 0.05) * sd.max() ** 2
    theta = winds.flights.draws.theta[problem.modes.epoch[STEP]][rows].astype(float)
    assert np.abs(learnt.theta).max() > 0.1  # the cell tells something of the wind
    assert np.abs(theta.mean(axis=0) - learnt.theta).max() < 6 / math.sqrt(n) + 0.03
    strongest = np.unravel_index(np.abs(learnt.theta).argmax(), learnt.theta.shape)
    left = 1.0 - (learnt.told[:, strongest[0], strongest[1]] ** 2).sum()
    assert theta[:, strongest[0], strongest[1]].var() == pytest.approx(left, abs=6 * math.sqrt(2 / n) + 0.03)
    kappa = problem.own_errors("coherent")
    errors = kappa.mean + winds.flights.errors[rows] @ kappa.root.T
    spread = np.sqrt(np.diag(kappa.root @ kappa.root.T))
    assert (np.abs(errors.mean(axis=0) - learnt.errors) < (6 / math.sqrt(n) + 0.03) * spread).all()


def test_what_is_countered_is_what_measured_positions_tell_of_wind_and_errors(sorted_flights) -> None:
    """Less it, θ and κ of flights are uncorrelated with the measured positions, and vary as given them."""
    problem, flight, winds, x, fix, _ = sorted_flights
    passed = (Passed(fix, Cell()),)
    prior = prior_at(problem, passed, flight.x)
    y, _ = winds.measured(fix, x[:, STEP])
    off = y - flight.x[STEP]
    countered = Countered.of(prior, fix.sd, off)
    theta = winds.flights.draws.theta[problem.modes.epoch[STEP]].astype(float)
    unit = off / off.std(axis=0)
    slack = 6 / math.sqrt(RUNS) + 0.02
    assert np.abs(np.einsum("ni,ncm->icm", unit, theta) / RUNS).max() > 10 * slack  # it tells much
    left = theta - countered.theta
    assert np.abs(np.einsum("ni,ncm->icm", unit, left) / RUNS).max() < slack
    assert np.abs(unit.T @ (winds.flights.errors - countered.errors) / RUNS).max() < slack
    learnt = learnt_in_cell(prior, Moments(1.0, np.zeros(2), np.zeros((2, 2))), noise_of(passed))
    assert left.var(axis=0) == pytest.approx(
        1.0 - (learnt.told**2).sum(axis=0), abs=6 * math.sqrt(2 / RUNS) + 0.02
    )


@pytest.mark.parametrize("number", range(len(CELLS)))
def test_the_rest_of_the_course_in_a_cell_is_that_of_its_flights(sorted_flights, number: int) -> None:
    """To the end of the plan: the covariance of position and wind is part of it."""
    problem, flight, _, x, fix, cell = sorted_flights
    whole, passed = Course.of(problem, flight.x), (Passed(fix, CELLS[number]),)
    course = whole.given(passed, whole.told(passed))
    rows = np.flatnonzero(cell == number)
    for t in (STEP, (STEP + len(STEPS)) // 2, len(STEPS) - 1):
        sd, n = math.sqrt(np.trace(square_matrices(flight.cov)[t])), len(rows)
        assert np.linalg.norm(x[rows, t].mean(axis=0) - course.x[t]) < (6 / math.sqrt(n) + 0.04) * sd
        left = square_matrices(course.cov)[t]
        assert np.abs(np.cov(x[rows, t].T) - left).max() < (6 * math.sqrt(2 / n) + 0.06) * sd**2
    # What the cell says of the wind matters: without it the mean at the end would be elsewhere.
    end = np.linalg.norm(course.x[-1] - flight.x[-1])
    assert end > 0.2 * math.sqrt(np.trace(square_matrices(flight.cov)[-1]))


def test_a_cell_of_no_width_is_a_position_fix(sorted_flights) -> None:
    """V = 0 gives what (M67) gives, by the other code."""
    problem, flight, _, _, fix, _ = sorted_flights
    passed = (Passed(fix, Cell()),)
    prior = prior_at(problem, passed, flight.x)
    d = np.array([400.0, -250.0])
    one = learnt_in_cell(prior, Moments(1.0, d, np.zeros((2, 2))), noise_of(passed))
    other = learn(prior, flight.x[[STEP]], [Fix(fix.place + d, fix.sd, STEP)])
    assert one.mean == pytest.approx(other.mean, abs=1e-6)
    assert one.cov == pytest.approx(other.cov, rel=1e-8, abs=1e-3)
    assert one.theta == pytest.approx(other.theta, abs=1e-9)
    both = (np.einsum("rcm,rdk->cmdk", part.told, part.told) for part in (one, other))
    assert next(both) == pytest.approx(next(both), abs=1e-9)
    assert one.errors == pytest.approx(other.errors, abs=1e-12)
    assert one.errors_cov == pytest.approx(other.errors_cov, abs=1e-12)
    assert one.shared == pytest.approx(other.shared, abs=1e-6)


LATER = 24  # step of a second fix


def test_position_and_wind_in_the_cells_of_two_fixes_are_those_of_their_flights(sorted_flights) -> None:
    """The second fix lies beside the expected position; shares, means, covariances of e, θ and the rest."""
    problem, flight, winds, x, fix, cell = sorted_flights
    ahead = STEPS[LATER] - STEPS[LATER - 1]
    sd = float(np.sqrt(square_matrices(flight.cov)[LATER][0, 0]))
    second = BranchFix(LATER, STEPS[LATER] + 0.2 * sd, ahead / np.hypot(*ahead), 0.2 * sd)
    box = Cell((-math.inf, 0.3 * sd), (-0.5 * sd, math.inf))
    y, _ = winds.measured(second, x[:, LATER], 1)
    come = cell == 1
    rows = np.flatnonzero(come & box.holds(second.distances(y)))
    n = len(rows)
    assert n > 500
    passed, course = (Passed(fix, CELLS[1]), Passed(second, box)), Course.of(problem, flight.x)
    told = course.told(passed)
    assert told.share == pytest.approx(n / come.sum(), abs=6 * 0.5 / math.sqrt(come.sum()) + 0.01)
    learnt = learnt_in_cell(prior_at(problem, passed, flight.x), told, noise_of(passed))
    own = x[rows, LATER]
    slack = 6 / math.sqrt(n) + 0.03
    assert (np.abs(own.mean(axis=0) - learnt.mean) < slack * sd).all()
    assert np.abs(np.cov(own.T) - learnt.cov).max() < (6 * math.sqrt(2 / n) + 0.05) * sd**2
    theta = winds.flights.draws.theta[problem.modes.epoch[LATER]][rows].astype(float)
    assert np.abs(theta.mean(axis=0) - learnt.theta).max() < slack
    strongest = np.unravel_index(np.abs(learnt.theta).argmax(), learnt.theta.shape)
    left = 1.0 - (learnt.told[:, strongest[0], strongest[1]] ** 2).sum()
    assert theta[:, strongest[0], strongest[1]].var() == pytest.approx(left, abs=6 * math.sqrt(2 / n) + 0.03)
    end, given = len(STEPS) - 1, course.given(passed, told)
    whole = math.sqrt(np.trace(square_matrices(flight.cov)[end]))
    assert np.linalg.norm(x[rows, end].mean(axis=0) - given.x[end]) < slack * whole
    # The first fix tells something that the second one does not.
    alone = course.given(passed[1:], course.told(passed[1:]))
    assert np.linalg.norm(alone.x[end] - given.x[end]) > 0.05 * whole


def test_what_is_flown_off_is_gone_in_the_law_and_in_the_flights(sorted_flights) -> None:
    """Of one fix and of two: means and covariances in the cells, against flights that fly it off.

    And go on against the drift that it tells of, until the second fix.
    """
    problem, flight, winds, _, fix, _ = sorted_flights
    first = replace(fix, rejoin=6, counter=0.7 / (STEP * problem.motion.dt))
    y, taken = winds.measured_along(flight.u, first)
    once = winds.after(first, y, taken)
    x = once.flown(flight.u)
    assert (np.hypot(*(flight.u + once.change[: len(flight.u), 0]).T) < ROBOT.u_max).all()
    course, cell = Course.of(problem, flight.x), cells_of(tuple(CELLS), first.distances(y))
    for number, held in enumerate(CELLS):
        rows, passed = np.flatnonzero(cell == number), (Passed(first, held),)
        _agrees(x[rows], course.given(passed, course.told(passed)), (STEP + 3, STEP + 6, len(STEPS) - 1))
    sd = math.sqrt(np.trace(square_matrices(flight.cov)[-1]))
    assert math.sqrt(np.trace(np.cov(x[:, -1].T))) < 0.8 * sd

    # The second fix lies beside the mean, and comes while the first deviation is still flown off.
    for later, rejoin in ((STEP + 4, 3), (LATER, 4)):
        ahead = STEPS[later] - STEPS[later - 1]
        second = BranchFix(
            later, STEPS[later] + 60.0, ahead / np.hypot(*ahead), 100.0, rejoin=rejoin, counter=2e-4
        )
        box = Cell((-math.inf, 150.0), (-100.0, math.inf))
        y2, taken2 = once.measured(second, x[:, later], 1)
        twice = once.after(second, y2, taken2).flown(flight.u)
        held = cell == 1
        rows = np.flatnonzero(held & box.holds(second.distances(y2)))
        passed = (Passed(first, CELLS[1]), Passed(second, box))
        told = course.told(passed)
        assert told.share == pytest.approx(len(rows) / held.sum(), abs=3 / math.sqrt(held.sum()) + 0.01)
        # The winds are not linear: flights of two cells have been moved further from the means.
        steps = (later, later + 2, later + rejoin, len(STEPS) - 1)
        _agrees(twice[rows], course.given(passed, told), steps, 0.1)


def _agrees(x: np.ndarray, given, steps: tuple[int, ...], share: float = 0.05) -> None:
    """Positions of flights against the law, within 6 standard errors and ``share`` of the spread."""
    n = len(x)
    for t in steps:
        cov = square_matrices(given.cov)[t]
        sd = math.sqrt(np.trace(cov))
        assert np.linalg.norm(x[:, t].mean(axis=0) - given.x[t]) < (6 / math.sqrt(n) + share) * sd
        assert np.abs(np.cov(x[:, t].T) - cov).max() < (6 * math.sqrt(2 / n) + 0.06) * sd**2


def test_a_change_is_flown_within_the_airspeeds_and_by_those_with_the_fix(sorted_flights) -> None:
    """A deviation that is too large for the steps is flown off at full airspeed; others keep their track."""
    problem, flight, winds, x, fix, _ = sorted_flights
    few, taken = winds.only(np.arange(50)), np.arange(50) < 25
    far = np.tile(fix.place + np.array([5e5, 0.0]), (50, 1))
    after = few.after(replace(fix, rejoin=2), far, taken)
    later = few.after(replace(fix, rejoin=2, counter=1e-6), far, taken)
    assert (later.change[:STEP] == 0.0).all()
    assert later.change[STEP + 2 :, :25, 0] == pytest.approx(-0.5)  # 1e-6 /s of 500 km
    assert later.change[STEP, 0, 0] == pytest.approx(after.change[STEP, 0, 0] - 0.5)
    assert (later.change[:, 25:] == 0.0).all()
    flown = after.flown(flight.u)
    assert (flown[25:] == x[25:50]).all()
    assert (flown[:25, : STEP + 1] == x[:25, : STEP + 1]).all()
    kernel = RejoiningPilot(flight.u, after.change)
    for t in (STEP - 1, STEP, STEP + 1, STEP + 2):
        east, north = command(kernel, problem.motion, t, 0, Point(0.0, 0.0), Point(0.0, 0.0))
        if t in (STEP, STEP + 1):
            assert math.hypot(east, north) == pytest.approx(ROBOT.u_max)
            assert east < -0.99 * ROBOT.u_max
        else:
            assert (east, north) == tuple(flight.u[t])
    assert few.after(fix, far, taken) is few


def test_branches_that_go_on_as_planned_change_nothing(sorted_flights) -> None:
    """With the rest of the plan in every cell the same flights fail; with another rest, others do."""
    _, flight, winds, x, _, cell = sorted_flights
    few = np.arange(2000)
    some, branch = winds.only(few), cell[few]
    alone = problem_failures(some, x[few])
    rest = flight.u[STEP:]
    assert (fly_rests(some, flight.u, STEP, [rest] * 3, branch) == alone).all()
    assert (fly_rests(some, flight.u, STEP, [rest] * 3, np.full(2000, TRUNK)) == alone).all()
    back = fly_rests(some, flight.u, STEP, [rest, -rest, rest], branch)
    assert back[branch == 1].all()  # flown backwards, none reaches its goal
    assert (back[branch != 1] == alone[branch != 1]).all()


def problem_failures(winds: TreeFlights, x: np.ndarray) -> np.ndarray:
    """Which flights ``x`` fail."""
    return winds.flights.failed(np.ascontiguousarray(x))


def test_a_landmark_is_measured_inside_only() -> None:
    """And a fix that is available half of the time is taken by half of the flights."""
    problem = coherent_problem()
    winds = TreeFlights.drawn(problem, 4000, SeedSequence(2))
    box = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    x = np.random.default_rng(4).uniform(-5.0, 15.0, (4000, 2))
    fix = BranchFix(5, np.array([5.0, 5.0]), np.array([1.0, 0.0]), 2.0, 0.5, box)
    y, taken = winds.measured(fix, x)
    inside = ((x >= 0.0) & (x <= 10.0)).all(axis=1)
    assert (fix.inside(x) == inside).all()
    assert not taken[~inside].any()
    assert taken[inside].mean() == pytest.approx(0.5, abs=6 * 0.5 / math.sqrt(inside.sum()))
    assert (y - x).std() == pytest.approx(2.0, abs=6 * 2.0 / math.sqrt(2 * 8000))
