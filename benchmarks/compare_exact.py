"""Promises of plans beside flights in winds with exact covariances.

    python benchmarks/compare_exact.py DIR ... [--flights 40000] [--spacing 20]

For each results directory of a robot without errors and feedback: the promise, the failures of plain flights
with the modes of the plan, and those of flights by a simulator of its own, which draws the error of
interpolation in space at nodes ``--spacing`` km apart near the path from its whole covariance, with the
persistence of the plan from slot to slot, the error of interpolation in time from a Matern-3/2 process, and
gusts. It has no modes; only gusts are white, and what varies between nodes. Flights with 640 modes, which
carry nearly all of the variance, are a third road. 95 % intervals.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl import Run, load_results
from pareto_ltl.extend import Deployment
from pareto_ltl.planning.problem import Problem
from pareto_ltl.run.results import planned_run
from pareto_ltl.simulation.flights import simulate_flights
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.wind.records import WindField
from wind_laws import gp, modes
from wind_laws.places import pairwise_distances, same_places

BLOCK = 2000  # flights at once
MARGIN = 5.0  # standard deviations of the position beside the path that nodes reach
LEAST_MARGIN = 60e3  # [m]
SEED = 20_261_128
MANY = 640  # modes that carry nearly all of the variance


class Lattice:
    """Square nodes near a path; ``index`` (NX, NY) is -1 where there is no node."""

    def __init__(self, path: FloatArray, reach: FloatArray, spacing: float) -> None:
        self.spacing = spacing
        self.origin = (path - reach[:, None]).min(axis=0) - 2 * spacing
        size = np.ceil(((path + reach[:, None]).max(axis=0) - self.origin) / spacing).astype(int) + 3
        places = self.origin + spacing * np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), -1)
        gap = np.linalg.norm(places[:, :, None] - path, axis=-1) - reach
        near = (gap < 2 * spacing).any(axis=-1)
        self.index = np.where(near, np.cumsum(near).reshape(near.shape) - 1, -1)
        self.nodes = places[near]

    def missing(self, x: FloatArray, length: float) -> FloatArray:
        """Share (n,) of the variance of a rough field that bilinear values at ``x`` (n, 2) do not have.

        With weights w of the corners and the correlation exp(-r / ``length``): 1 - w' R w.
        """
        a, b = (((x - self.origin) / self.spacing) % 1.0).T
        w = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], axis=1)
        corners = self.spacing * np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
        R = np.exp(-pairwise_distances(corners, corners) / length)
        return np.maximum(1.0 - np.einsum("ni,ij,nj->n", w, R, w), 0.0)

    def read(self, values: FloatArray, x: FloatArray) -> FloatArray:
        """``values`` (n, N, 2) of n flights at their positions ``x`` (n, 2), bilinear."""
        at = np.clip((x - self.origin) / self.spacing, 0.0, np.array(self.index.shape) - 1.001)
        low = at.astype(int)
        a, b = (at - low).T
        rows, found = np.arange(len(x)), np.zeros((len(x), 2))
        for i, j, weight in (
            (0, 0, (1 - a) * (1 - b)),
            (1, 0, a * (1 - b)),
            (0, 1, (1 - a) * b),
            (1, 1, a * b),
        ):
            node = self.index[low[:, 0] + i, low[:, 1] + j]
            found += weight[:, None] * values[rows, np.maximum(node, 0)] * (node >= 0)[:, None]
        return found


def root(covariance: FloatArray) -> FloatArray:
    """The symmetric square root, float32."""
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T).astype(np.float32)


def bilinear(table: FloatArray, field: WindField, x: FloatArray) -> FloatArray:
    """A table (NX, NY, 2) of ``field`` at ``x`` (n, 2)."""
    at = np.clip((x - field.origin) / field.spacing, 0.0, np.array(table.shape[:2]) - 1.001)
    i, j = at.astype(int).T
    a, b = (at - at.astype(int)).T[:, :, None]
    return np.asarray(
        (1 - a) * (1 - b) * table[i, j] + a * (1 - b) * table[i + 1, j]
        + (1 - a) * b * table[i, j + 1] + a * b * table[i + 1, j + 1], float,
    )  # fmt: skip


class Winds:
    """The law of a plan's winds near its path, without modes."""

    def __init__(
        self, problem: Problem, field: WindField, posterior: gp.WindPosterior, lattice: Lattice
    ) -> None:
        assert field.modes is not None
        assert field.error is None or not field.error.parts, "only winds without forecasts"
        self.field, self.lattice, self.wind = field, lattice, problem.wind
        self.hyper, self.rough = posterior.hyper, posterior.kernel == "matern12"
        self.dt, self.rho, self.gap = problem.motion.dt, field.modes.rho, field.modes.gap
        between = pairwise_distances(lattice.nodes, lattice.nodes)
        self.space = {}
        for slots in same_places(posterior.points):
            one = root(modes.posterior_covariance(posterior, int(slots[0]), lattice.nodes, between))
            self.space |= dict.fromkeys(slots.tolist(), one)
        length = np.inf if field.error is None else field.error.change_length
        self.time = root(gp.CORRELATIONS["matern32"](between / length))

    def fly(self, start: FloatArray, u: FloatArray, start_sd: float, rng: np.random.Generator) -> FloatArray:
        """Positions (``BLOCK``, T + 1, 2) of flights with the controls ``u``."""
        n, count = BLOCK, len(self.lattice.nodes)
        x = np.empty((n, len(u) + 1, 2))
        x[:, 0] = start + start_sd * rng.standard_normal((n, 2))
        draw = lambda: rng.standard_normal((n, count, 2), np.float32)  # noqa: E731
        theta, slot, gap = draw(), -1, -1
        space = change = np.zeros((n, count, 2), np.float32)
        field, wind = self.field, self.wind
        for t, control in enumerate(u):
            k, weight = int(wind.slot[t]), float(wind.weight[t])
            nearest = k + (weight > 0.5)
            if nearest != slot:
                if slot >= 0:
                    kept = self.rho ** ((field.times[nearest] - field.times[slot]) / self.gap)
                    theta = np.float32(kept) * theta + np.float32(np.sqrt(1 - kept**2)) * draw()
                space, slot = np.einsum("ij,njc->nic", self.space[nearest], theta, optimize=True), nearest
            if k != gap:
                change, gap = np.einsum("ij,njc->nic", self.time, draw(), optimize=True), k
            after = min(k + 1, len(field.times) - 1)
            mean = (1 - weight) * bilinear(field.mean[k], field, x[:, t])
            mean += weight * bilinear(field.mean[after], field, x[:, t])
            gust = (1 - weight) * field.gust_var[k] + weight * field.gust_var[after]
            noise = np.sqrt(field.gust_time / self.dt * gust) * rng.standard_normal((n, 2))
            error = self.lattice.read(space, x[:, t]) + np.sqrt(wind.between[t]) * self.lattice.read(
                change, x[:, t]
            )
            if self.rough:  # what varies within a cell, new at each step
                share = self.lattice.missing(x[:, t], self.hyper.length)
                noise += self.hyper.amplitude * np.sqrt(share)[:, None] * rng.standard_normal((n, 2))
            x[:, t + 1] = x[:, t] + self.dt * (control + mean + error + noise)
        return x


def compared(folder: str, flights: int, spacing: float) -> str:
    """One line on the plan in ``folder``."""
    results = load_results(folder)
    run, path = planned_run(results), results.plan.path
    problem, field = run.problem, run.wind
    sd = np.sqrt(np.max(np.linalg.eigvalsh(path.cov), axis=1))
    lattice = Lattice(path.x, np.maximum(MARGIN * sd, LEAST_MARGIN), 1e3 * spacing)
    from pareto_ltl.wind.observations import place_readings
    from pareto_ltl.wind.sources import read_readings

    cfg = run.settings.wind
    seen = place_readings(cfg, read_readings(cfg), run.scene)
    posterior = gp.fit_posterior(cfg, seen, run.scene.bounds)
    winds = Winds(problem, field, posterior, lattice)
    failed, spread = 0, []
    for seed in SeedSequence(SEED).spawn(flights // BLOCK):
        x = winds.fly(path.x[0], path.u, run.settings.robot.start_sd, np.random.default_rng(seed))
        failed += int(Deployment.judged(problem, "coherent", x).failed.sum())
        spread.append(x[:, -1].var(axis=0).mean())
    rich = replace(run.settings, wind=replace(cfg, modes_max=MANY, energy=0.9999))
    roads = {f"{field.modes.psi.shape[-1]} modes": problem}
    roads[f"{MANY} modes"] = Run(rich, {"scene": run.scene}).problem
    counts = {"exact": failed}
    for name, one in roads.items():
        flown = simulate_flights(one, path.u, flights, "coherent", SeedSequence(SEED), path.x)
        counts[name] = int(flown.failed.sum())
    texts = []
    for name, count in counts.items():
        low, high = clopper_pearson(count, flights)
        texts.append(f"{name} {count / flights:.2%} ({low:.2%} to {high:.2%}), {count / max(failed, 1):.2f}")
    sds = np.sqrt(np.mean(spread)) / 1e3, np.sqrt(np.trace(path.cov[-1]) / 2) / 1e3
    return (
        f"{folder}: {flights} flights fail, and as a share of exact: {'; '.join(texts)}; "
        f"sd of the end {sds[0]:.1f} km, foreseen {sds[1]:.1f} km; {len(lattice.nodes)} nodes"
    )


def main() -> None:
    """One line for each results directory."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("results", nargs="+")
    parser.add_argument("--flights", type=int, default=40_000)
    parser.add_argument("--spacing", type=float, default=20.0)
    asked = parser.parse_args()
    for folder in asked.results:
        print(compared(folder, asked.flights, asked.spacing), flush=True)


if __name__ == "__main__":
    main()
