"""Trees of one run: Algorithm 1, ten times in parallel with different slack (Section IV-C).

Trees grow by the models of the paper whatever the models of the plan: they are starts, and what V, R, modes
of the wind and position fixes say is computed for paths. The first tree has beta = 0, so that a parent is
only exchanged for one that dominates it (Theorem 4); the others draw beta at random. Each tree has a separate
child of the root seed, so the forest does not depend on the number of threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from careful_io.machine import cores, require_memory
from careful_io.messages import shown_value
from ltlf import show_letter
from pareto_ltl.kernels import growth as kernel
from pareto_ltl.kernels import tree as kt
from pareto_ltl.kernels.growth import Fans
from pareto_ltl.kernels.parents import Dominance
from pareto_ltl.planning.problem import Problem, start_breach
from pareto_ltl.planning.product_graph import cell_fans, empty_heap, farthest_states, product_graph
from pareto_ltl.planning.records import Forest, Tree
from pareto_ltl.planning.tree_models import tree_models
from pareto_ltl.settings import PlannerConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.support.budget import UNLIMITED, Budget
from pareto_ltl.support.errors import InfeasibleError
from pareto_ltl.support.seeds import unspawned
from pareto_ltl.world.windows import missed_windows
from plane_kernels.neighbours import Bins
from plane_kernels.types import Cov, Gaussian, Point
from plane_logic.dijkstra import Product

ITERATIONS_PER_VERTEX = 50  # growth ends after this many extensions for each vertex of planner.n_max
LOOK = 0.02  # [s] between two checks of the time limits
GROWTH_SHARE = 0.2  # share of a time budget after which growth ends
PACKED_BYTES = 80  # a vertex of a tree that has ended: its 64-bit copies and its share of the archive
CAPACITY = 8  # vertices that a square keeps as possible parents, for each automaton state
# Columns of 64 bytes in all, one cache line (_cache_lines).
VERTEX = np.dtype([
    ("x", float, 2), ("free", float, 2), ("length", float), ("speed", float), ("child", np.int32, 2),
    ("q", np.int32), ("cell", np.int32),
])  # fmt: skip
BIN = np.dtype([
    ("after", np.int32), ("state", np.int32), ("seen", np.int32), ("kept", np.int32, CAPACITY),
    ("unused", np.int32, 5),
])  # fmt: skip
SQUARES = 400  # at most, along one side of the grid of possible parents


@dataclass(frozen=True, slots=True)
class GrowthOptions:
    """Options of growth for tests and studies, beyond the settings.

    Attributes
    ----------
    record_swaps : bool
        Keep the objectives of both parents at every re-selection (Theorems 4 and 5 are tested on them).
    stop_at_first : bool
        End each tree at its first accepted vertex.
    reselect : bool
        False gives plain CC-RRT, the paper's baseline without lines 5 to 13 of Algorithm 2.
    """

    record_swaps: bool = False
    stop_at_first: bool = False
    reselect: bool = True


@dataclass(slots=True)
class GrowingTree:
    """One tree while it grows."""

    search: kt.Search
    beta: FloatArray
    rng: np.random.Generator
    tally: IntArray  # vertices, extensions, re-selected parents, and extensions by the cause of failure
    seconds: float = 0.0

    @property
    def size(self) -> int:
        """The number of vertices."""
        return int(self.tally[kt.VERTICES])


@dataclass(frozen=True, slots=True)
class GrowthTask:
    """The data that all trees of a run share."""

    cfg: PlannerConfig
    problem: Problem
    models: kt.TreeModels
    graph: Product
    fans: Fans

    @property
    def root(self) -> Gaussian:
        """The position at the start."""
        (x, y), (xx, xy, yy) = self.problem.scene.start, self.problem.start_cov
        return Gaussian(Point(float(x), float(y)), Cov(xx, xy, yy))

    def grow(self, tree: GrowingTree, limit: int, iterations: int) -> None:
        """Grow ``tree`` until it has ``limit`` vertices or ``iterations`` extensions in all."""
        kernel.grow(tree.search, self.graph, self.fans, self.root, limit, iterations, tree.rng)


@dataclass(slots=True)
class Grove:
    """The trees of a run.

    A tree is planted when its turn comes, and packed when it ends: what only growth needs is in memory for as
    many trees as there are threads.
    """

    task: GrowthTask
    seeds: Sequence[SeedSequence]
    options: GrowthOptions
    ended: bool = False
    begun: list[GrowingTree] = field(default_factory=list)  # in the order in which they were planted

    @property
    def size(self) -> int:
        """The number of vertices of all trees."""
        return sum(tree.size for tree in self.begun)

    def plant(self, number: int) -> GrowingTree:
        """The tree ``number``, which has only its root."""
        tree = plant_tree(self.task, self.seeds[number], number, self.options)
        self.begun.append(tree)
        if self.ended:  # after this tree was appended: ``end`` sees the tree, or the tree sees ``ended``
            tree.tally[kt.ENDED] = 1
        return tree

    def grow(self, number: int) -> Tree:
        """Grow the tree ``number`` to its end; the first one is planted before."""
        tree = self.plant(number) if number else self.begun[0]
        began, n_max = time.perf_counter(), self.task.cfg.n_max
        self.task.grow(tree, n_max, ITERATIONS_PER_VERTEX * n_max)
        tree.seconds = time.perf_counter() - began
        return _packed_tree(tree)

    def end(self) -> None:
        """End the growth of all trees, and of those that are planted later, at their next vertex."""
        self.ended = True
        for tree in list(self.begun):
            tree.tally[kt.ENDED] = 1


# --- growth -----------------------------------------------------------------------------------


def grow_forest(
    cfg: PlannerConfig,
    problem: Problem,
    seeds: SeedSequence,
    progress: Callable[[int, int], None] | None = None,
    options: GrowthOptions = GrowthOptions(),
    budget: Budget = UNLIMITED,
) -> Forest:
    """Grow ``cfg.trees`` trees in parallel.

    Parameters
    ----------
    seeds : SeedSequence
        Root seed; each tree gets one child of it.
    progress : callable
        Called with (vertices so far, vertices wanted).
    budget : Budget
        Time limit of the run; growth ends when a fifth of it is spent.

    Raises
    ------
    InfeasibleError
        If the start already violates Eq. (9), or no sequence of cells completes the mission.
    ConfigError
        If the trees do not fit into memory.
    """
    graph = product_graph(problem.decomposition, problem.logic, problem.scene.bounds)
    models = tree_models(problem, strict=cfg.epsilon_strict)
    task = GrowthTask(cfg, problem, models, graph, cell_fans(problem.decomposition))
    _require_memory(cfg, problem)
    grove = Grove(task, unspawned(seeds).spawn(cfg.trees), options)
    _check_lead(task, grove.plant(0))
    began = time.perf_counter()
    budget.begin()
    trees = _grow_all(grove, budget, progress)
    accepted = [np.flatnonzero(problem.automaton.distance[tree.q] == 0.0) for tree in trees]
    pairs = [np.column_stack([np.full(len(v), j), v]) for j, v in enumerate(accepted)]
    return Forest(trees, np.vstack(pairs).astype(np.int64), time.perf_counter() - began)


def _require_memory(cfg: PlannerConfig, problem: Problem) -> None:
    """Raise ConfigError if the trees do not fit into memory."""
    vertex = sum(array.nbytes for array in empty_vertices(64, len(problem.atoms))) / 64
    growing = _threads(cfg)
    each = growing * vertex + cfg.trees * PACKED_BYTES
    sizes = f"{vertex:.0f} bytes per vertex of {growing} that grow at a time, {PACKED_BYTES} of others"
    require_memory(
        each, "planner.n_max", cfg.n_max, f"{cfg.trees} trees ({sizes})", "planner.threads or planner.trees"
    )


def _threads(cfg: PlannerConfig) -> int:
    """How many trees grow at a time."""
    return min(cfg.trees, cfg.threads or cores())


def _grow_all(grove: Grove, budget: Budget, progress: Callable[[int, int], None] | None) -> tuple[Tree, ...]:
    """Grow all trees in threads until they end or time is up; an exception here, as of Ctrl-C, ends them."""
    cfg, end = grove.task.cfg, time.perf_counter() + grove.task.cfg.max_seconds
    with ThreadPoolExecutor(_threads(cfg)) as pool:
        jobs = [pool.submit(grove.grow, number) for number in range(cfg.trees)]
        try:
            growing_on = set(jobs)
            while growing_on:
                if progress is not None:
                    progress(grove.size, cfg.trees * cfg.n_max)
                if time.perf_counter() >= end or budget.over(GROWTH_SHARE):
                    grove.end()
                growing_on = wait(growing_on, LOOK).not_done
            return tuple(job.result() for job in jobs)
        except BaseException:
            grove.end()
            raise


def plant_tree(task: GrowthTask, seed: SeedSequence, number: int, options: GrowthOptions) -> GrowingTree:
    """A tree with one vertex, the start, and a separate random stream."""
    cfg, problem = task.cfg, task.problem
    rng = np.random.Generator(np.random.PCG64(seed))
    beta = _slack(cfg, problem, number, rng)
    settings = _growth_settings(cfg, problem, beta, options)
    vertices = empty_vertices(cfg.n_max, len(problem.atoms))
    state = _tree_state(task, settings, cfg.n_max if options.record_swaps else 0)
    search = kt.Search(task.models, vertices, state, settings)
    tree = GrowingTree(search, beta, rng, state.tally)
    task.grow(tree, 0, 0)  # makes the root, and loads compiled code before time is measured
    if tree.size == 0:
        raise InfeasibleError(start_breach(problem))
    return tree


def _slack(cfg: PlannerConfig, problem: Problem, number: int, rng: np.random.Generator) -> FloatArray:
    """Slack of Eq. (11) for the length [m] and for risks; none for the first tree."""
    draws = rng.random(2)
    return np.zeros(2) if number == 0 else draws * [cfg.beta_length * problem.reach, cfg.beta_risk]


def _growth_settings(
    cfg: PlannerConfig, problem: Problem, beta: FloatArray, options: GrowthOptions
) -> kt.GrowthSettings:
    """Settings of a tree, with a grid of squares of half a step each.

    A parent lies at most two squares away, or farther where the wind helps.
    """
    (west, south), (east, north) = problem.scene.bounds
    side = max(problem.reach / 2, (east - west) / SQUARES, (north - south) / SQUARES)
    return kt.GrowthSettings(
        west=float(west), south=float(south), per_metre=1.0 / side,
        columns=max(1, int(np.ceil((east - west) / side))), rows=max(1, int(np.ceil((north - south) / side))),
        rule=Dominance(float(beta[0]), float(beta[1])), reselect=options.reselect and cfg.near > 0,
        explore=cfg.explore, refresh=cfg.refresh, max_steps=cfg.max_steps,
        stop_at_first=options.stop_at_first,
    )  # fmt: skip


def empty_vertices(n: int, atoms: int) -> kt.Vertices:
    """The arrays of ``n`` vertices for a mission of so many propositions, not filled yet.

    The columns of ``VERTEX`` are interleaved, one cache line for each vertex: choosing a parent reads up to
    64 vertices in no order.
    """
    line = _cache_lines(VERTEX, n)
    return kt.Vertices(
        x=line["x"], free=line["free"], spread=np.empty((n + 1, 3)), length=line["length"],
        risk=np.empty((n, atoms)), parent=np.empty(n, np.int32), step=np.empty(n, np.int32),
        q=line["q"], cell=line["cell"], child=line["child"], speed=line["speed"],
    )  # fmt: skip


def _tree_state(task: GrowthTask, settings: kt.GrowthSettings, swaps: int) -> kt.TreeState:
    states, atoms = len(task.graph.goal) * len(task.graph.volume), len(task.problem.atoms)
    return kt.TreeState(
        root=np.full(states, -1, np.int32), members=np.zeros(states, np.int64),
        selected=np.zeros(states, np.int64), weight=np.empty(states), lead=np.empty(states, np.int64),
        heap=empty_heap(task.graph), bins=_empty_bins(settings.columns * settings.rows, task.cfg.n_max),
        pool=np.empty((task.cfg.near, 2), np.int64), swaps=np.empty((swaps, 2, 2 + atoms)),
        tally=np.zeros(kt.TALLIES, np.int64), stack=np.empty((256, 4)), risks=np.zeros((3, atoms)),
    )  # fmt: skip


def _empty_bins(squares: int, vertices: int) -> Bins:
    """Bins for as many pairs of square and automaton state as there can be; bin 0 is none."""
    line = _cache_lines(BIN, vertices + 1)
    return Bins(
        np.zeros(squares, np.int32), line["after"], line["state"], line["seen"], line["kept"],
        np.empty(vertices + 1, np.int32), np.zeros(1, np.int64),
    )  # fmt: skip


def _cache_lines(row: np.dtype[Any], n: int) -> Any:
    """``n`` zeros of type ``row``, of one cache line each; no page is used before it is written."""
    memory = np.zeros((n + 1) * row.itemsize, np.uint8)
    first = -memory.ctypes.data % row.itemsize
    return memory[first : first + n * row.itemsize].view(row)


def _check_lead(task: GrowthTask, tree: GrowingTree) -> None:
    """Raise InfeasibleError before growth if no sequence of cells completes the mission."""
    from pareto_ltl.planning.shortest_mission import closed_way
    from plane_logic.dijkstra import shortest_lead

    problem, vertices, state = task.problem, tree.search.tree, tree.search.state
    start = int(vertices.q[0]) * len(problem.labels) + int(vertices.cell[0])
    if len(shortest_lead(task.graph, state.members, state.selected, start, state.heap)) == 0:
        wanted = {
            name: w for name, w in problem.automaton.windows.items() if name not in problem.scene.forbidden
        }
        missed = missed_windows(wanted, problem.max_steps * problem.motion.dt)
        why = (
            f"{'; '.join(missed)}; change the window, mission.start_time or planner.max_steps"
            if missed
            else closed_way(problem) or _closed_states(problem, int(vertices.q[0]), int(vertices.cell[0]))
        )
        raise InfeasibleError(
            f"no way through the map completes {shown_value(problem.automaton.formula)}: {why}"
        )


def _closed_states(problem: Problem, state: int, cell: int) -> str:
    """Text on what no way on the map reads next, from the product of cells and automaton."""
    automaton, cure = problem.automaton, "move the start, a region or an obstacle"
    stuck = farthest_states(problem.decomposition, problem.logic, (state, cell))
    wanted = sorted(
        {
            show_letter(letter)
            for q in stuck
            for letter, after in zip(automaton.letters, automaton.delta[q].tolist(), strict=True)
            if automaton.distance[after] < automaton.distance[q]
        }
    )
    if not wanted:
        return (
            "a region it needs cannot be reached from the start, or the start's own label breaks the "
            f"mission at once; {cure}"
        )
    begun = "" if state in stuck else " after the first regions"
    return f"from the start no way{begun} leads to {' or '.join(wanted)} without breaking it; {cure}"


def _packed_tree(tree: GrowingTree) -> Tree:
    """The result of a tree, which cannot grow any more: what only growth needs is released first."""
    v, tally, n = tree.search.tree, tree.tally, tree.size
    swaps = tree.search.state.swaps[: tally[kt.SWAPS]].copy()
    x, length, risk, numbers = v.x, v.length, v.risk, (v.parent, v.step, v.q, v.cell)
    del tree.search, v
    np.maximum(risk, 0.0, out=risk)
    parent, step, q, cell = (column[:n].astype(np.int64) for column in numbers)
    return Tree(
        x=_first_rows(x, n), parent=parent, step=step, q=q, cell=cell, length=_first_rows(length, n),
        risk=_first_rows(risk, n), swaps=swaps, beta=tree.beta, seconds=tree.seconds,
        reach={
            "extensions": float(tally[kt.ITERATIONS]), "blocked": float(tally[kt.BLOCKED]),
            "windbound": float(tally[kt.WINDBOUND]), "beyond": float(tally[kt.BEYOND]),
            "trapped": float(tally[kt.TRAPPED]), "reselected": float(tally[kt.SWAPS]),
        },
    )  # fmt: skip


def _first_rows(array: FloatArray, n: int) -> FloatArray:
    """The first n rows; an array of n rows in one piece is returned without a copy."""
    return array if len(array) == n and array.flags.c_contiguous else array[:n].copy()
