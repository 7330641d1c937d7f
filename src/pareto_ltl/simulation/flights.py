"""Simulated flights: the plan's controls flown many times through the wind (Section V).

A wind law defines how the wind of a flight is drawn. Flights are drawn in blocks with fixed seeds, step by
step, and a longer plan only draws more steps. So two plans flown with the same seed meet the same winds
(common random numbers).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.random import Generator, SeedSequence

from careful_io.machine import on_all_cores, require_memory
from pareto_ltl.kernels import data as kd
from pareto_ltl.kernels import flight as kernel
from pareto_ltl.kernels.path import Flight
from pareto_ltl.kernels.pilots import (
    SHARES,
    Autopilot,
    Beliefs,
    ErringPilot,
    FilterLaw,
    Moves,
    Navigator,
    Pilot,
    RejoiningPilot,
)
from pareto_ltl.planning.evaluate import propagate
from pareto_ltl.planning.power import EnergyModel
from pareto_ltl.planning.problem import Problem, unaided
from pareto_ltl.planning.records import Plan
from pareto_ltl.settings import DeploymentConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.simulation.robot_errors import draw_errors, erring_pilot
from pareto_ltl.support.arrays import Float32Array, FloatArray
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.seeds import later_child, unspawned
from wind_laws.tails import draw_scales, scaled_fields

# Takes the noise (T+1, n, 2) of the fixes and the coefficients (n, Q) of the robot's errors of n flights.
PilotMaker = Callable[[FloatArray, FloatArray], Any]
FLIGHT_COPIES = 2  # copies of the positions of a flight: one in memory, one in the archive that is written
FIX_NOISE = 2**16  # child of a block's seed for the errors of position fixes
OWN_ERRORS = FIX_NOISE + 1  # child of a block's seed for the robot's own errors
FLAGS = "accepted", "collided", "off_map"
BLOCK = 250  # runs that share a generator, whatever the number of threads
TANK_SPEEDS, SLOWEST = 768, 1e-3  # airspeeds of the table of powers, and the least of them in u_max
FASTEST = 1.5  # the greatest in u_max: robots with errors of the airspeed fly faster than it
FARTHEST = 8.0  # deviations from a path beyond which no flight is expected

# --- winds ------------------------------------------------------------------------------------


def draw_independent(problem: Problem, runs: int, steps: int, rng: Generator) -> kernel.IndependentDraws:
    """Winds of ``runs`` flights that are new at every step.

    Eq. (M20) of docs/mathematics.md.
    """
    law = problem.laws["independent"]
    assert isinstance(law, kd.IndependentLaw)
    return kernel.IndependentDraws(law, rng.standard_normal((steps, runs, 2)))


def draw_coherent(problem: Problem, runs: int, steps: int, rng: Generator) -> kernel.CoherentDraws:
    """One field for each of ``runs`` flights: its θ for every epoch, in which no part of the error changes.

    θ_0 ~ N(0, I),    θ_{k+1} = ρ_k θ_k + √(1 - ρ_k²) η:    independent for ρ = 0, one field for ρ = 1.

    If the law has tails, θ of the parts of the forecast is multiplied by the scale of the flight
    (:mod:`wind_laws.tails`). Fields, white parts and scales have separate generators, so that
    a longer plan only draws more steps.

    Eq. (M15) of docs/mathematics.md.
    """
    law = problem.laws["coherent"]
    assert not isinstance(law, kd.IndependentLaw)
    fields, gusts, tails = rng.spawn(3)
    persistence = kept_by_epoch(problem.modes, steps)
    theta = draw_innovations(persistence, runs, fields)
    kernel.link_fields(persistence, theta)
    if (tail := problem.tail) is not None:
        theta = scaled_fields(tail, theta, draw_scales(tail, len(theta), runs, tails))
    return kernel.CoherentDraws(law, gusts.standard_normal((steps, runs, 2)), theta)


def kept_by_epoch(modes: kd.Modes, steps: int) -> Float32Array:
    """ρ (epochs, P), the correlation of θ of each mode with the epoch before; 0 in the first epoch."""
    epoch = modes.epoch[:steps]
    persistence = np.zeros((int(epoch.max(initial=0)) + 1, modes.psi.shape[-1]), np.float32)
    changes = np.flatnonzero(np.diff(epoch)) + 1
    persistence[epoch[changes]] = modes.kept[changes]
    return persistence


def draw_innovations(kept: Float32Array, runs: int, rng: Generator) -> Float32Array:
    """η (epochs, runs, 2, P) of θ: N(0, 1) in epochs that change it, else 0; later epochs have no effect."""
    modes = kept.shape[1]
    drawn = rng.standard_normal(2 * runs * int((kept < 1.0).sum()), np.float32)
    field = np.empty((len(kept), runs, 2, modes), np.float32)
    kernel.place_innovations(kept, drawn, field)
    return field


DRAWS: dict[str, Callable[[Problem, int, int, Generator], Any]] = {
    "independent": draw_independent,
    "coherent": draw_coherent,
}


# --- flights ----------------------------------------------------------------------------------


def deploy_plan(
    cfg: DeploymentConfig, problem: Problem, plan: Plan, seeds: SeedSequence
) -> dict[str, Deployment]:
    """Fly ``plan`` ``cfg.runs`` times under every law of ``cfg.laws``."""
    each = FLIGHT_COPIES * len(cfg.laws) * plan.path.x.nbytes
    require_memory(each, "deployment.runs", cfg.runs, f"flights of {len(plan.path.u)} steps")
    children = law_seeds(seeds)
    return {
        law: simulate_flights(problem, plan.path.u, cfg.runs, law, children[law], plan.path.x)
        for law in cfg.laws
    }


def law_seeds(seeds: SeedSequence) -> dict[str, SeedSequence]:
    """The child of the stream ``seeds`` of a deployment for each law, whatever was spawned from it before.

    A law that is added does not change the winds of the others.
    """
    return dict(zip(DRAWS, unspawned(seeds).spawn(len(DRAWS)), strict=True))


def simulate_flights(
    problem: Problem, u: FloatArray, runs: int, law: str, seed: SeedSequence, mean: FloatArray | None = None
) -> Deployment:
    """Fly the controls ``u`` (T, 2) ``runs`` times under one law.

    Feedback and fixes, if any, steer towards ``mean`` (T+1, 2) [m]. The same ``seed`` gives the same flights,
    even if children were spawned from it before.

    Raises
    ------
    InfeasibleError
        If the wind is not known for so long.
    """
    require_known_wind(problem, u, mean)
    return fly_pilot(problem, pilot_maker(problem, u, mean, law), len(u), runs, law, seed)


def fly_pilot(
    problem: Problem, pilot: PilotMaker, steps: int, runs: int, law: str, seed: SeedSequence
) -> Deployment:
    """Simulate ``runs`` flights of ``steps`` steps with a pilot under one law, in blocks on all cores."""
    x = np.empty((runs, steps + 1, 2))

    def one(rows: slice, child: SeedSequence) -> Deployment:
        block = draw_block(problem, law, rows.stop - rows.start, steps, child)
        fly_block(problem, block, pilot, x[rows])
        return Deployment.judged(problem, law, x[rows])

    blocks = block_rows(runs)
    found = on_all_cores(one, blocks, unspawned(seed).spawn(len(blocks)))
    accepted, collided, off_map = (np.concatenate([getattr(part, name) for part in found]) for name in FLAGS)
    return Deployment(law, x, accepted, collided, off_map, problem.scene.walled)


def require_known_wind(problem: Problem, u: FloatArray, mean: FloatArray | None) -> None:
    """Raise InfeasibleError for a plan that outlasts the wind, ValueError for feedback without ``mean``."""
    steps, known = len(u), len(problem.wind.slot)
    if steps > known:
        raise InfeasibleError(
            f"a plan of {steps} steps outlasts the wind, which is known for {known}"
            f"{f' ({problem.wind_ends})' if problem.wind_ends else ''}: give later fields, "
            "set wind.hold_last=true, or raise planner.max_steps"
        )
    if mean is None and problem.motion.gain > 0.0:
        raise ValueError("feedback steers towards the planned positions: give mean")


def block_rows(runs: int) -> list[slice]:
    """The flights of each block, in order."""
    return [slice(first, min(first + BLOCK, runs)) for first in range(0, runs, BLOCK)]


@dataclass(frozen=True, slots=True)
class FlightBlock:
    """Start positions and winds of up to ``BLOCK`` flights, the same for every plan.

    Attributes
    ----------
    start : (n, 2) float
        Positions at departure [m].
    draws : IndependentDraws or CoherentDraws
        Winds for some number of steps; a shorter plan uses the first of them.
    noise : (T+1, n, 2) float
        Standard normal draws for the errors of position fixes; no rows without landmarks.
    errors : (n, Q) float
        Coefficients κ ~ N(0, I) of the robot's own errors; Q = 0 for a robot without them.
    """

    start: FloatArray
    draws: Any
    noise: FloatArray
    errors: FloatArray


def draw_block(problem: Problem, law: str, runs: int, steps: int, seed: SeedSequence) -> FlightBlock:
    """The start positions and winds of ``runs`` flights of at most ``steps`` steps."""
    rng = np.random.default_rng(unspawned(seed))
    start = problem.scene.start + np.sqrt(problem.start_variance) * rng.standard_normal((BLOCK, 2))[:runs]
    draws = DRAWS[law](problem, runs, steps, rng)
    noise = fix_noise(problem, runs, steps, later_child(seed, FIX_NOISE))
    errors = draw_errors(problem, law, runs, later_child(seed, OWN_ERRORS))
    return FlightBlock(start + errors @ problem.own_errors(law).start.T, draws, noise, errors)


def fix_noise(problem: Problem, runs: int, steps: int, seed: SeedSequence) -> FloatArray:
    """Standard normal draws (steps + 1, runs, 2) for the errors of fixes; no rows without landmarks."""
    rows = steps + 1 if problem.landmarks else 0
    return np.random.default_rng(seed).standard_normal((rows, runs, 2))


def fly_block(problem: Problem, block: FlightBlock, pilot: PilotMaker, x: FloatArray) -> None:
    """Fly one plan once for each flight of ``block``; fills ``x`` (n, T+1, 2)."""
    x[:, 0] = block.start
    fly_draws(problem, block.draws, pilot(block.noise, block.errors), x, problem.energy)


def fly_draws(
    problem: Problem, draws: kernel.Draws, pilot: Pilot, x: FloatArray, energy: EnergyModel | None = None
) -> kernel.Tank:
    """Fly one plan from the places ``x[:, 0]`` through the winds of ``draws``; fills ``x`` (n, T+1, 2).

    With ``energy``, robots that correct their course land where they have spent its capacity. Others spend
    what the plan does, which is compared with the capacity when it is chosen. Returns the tanks afterwards.
    """
    tank = full_tank(problem.motion, len(x), energy if corrects(problem.motion, pilot) else None)
    kernel.fly_batch(problem.motion, draws, pilot, x, np.empty((len(x), 4)), tank)
    return tank


def corrects(motion: kd.Motion, pilot: Pilot) -> bool:
    """Whether the robot corrects its course, so that its flights do not spend what the plan does."""
    steers = pilot.pilot if isinstance(pilot, ErringPilot) else pilot
    return motion.gain > 0.0 or isinstance(steers, Navigator | RejoiningPilot)


def full_tank(motion: kd.Motion, runs: int, energy: EnergyModel | None) -> kernel.Tank:
    """The tanks of ``runs`` robots before departure."""
    if energy is None or energy.capacity is None:
        return kernel.Tank(np.zeros(2), 0.0, 1.0, math.inf, np.zeros(0))
    slowest = max(motion.u_min, SLOWEST * motion.u_max)
    speeds = np.linspace(slowest, FASTEST * motion.u_max, TANK_SPEEDS)
    spacing = float(speeds[1] - speeds[0])
    return kernel.Tank(energy.curve.watts(speeds), slowest, spacing, energy.capacity, np.zeros(runs))


def pilot_maker(
    problem: Problem, u: FloatArray, mean: FloatArray | None, law: str, *, linear: bool = False
) -> PilotMaker:
    """The maker of the pilot: an autopilot, or a navigator that takes fixes along ``mean`` (T+1, 2) [m].

    Under the independent law the wind of one step does not predict the next: fixes measure positions only.
    ``linear`` as in :func:`erring_pilot`; histories of fixes are then shared (:class:`Navigator`).
    """
    held = np.zeros((len(u) + 1, 2)) if mean is None else np.ascontiguousarray(mean)
    planned, own = problem.laws["coherent"], problem.own_errors(law)

    def autopilot(_noise: FloatArray, errors: FloatArray) -> Pilot:
        return erring_pilot(Autopilot(u, held), u, own, errors, linear=linear)

    if mean is None or not isinstance(planned, kd.LandmarkLaw):
        return autopilot
    model = unaided(problem.laws[law])
    flight, marks = propagate(problem, held, model), planned.landmarks
    if not within_reach(marks, flight):
        return autopilot
    rho = model.modes.kept if isinstance(model, kd.CoherentLaw) else np.ones((len(held) + 1, 0), np.float32)
    rho = np.hstack([rho, np.ones((len(rho), (len(own.mean) + 1) // 2), np.float32)])
    push = flight.errors.push
    about = FilterLaw(
        held, u, flight.F, flight.psi, flight.white, rho, problem.start_variance, push, own.start
    )
    root: FloatArray = np.asarray(np.linalg.cholesky(marks.cov[:, [0, 1, 1, 2]].reshape(-1, 2, 2)), float)

    def navigator(noise: FloatArray, errors: FloatArray) -> Pilot:
        runs = noise.shape[1]
        pilot = Navigator(
            about, marks, root, noise, np.empty((runs, 4)),
            np.empty((runs, 2 * rho.shape[1]), np.float32), np.empty(runs, np.int64), np.empty(runs, bool),
            empty_beliefs(2 * runs + 1, max(2 * runs + 1, 4 * (len(held) + 1)), len(root), rho.shape[1]),
            empty_moves(len(held), rho.shape[1]), empty_moves(len(held), rho.shape[1]), linear,
        )  # fmt: skip
        return erring_pilot(pilot, u, own, errors, linear=linear)

    return navigator


def within_reach(marks: kd.Landmarks, flight: Flight) -> bool:
    """Whether a flight may enter a landmark, within ``FARTHEST`` deviations of its path."""
    reach = FARTHEST * float(np.sqrt(flight.cov[:, [0, 2]].sum(axis=1).max()))
    gap = shapely.distance(shapely.LineString(flight.x), shapely.points(marks.disc[:, :2]))
    return bool((gap <= marks.disc[:, 2] + reach).any())


def empty_beliefs(rows: int, groups: int, marks: int, modes: int) -> Beliefs:
    """Memory for the covariances of ``rows`` histories of fixes at ``marks`` landmarks, in ``groups``."""
    pair, both = (rows, 2, 2), 2 * modes
    return Beliefs(
        np.empty(pair), np.empty(pair), np.empty(pair), np.empty((rows, 2, both), np.float32),
        np.empty((rows, 2, both), np.float32), np.empty((rows, both, both)), np.zeros(rows, np.int64),
        np.empty(pair), np.empty((rows, 2, both), np.float32), np.empty((groups, marks, SHARES), np.int64),
        np.zeros(rows, np.int64), np.zeros(1, np.int64), np.empty((2, both)), np.zeros(rows, np.int64),
        np.zeros(rows, np.int64), np.empty(groups, np.int64),
    )  # fmt: skip


def empty_moves(steps: int, modes: int) -> Moves:
    """Memory for a move from each of ``steps`` steps."""
    pair, field = (steps, 2, 2), (steps, 2, 2 * modes)
    return Moves(
        np.empty(pair), np.empty(field, np.float32), np.empty(pair), np.empty(field, np.float32),
        np.empty((steps, modes), np.float32), np.empty(steps, np.int64),
    )  # fmt: skip


# --- rates ------------------------------------------------------------------------------------


def flight_rates(deployment: Deployment) -> dict[str, float]:
    """The metrics of one law; ``off_map_L`` is part of ``failure_L`` where the border is a wall."""
    failed = deployment.failed
    low, high = clopper_pearson(int(failed.sum()), len(failed))
    law = deployment.law
    return {
        f"runs_{law}": float(len(failed)),
        f"failure_{law}": float(failed.mean()),
        f"failure_{law}_low": low,
        f"failure_{law}_high": high,
        f"mission_failure_{law}": float((~deployment.accepted).mean()),
        f"collision_{law}": float(deployment.collided.mean()),
        f"off_map_{law}": float(deployment.off_map.mean()),
    }
