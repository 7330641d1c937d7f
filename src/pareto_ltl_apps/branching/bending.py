"""A trunk that counts on its branches: bent so that the tree fails less, not the trunk alone.

The trunk and its rests are moved together by bumps, along the track and to its left. A bump is largest at a
step before the fix, or at it, and fades on both sides, so that the rests reach their old places again. A move
is retained if it lowers the score of the tree in the common flights: each is sorted into the cells, which
move with the planned position, and flown to its end. So the trunk is judged by the failures of its branches.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pareto_ltl.extend import BranchFix, PlannedPath, cells_of, evaluate, evaluate_path
from pareto_ltl.support.arrays import FloatArray, length_of
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl_apps.branching.tree_flights import TRUNK, fly_rests, whole_controls
from pareto_ltl_apps.branching.tree_search import Division, Grower, Stem, Tree, expected_means

BUMPS = 4  # from the departure to the fix
WIDTH = 1.5  # of a bump, in distances between two bumps
SIZE = 0.5  # of the first moves, in standard deviations of the position at the bump
SWEEPS = 3  # over all bumps, each with moves half as large
ALTERNATIONS = 2  # of bending and drawing the cells again
ROUNDING = 1.0 - 1e-9  # of the largest airspeed, which positions give back with an error of rounding


@dataclass(frozen=True, slots=True)
class Shape:
    """Expected positions (T+1, 2) [m] of the trunk, and of the whole plan with each rest."""

    trunk: FloatArray
    wholes: tuple[FloatArray, ...]

    def moved(self, off: FloatArray) -> Shape:
        """All of them moved by ``off`` (n, 2) [m]; later positions stay."""

        def one(x: FloatArray) -> FloatArray:
            x = x.copy()
            x[: len(off)] += off[: len(x)]
            return x

        return Shape(one(self.trunk), tuple(one(x) for x in self.wholes))


@dataclass(frozen=True, slots=True)
class Bent:
    """A bent trunk as a path, its fix, and the rests of it."""

    path: PlannedPath
    fix: BranchFix
    rests: tuple[FloatArray, ...]


def bent_tree(grower: Grower, trunk: PlannedPath, tree: Tree, number: int) -> tuple[PlannedPath, Tree] | None:
    """The trunk of ``tree`` bent for its ``number`` branches, and its tree; None if no bend is better."""
    path, best, origin = trunk, tree, f"{trunk.origin}, bent for its branches"
    for _ in range(ALTERNATIONS):
        found = _bent_once(grower, path, best, number, origin)
        if found is None:
            break
        stem = Stem.trunk(found.path)
        table = grower.table(stem, found.fix, found.rests)
        again = replace(grower.tree(stem, found.fix, found.rests, table), point=tree.point)
        if _score(grower, again, number) >= _score(grower, best, number):
            break
        path, best = found.path, again
    return None if best is tree else (path, grower.grown(best, 1))


def _score(grower: Grower, tree: Tree, number: int) -> float:
    division = tree.divisions[number - 1]
    return grower.score(division.failure, division.length)


def _bent_once(grower: Grower, path: PlannedPath, tree: Tree, number: int, origin: str) -> Bent | None:
    """One pass over all bumps with the cells of ``tree``."""
    division, problem = tree.divisions[number - 1], grower.problem
    used = sorted({0, *(rest for one in tree.divisions for rest in one.rests)})
    wholes = [expected_means(problem, whole_controls(path.u, tree.fix.step, tree.rests[r])) for r in used]
    shape = Shape(path.x, tuple(wholes))
    order = tuple(used.index(rest) for rest in division.rests)
    least, found = _score_of(grower, _made(grower, shape, tree.fix, origin), division, order), None
    for size in SIZE * 0.5 ** np.arange(SWEEPS):
        for bump in bumps(path, tree.fix.step, float(size)):
            for off in (bump, -bump):
                moved = shape.moved(off)
                made = _made(grower, moved, tree.fix, origin)
                score = _score_of(grower, made, division, order)
                if made is None or score >= least or not problem.keeps_epsilon(made.path):
                    continue
                shape, least, found = moved, score, made
                break
    return found


def bumps(path: PlannedPath, step: int, size: float) -> Iterator[FloatArray]:
    """Moves (n, 2) [m] of the positions of a trunk whose fix is at ``step``, the last ones at the fix."""
    apart = step / BUMPS
    width = max(WIDTH * apart, 1.0)
    t = np.arange(min(math.ceil(step + width) + 1, len(path.x)))
    for middle in apart * np.arange(1, BUMPS + 1):
        k = max(round(middle), 1)
        hat = np.maximum(1.0 - np.abs(t - middle) / width, 0.0) * (t > 0)
        along = path.x[k] - path.x[k - 1]
        along = along / max(float(np.hypot(*along)), 1e-9)
        reach = size * math.sqrt(float(np.linalg.eigvalsh(path.cov[k])[-1]))
        for way in (np.array([-along[1], along[0]]), along):
            yield reach * hat[:, None] * way


def _made(grower: Grower, shape: Shape, fix: BranchFix, origin: str) -> Bent | None:
    """The paths of a shape, as near as airspeeds allow; None if the trunk cannot be flown."""
    problem, k = grower.problem, fix.step
    u = within_airspeeds(grower, evaluate(problem, x=shape.trunk).u)
    try:
        path = evaluate_path(problem, expected_means(problem, u), origin, tight=False)
    except InfeasibleError:
        return None
    rests = tuple(within_airspeeds(grower, evaluate(problem, x=x).u[k:]) for x in shape.wholes)
    ahead = path.x[k] - path.x[k - 1]
    speed = float(np.hypot(*ahead))
    moved = replace(fix, place=path.x[k], ahead=ahead / speed if speed > 1e-6 else fix.ahead)
    return Bent(path, moved, rests)


def within_airspeeds(grower: Grower, u: FloatArray) -> FloatArray:
    """The controls ``u`` (T, 2) [m/s] with airspeeds within the limits of the robot, in their directions."""
    robot = grower.run.settings.robot
    speed = np.maximum(np.hypot(*u.T), 1e-9)
    return np.ascontiguousarray(u * (np.clip(speed, robot.u_min, robot.u_max * ROUNDING) / speed)[:, None])


def _score_of(grower: Grower, made: Bent | None, division: Division, order: tuple[int, ...]) -> float:
    """The score of the tree in the flights that rests are fitted to; infinite if it cannot be flown."""
    if made is None:
        return math.inf
    winds, k, u = grower.fitted, made.fix.step, made.path.u
    y, taken = winds.measured_along(u, made.fix)
    branch = np.where(taken, cells_of(division.cells, made.fix.distances(y)), TRUNK)
    winds = winds.after(made.fix, y, taken)
    rests = [made.rests[n] for n in order]
    failed = fly_rests(winds, u, k, rests, branch)
    own = [length_of(expected_means(grower.problem, whole_controls(u, k, rest))) for rest in rests]
    lengths = np.array([*own, length_of(made.path.x)])  # the last one of flights without a fix
    return grower.score(float(failed.mean()), float(lengths[branch].mean()))
