"""A lower bound on the memory that settings need, checked before any stage runs.

``planning/growth.py`` and ``simulation/flights.py`` check again when the map and the wind are known and the
need is exact. What is refused here can never fit.
"""

from __future__ import annotations

from collections.abc import Collection

from pareto_ltl.settings import Settings
from pareto_ltl.support.cores import cores
from pareto_ltl.support.memory import require_memory

VERTEX_BYTES = 150  # of a vertex, with fidelity=paper and one obstacle
POSITION_BYTES = 16
WRITTEN = 2.0  # copies of the positions while deployments.npz is packed
PLANNING = "forest"
FLYING = "deployment"
STUDIES = (
    "comparison",
    "convergence",
    "ablation",
    "hindcast",
    "forecast_test",
    "departure",
    "replanning",
    "replan_test",
)  # in several processes


def check_sizes(settings: Settings, stages: Collection[str]) -> None:
    """Raise ConfigError if the trees or the flights of ``settings`` cannot fit into memory."""
    planner, flights = settings.planner, settings.deployment
    if any(stage in stages for stage in (PLANNING, *STUDIES)):
        jobs = (settings.evaluation.jobs or cores()) if PLANNING not in stages else 1
        busy = f" in each of {jobs} processes (evaluation.jobs)" if jobs > 1 else ""
        trees = f"{planner.trees} trees{busy}"
        require_memory(
            jobs * planner.trees * VERTEX_BYTES, "planner.n_max", planner.n_max, trees, "planner.trees"
        )
        if "convergence" in stages:
            sizes = max(settings.convergence.sizes)
            require_memory(planner.trees * VERTEX_BYTES, "convergence.sizes", sizes, trees, "planner.trees")
    if FLYING in stages:
        each = 2 * POSITION_BYTES * len(flights.laws) * WRITTEN
        require_memory(each, "deployment.runs", flights.runs, "the positions of all simulated flights")
