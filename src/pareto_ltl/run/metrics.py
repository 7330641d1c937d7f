"""All numbers of a run in one flat table, for ``metrics.json`` and the summary on the screen."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from pareto_ltl.run.study import Study

if TYPE_CHECKING:
    from pareto_ltl.planning.evaluate import Forecast
    from pareto_ltl.planning.records import Forest, Front, Plan
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.wind.records import WindField


def run_metrics(records: Mapping[str, Any], seconds: Mapping[str, float]) -> dict[str, float]:
    """Numbers from ``records`` and the ``seconds`` [s] of stages; ``completed`` is 1 with a plan or a study.

    A record of another package adds its attribute ``numbers``, a mapping of name to float.
    """
    table: dict[str, float] = {"completed": float("plan" in records)}
    for name, numbers_of in NUMBERS.items():
        if name in records:
            table |= numbers_of(records[name])
    for record in records.values():
        if isinstance(record, Study):
            table |= {"completed": 1.0}
        if isinstance(numbers := getattr(record, "numbers", None), Mapping):
            table |= numbers
    table |= {f"seconds_{name}": spent for name, spent in seconds.items()}
    table["run_seconds"] = math.fsum(seconds.values())
    table["memory_mib"] = peak_memory()
    return table


def _wind_numbers(wind: WindField) -> dict[str, float]:
    import numpy as np

    table = {name: float(value) for name, value in sorted(wind.score.items())}
    variance = wind.latent_var + wind.gust_var[:, None, None, :]
    table |= {
        "wind_speed_m_s": float(np.linalg.norm(wind.mean, axis=-1).mean()),
        "wind_sd_m_s": float(variance.mean()) ** 0.5,
    }
    if wind.modes is not None:
        table |= {
            "wind_modes": wind.modes.psi.shape[-1],
            "wind_energy": float(wind.modes.energy.mean()),
            "wind_rho": wind.modes.rho,
        }
    return table


def _forecast_numbers(forecasts: Mapping[str, Forecast]) -> dict[str, float]:
    """V, R and the standard deviation of the last position [m] under each wind law of the deployment."""
    table: dict[str, float] = {}
    for law, seen in forecasts.items():
        table |= {
            f"mission_risk_{law}": seen.mission_risk,
            f"collision_risk_{law}": seen.collision_risk,
            f"end_sd_{law}_m": float(seen.cov[-1].trace() / 2) ** 0.5,
        }
    return table


def _forest_numbers(forest: Forest) -> dict[str, float]:
    nodes = sum(len(tree) for tree in forest.trees)
    return {
        "trees": len(forest.trees),
        "nodes": nodes,
        "accepted_nodes": len(forest.accepted),
        "growth_seconds": forest.seconds,
        "nodes_per_second": nodes / forest.seconds if forest.seconds > 0 else math.nan,
    }


def _front_numbers(front: Front) -> dict[str, float]:
    from pareto_ltl.planning.costs import cost_named

    table: dict[str, float] = {"front_size": len(front.paths), "hypervolume": front.hypervolume}
    sides = front.reference[1 if front.rates else 2 :].tolist()  # of its box, without risks
    names = front.paths[0].objectives.costs if front.paths else ()
    table |= {f"hypervolume_{cost_named(n).column}": side for n, side in zip(names, sides, strict=False)}
    if front.raw and front.paths:
        table |= {
            "front_size_raw": len(front.raw),
            "shortest_raw_m": min(o.length for o in front.raw),
            "shortest_m": min(path.objectives.length for path in front.paths),
            "safest_raw": min(o.mission_risk for o in front.raw),
            "safest": min(path.objectives.mission_risk for path in front.paths),
        }
    table["dt_s"] = (
        float(front.paths[0].t[1] - front.paths[0].t[0]) if len(front.paths[0].t) > 1 else math.nan
    )
    if front.rates:
        table["least_failure"] = min(rate.failure for rate in front.rates)
        table["front_runs"] = front.rates[0].runs
    if front.raw_rates:
        table["least_failure_raw"] = min(rate.failure for rate in front.raw_rates)
    return table


def _plan_numbers(plan: Plan) -> dict[str, float]:
    from pareto_ltl.planning.costs import cost_named
    from pareto_ltl.planning.rates import WEIGHTED
    from pareto_ltl.planning.records import RISKS

    o, promise = plan.path.objectives, plan.promise
    table = {
        "length_m": o.length,
        **({} if plan.alarmed else {name: getattr(o, name) for name in RISKS}),
        "steps": len(plan.path.u),
        "dt_s": plan.dt,
        "duration_s": float(plan.path.t[-1] - plan.path.t[0]),
        **{cost_named(name).column: value for name, value in o.further_costs.items()},
        **({} if plan.capacity is None else {"energy_share": o.costs["energy"] / plan.capacity}),
    }
    if plan.worst is not None:
        table |= {
            "epsilon_kept": float(plan.epsilon_kept),
            "worst_segment_probability": plan.worst.probability,
        }
    if (tree := plan.branching) is not None:
        table |= {
            "branches": float(len(tree.branches)),
            **{f"branches_{name}": getattr(tree.rate, name) for name in ("failure", "low", "high", "runs")},
            "branches_alone_failure": tree.alone.failure,
            "branches_length_m": tree.length,
        }
    if promise is None:
        return table
    return table | {
        **{f"promise_{name}": getattr(promise.rate, name) for name in ("failure", "low", "high", "runs")},
        "promise_weighted": float(promise.rate.method == WEIGHTED),
        "promise_claimed": promise.claimed.failure,
        "promise_bound": promise.bound,
        "promise_passed": float(promise.passed),
        "linearity": promise.linearity,
        **({"promise_floor": promise.floor} if promise.floor else {}),
    }


def _deployment_numbers(deployments: Mapping[str, Deployment]) -> dict[str, float]:
    from pareto_ltl.simulation.flights import flight_rates

    return {name: rate for flights in deployments.values() for name, rate in flight_rates(flights).items()}


NUMBERS: dict[str, Callable[[Any], dict[str, float]]] = {
    "wind": _wind_numbers,
    "forest": _forest_numbers,
    "front": _front_numbers,
    "plan": _plan_numbers,
    "forecasts": _forecast_numbers,
    "deployments": _deployment_numbers,
}


def peak_memory() -> float:
    """Peak memory of this process [MiB]."""
    try:
        import resource
    except ImportError:  # Windows, with a peak in psutil; elsewhere the present memory is taken
        import psutil

        held = psutil.Process().memory_info()
        return float(getattr(held, "peak_wset", held.rss)) / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)  # bytes on macOS, kibibytes on Linux
