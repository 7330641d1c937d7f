"""Trees of one run: Algorithm 1, ten times in parallel with different slack (Section IV-C).

The first tree has beta = 0, so that a parent is only exchanged for one that dominates it (Theorem 4); the
others draw theirs. Each tree has its own child of the root seed, so the forest is the same whatever the
number of threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import SeedSequence

from pareto_ltl.kernels import tree as kernel
from pareto_ltl.kernels.dijkstra import Heap, Product
from pareto_ltl.kernels.tree import Fans, Growing, Habits, Vertices
from pareto_ltl.planning.problem import Problem, track
from pareto_ltl.planning.product_graph import fans, product
from pareto_ltl.planning.records import Forest, Tree
from pareto_ltl.settings import PlannerConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.cores import cores
from pareto_ltl.support.errors import InfeasibleError

ITERATIONS_PER_VERTEX = 50  # extensions tried before a tree that does not grow is given up
CHUNK = 20_000  # vertices between two looks at the clock
TREES_KEEP = (
    0.5  # of epsilon, of full fidelity: trees that spend it all early run into delta, and bending needs room
)
FACTOR = 1.0  # slack on risks of full fidelity is a factor drawn between 1 and 1 plus this
CAPACITY = 8  # vertices that a square keeps as possible parents, for each automaton state
SQUARES = 400  # at most, along one side of the grid of possible parents


@dataclass(slots=True)
class _Nursery:
    """One tree while it grows."""

    vertices: Vertices
    growing: Growing
    habits: Habits
    beta: FloatArray
    rng: np.random.Generator
    seconds: float = 0.0

    @property
    def size(self) -> int:
        return int(self.growing.tally[kernel.VERTICES])


def forest(
    cfg: PlannerConfig,
    problem: Problem,
    seeds: SeedSequence,
    progress: Callable[[int, int], None] | None = None,
    *,
    record_swaps: bool = False,
    stop_at_first: bool = False,
    reselect: bool = True,
) -> Forest:
    """Grow ``cfg.trees`` trees in parallel.

    Parameters
    ----------
    seeds : SeedSequence
        One child is spawned a tree.
    progress : callable
        Called with (vertices so far, vertices wanted).
    record_swaps : bool
        Keep the objectives of both parents at every re-selection (Theorems 4 and 5 are tested on them).
    stop_at_first : bool
        End each tree at its first accepted vertex.
    reselect : bool
        False gives plain CC-RRT, the paper's baseline without lines 5 to 13 of Algorithm 2.

    Raises
    ------
    InfeasibleError
        Where the start violates Eq. (9) already, or no sequence of cells completes the mission.
    """
    if problem.tables.full:
        problem = replace(problem, tables=problem.tables._replace(epsilon=TREES_KEEP * problem.epsilon))
    decomposition = problem.decomposition
    graph, fan = product(decomposition, problem.tables.logic, problem.scene.bounds), fans(decomposition)
    nurseries = [
        _plant(
            cfg,
            problem,
            graph,
            child,
            number=j,
            swaps=record_swaps,
            stop=stop_at_first,
            reselect=reselect,
        )
        for j, child in enumerate(seeds.spawn(cfg.trees))
    ]
    _check_lead(problem, graph, nurseries[0])
    _call(nurseries[0], problem, graph, fan, 0, 0)  # machine code is loaded here, not on the clock
    began = time.perf_counter()
    threads = min(cfg.trees, cfg.threads or cores())
    deadline = began + cfg.max_seconds
    with ThreadPoolExecutor(threads) as pool:
        jobs = [pool.submit(_grow, n, problem, graph, fan, cfg.n_max, deadline) for n in nurseries]
        while progress is not None and not all(job.done() for job in jobs):
            progress(sum(n.size for n in nurseries), cfg.trees * cfg.n_max)
            time.sleep(0.05)
        for job in jobs:
            job.result()
    trees = tuple(_finish(n) for n in nurseries)
    accepted = [np.flatnonzero(problem.automaton.distance[tree.q] == 0.0) for tree in trees]
    pairs = [np.column_stack([np.full(len(v), j), v]) for j, v in enumerate(accepted)]
    return Forest(trees, np.vstack(pairs).astype(np.int64), time.perf_counter() - began)


def _plant(
    cfg: PlannerConfig, problem: Problem, graph: Product, seed: SeedSequence, number: int, swaps: bool,
    stop: bool, reselect: bool,
) -> _Nursery:  # fmt: skip
    rng = np.random.Generator(np.random.PCG64(seed))
    draws = rng.random(2)
    beta = np.zeros(2) if number == 0 else draws * [cfg.beta_length * problem.reach, cfg.beta_risk]
    weight = np.zeros(3)
    if problem.tables.full:
        beta[1] *= FACTOR / cfg.beta_risk if cfg.beta_risk > 0 else 0.0
        weight = rng.dirichlet(np.ones(3)) if chooses(problem.parents, number) else weight
    habits = _habits(cfg, problem, beta, weight, stop, reselect and cfg.near > 0)
    states, m, atoms = (
        len(problem.automaton.distance),
        len(problem.tables.obstacles.ptr) - 1,
        len(problem.atoms),
    )
    full, modes = problem.tables.full, problem.tables.modes.psi.shape[-1]
    columns = 2 if full else atoms
    vertices = _vertices(
        cfg.n_max, columns, m, states, modes, full=full, landmarks=len(problem.tables.landmarks.ptr) > 1
    )
    groups = habits.columns * habits.rows * states
    labels = len(problem.tables.labelled.cell)
    growing = _growing(graph, groups, cfg.near, columns, m, cfg.n_max if swaps else 0, states, labels)
    x, y = problem.scene.start
    if not kernel.plant(problem.tables, habits, vertices, growing, x, y, problem.start_variance, rng):
        raise InfeasibleError(
            f"the start lies closer to an obstacle than planner.epsilon = {problem.epsilon:g} allows; move "
            "it, lower robot.start_sd or raise planner.epsilon"
        )
    return _Nursery(vertices, growing, habits, beta, rng)


def chooses(parents: str, number: int) -> bool:
    """Whether tree ``number`` of full fidelity chooses parents by a Tchebycheff score: half of them do."""
    return parents == "tchebycheff" or (parents == "mixed" and number % 2 == 1)


def _habits(
    cfg: PlannerConfig, problem: Problem, beta: FloatArray, weight: FloatArray, stop: bool, reselect: bool
) -> Habits:
    """Squares of half a step: a parent lies at most two of them away, unless the wind carries it farther."""
    (west, south), (east, north) = problem.scene.bounds
    side = max(problem.reach / 2, (east - west) / SQUARES, (north - south) / SQUARES)
    return Habits(
        west=float(west), south=float(south), per_metre=1.0 / side,
        columns=max(1, int(np.ceil((east - west) / side))), rows=max(1, int(np.ceil((north - south) / side))),
        beta_length=float(beta[0]), beta_risk=float(beta[1]), tchebycheff=bool(weight.any()),
        per_length=1.0 / float(np.hypot(east - west, north - south)), weight=weight, reselect=reselect,
        explore=cfg.explore,
        refresh=cfg.refresh, max_steps=cfg.max_steps, stop_at_first=stop,
    )  # fmt: skip


def _vertices(
    n: int, columns: int, m: int, states: int, modes: int, *, full: bool, landmarks: bool
) -> Vertices:
    rows = n if full else 0
    return Vertices(
        x=np.empty((n, 2)), drift=np.empty((n, 2)), spread=np.empty((n, 3)), length=np.empty(n),
        risk=np.empty((n, columns)), parent=np.empty(n, np.int32), step=np.empty(n, np.int32),
        q=np.empty(n, np.int32), cell=np.empty(n, np.int32), child=np.empty((n, 2), np.int32),
        masks=np.empty((n, 0 if full else m), np.uint32), speed=np.empty(n), cov=np.empty((rows, 3)),
        bound=np.empty((rows, states)), face=np.empty((rows, m), np.int32),
        run=np.empty((rows, m, 3), np.float32), track=track(rows, modes, landmarks=landmarks),
    )  # fmt: skip


def _growing(
    graph: Product, groups: int, near: int, columns: int, m: int, swaps: int, automaton: int, labels: int
) -> Growing:
    states, edges = len(graph.goal), len(graph.head)
    heap = Heap(
        np.empty(edges + 1), np.empty(edges + 1, np.int64), np.empty(states), np.empty(states, np.int64)
    )
    return Growing(
        root=np.full(states, -1, np.int64), members=np.zeros(states, np.int64),
        selected=np.zeros(states, np.int64),
        weight=np.empty(states), lead=np.empty(states, np.int64), heap=heap,
        kept=np.empty((groups, CAPACITY), np.int64), pool=np.empty(near, np.int64),
        seen=np.zeros(groups, np.int64),
        swaps=np.empty((swaps, 2, 2 + columns)), tally=np.zeros(kernel.TALLIES, np.int64),
        stack=np.empty((256, 4)),
        masks=np.zeros((2, m), np.int64), risks=np.zeros((3, columns)), bounds=np.zeros((2, automaton)),
        faces=np.zeros((2, m), np.int32), runs=np.zeros((2, m, 3), np.float32), labels=np.zeros(labels + 1),
    )  # fmt: skip


def _check_lead(problem: Problem, graph: Product, nursery: _Nursery) -> None:
    """Say at once when the map and the automaton together allow no mission."""
    from pareto_ltl.kernels.dijkstra import shortest_lead

    v = nursery.vertices
    start = int(v.q[0]) * len(problem.labels) + int(v.cell[0])
    if len(shortest_lead(graph, nursery.growing.members, nursery.growing.selected, start)) == 0:
        raise InfeasibleError(
            f"no way through the map completes {problem.automaton.formula!r}: a region it needs cannot be "
            "reached from the start, or the start's own label breaks the mission at once; move the start, a "
            "region or an obstacle"
        )


def _grow(
    nursery: _Nursery, problem: Problem, graph: Product, fan: Fans, n_max: int, deadline: float
) -> None:
    """Grow one tree to its end, looking at the clock between chunks."""
    began = time.perf_counter()
    iterations, tally = ITERATIONS_PER_VERTEX * n_max, nursery.growing.tally
    while nursery.size < n_max and tally[kernel.ITERATIONS] < iterations and time.perf_counter() < deadline:
        limit = min(n_max, nursery.size + CHUNK)
        until = min(iterations, int(tally[kernel.ITERATIONS]) + CHUNK)
        _call(nursery, problem, graph, fan, limit, until)
        if tally[kernel.STALLED] or (nursery.habits.stop_at_first and tally[kernel.ACCEPTED]):
            break
    nursery.seconds = time.perf_counter() - began


def _call(nursery: _Nursery, problem: Problem, graph: Product, fan: Fans, limit: int, until: int) -> None:
    n = nursery
    kernel.grow(problem.tables, graph, fan, n.habits, n.vertices, n.growing, limit, until, n.rng)


def _finish(nursery: _Nursery) -> Tree:
    v, tally, n = nursery.vertices, nursery.growing.tally, nursery.size
    np.maximum(v.risk, 0.0, out=v.risk)
    return Tree(
        x=_rows(v.x, n), parent=v.parent[:n].astype(np.int64), step=v.step[:n].astype(np.int64),
        q=v.q[:n].astype(np.int64), cell=v.cell[:n].astype(np.int64), length=_rows(v.length, n),
        risk=_rows(v.risk, n), swaps=nursery.growing.swaps[: tally[kernel.SWAPS]].copy(),
        beta=nursery.beta, seconds=nursery.seconds,
        reach={
            "extensions": float(tally[kernel.ITERATIONS]), "blocked": float(tally[kernel.BLOCKED]),
            "windbound": float(tally[kernel.WINDBOUND]), "beyond": float(tally[kernel.BEYOND]),
            "trapped": float(tally[kernel.TRAPPED]), "reselected": float(tally[kernel.SWAPS]),
        },
    )  # fmt: skip


def _rows(array: FloatArray, n: int) -> FloatArray:
    """The first n rows; a full tree is handed over as it is."""
    return array if len(array) == n else array[:n].copy()


CAUSES = ("blocked", "windbound", "beyond", "trapped")


def explain(cfg: PlannerConfig, problem: Problem, forest: Forest) -> str:
    """Why no path completes the mission: how far the trees came, and which knob to turn."""
    distance = problem.automaton.distance
    best = min(float(distance[tree.q].min()) for tree in forest.trees)
    states = sorted({int(q) for tree in forest.trees for q in np.unique(tree.q)})
    return (
        f"no path completes the mission: {sum(map(len, forest.trees))} vertices reached automaton states "
        f"{states} of {problem.automaton.n_states}, the nearest still {best:.0f} transition(s) from "
        f"acceptance{_miss(problem, forest)}; {_knob(cfg, problem, forest)}"
    )


def _knob(cfg: PlannerConfig, problem: Problem, forest: Forest) -> str:
    """What most extensions failed of, and the setting that changes it."""
    counts = {cause: sum(tree.reach[cause] for tree in forest.trees) for cause in CAUSES}
    worst = max(counts, key=lambda cause: counts[cause])
    more = f"raise planner.n_max (now {cfg.n_max})"
    if counts[worst] == 0:
        return more
    end = problem.horizon * problem.tables.motion.dt / 3600
    speed = float(np.median(np.linalg.norm(problem.tables.wind.mean, axis=-1)))
    advice = {
        "blocked": "came too close to obstacles: raise planner.epsilon or move the obstacles",
        "windbound": f"could not make way against the wind (half the map has {speed:.1f} m/s or more): raise "
        f"robot.u_max (now {problem.tables.motion.u_max:g} m/s)",
        "beyond": f"outlasted the wind data or planner.max_steps ({end:.1f} h): give later wind fields, "
        "set wind.hold_last=true, or raise planner.max_steps",
        "trapped": "broke the mission: move the regions that it forbids",
    }
    return f"{counts[worst]:.0f} extensions {advice[worst]}; or {more}"


def _miss(problem: Problem, forest: Forest) -> str:
    """How near the most advanced vertices came to a region that would take them on."""
    from pareto_ltl.kernels.geometry import slack

    logic, cells = problem.tables.logic, problem.tables.cells
    best = min(float(logic.distance[tree.q].min()) for tree in forest.trees)
    miss, name = np.inf, ""
    for tree in forest.trees:
        for q in np.unique(tree.q[logic.distance[tree.q] == best]):
            points = tree.x[tree.q == q]
            for cell in np.flatnonzero(logic.distance[logic.delta[q, :-1]] < best):
                gaps = np.array([-slack(cells.faces, int(cell), x, y) for x, y in points])
                if gaps.min() < miss:
                    miss, name = float(gaps.min()), "/".join(sorted(problem.labels[cell]))
    return f", {max(miss, 0.0) / 1000:.1f} km short of {name or 'open space'}" if np.isfinite(miss) else ""
