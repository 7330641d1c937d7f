"""Claims about the run itself: how it ended, its files, its inputs, and the ranges of its metrics."""

from __future__ import annotations

import math
from datetime import datetime
from pathlib import Path

from careful_io.fingerprints import data_fingerprint, file_fingerprint
from pareto_ltl_verify.claims import Claim, Verdict, far_apart, no_fault, unlike
from pareto_ltl_verify.claims.front import cost_columns
from pareto_ltl_verify.evidence import LAWS, Evidence

STAGES = frozenset({
    "readings", "scene", "decomposition", "automaton", "observations", "wind", "problem", "forest", "front",
    "plan", "forecasts", "deployment", "export", "report", "page", "tabulate",
})  # fmt: skip
SHARES = frozenset({
    "completed", "wind_energy", "wind_rho", "hypervolume", "safest_raw", "safest", "least_failure",
    "least_failure_raw", "mission_risk_paper", "mission_risk", "mission_risk_ordered", "collision_risk",
    "promise_failure", "promise_low", "promise_high", "promise_claimed", "promise_bound", "promise_passed",
    "promise_floor", "epsilon_kept", "worst_segment_probability", "branches_failure", "branches_low",
    "branches_high", "branches_alone_failure",
    *(f"{name}_{law}" for law in LAWS for name in (
        "mission_risk", "collision_risk", "failure", "mission_failure", "collision", "off_map"
    )),
    *(f"failure_{law}_{end}" for law in LAWS for end in ("low", "high")),
})  # fmt: skip
SIZES = frozenset({
    "wind_speed_m_s", "wind_sd_m_s", "wind_modes", "trees", "nodes", "accepted_nodes", "growth_seconds",
    "nodes_per_second", "front_size", "front_size_raw",
    "shortest_raw_m", "shortest_m", "dt_s", "front_runs", "length_m", "steps", "duration_s", "energy_j",
    "energy_share", "promise_runs", "promise_weighted", "linearity", "run_seconds", "memory_mib",
    "branches", "branches_runs", "branches_length_m",
    *(f"runs_{law}" for law in LAWS), *(f"end_sd_{law}_m" for law in LAWS),
})  # fmt: skip
UNKNOWN = (  # may be null: growth too fast to be measured, readings too few to hold some of them out
    "nodes_per_second", "gp_coverage_90", "gp_z_sd", "gp_nlpd",
)  # fmt: skip
OUTPUTS = {
    "scene": ("scene.json",),
    "decomposition": ("cells.json",),
    "automaton": ("automaton.json", "automaton.hoa"),
    "wind": ("wind.nc",),
    "forest": ("trees.npz",),
    "front": ("front.csv", "front.npz"),
    "plan": ("plan.json", "plan.csv"),
    "deployment": ("deployments.npz",),
}  # fmt: skip - the files of each stage
KEPT = ("scene", "decomposition", "automaton", "wind")  # stages whose files a run without a plan has too


def status(result: Evidence) -> Verdict:
    """A run with status ok has a plan, an infeasible one has none, and the metrics agree with that."""
    run, completed, planned = result.run, float(result.metrics["completed"]), result.has("plan.json")
    fitting = (run["status"], completed) == (("ok", 1.0) if planned else ("infeasible", 0.0))
    faults = {
        f"plan.json {'is' if planned else 'is not'} there, metrics completed {completed:g}": not fitting,
        "measured": run["measured"] is not True,
        "an error is noted": (run["error"] is not None) == planned,
    }
    return no_fault(str(run["status"]), faults)


def files(result: Evidence) -> Verdict:
    """The files of every stage that ended are there."""
    run = result.run
    ended = run["stages"] if run["status"] == "ok" else [s for s in list(run["seconds"])[:-1] if s in KEPT]
    missing = (name for stage in ended for name in OUTPUTS.get(stage, ()) if not result.has(name))
    return no_fault(f"{len(ended)} stages", (f"{name} is missing" for name in missing))


def settings_hash(result: Evidence) -> Verdict:
    """The fingerprint of the settings in config_resolved.yaml agrees with run.json."""
    planner = {key: value for key, value in result.settings["planner"].items() if key != "threads"}
    content = {key: value for key, value in result.settings.items() if key != "sweep"} | {"planner": planner}
    hashed = {"version": result.run["version"], "code": result.run["code_hash"], "settings": content}
    stated, computed = result.run["config_hash"], data_fingerprint(hashed)
    return Verdict(stated[:12], computed[:12], stated == computed)


def identity(result: Evidence) -> Verdict:
    """Name, seed and stages of run.json agree with the settings."""
    settings = result.settings
    wanted = {"name": settings["name"], "seed": settings["seed"], "stages": settings["pipelines"]["stages"]}
    return no_fault(f"{settings['name']}, seed {settings['seed']}", unlike(result.run, wanted))


def inputs(result: Evidence) -> Verdict | None:
    """Input files that still exist have the fingerprint that run.json names; None if no file exists."""
    stated = result.run["inputs"]
    here = {name: file_fingerprint(Path(name)) for name in stated if Path(name).is_file()}
    return no_fault(f"{len(here)} of {len(stated)} files", unlike(stated, here)) if here else None


def seconds(result: Evidence) -> Verdict:
    """Times of the stages [s] add up to the time of the run; metrics.json and run.json agree."""
    metrics, key = result.metrics, "seconds_"
    stated = {name.removeprefix(key): value for name, value in metrics.items() if name.startswith(key)}
    wanted = {"run_seconds": math.fsum(stated.values())}
    if "growth_seconds" in metrics:
        spent = metrics["growth_seconds"]
        wanted["nodes_per_second"] = metrics["nodes"] / spent if spent else math.nan
    run = result.run
    took = (datetime.fromisoformat(run["finished"]) - datetime.fromisoformat(run["started"])).total_seconds()
    faults = {
        "stages differ": stated != run["seconds"],
        f"finished {took:.4g} s after the start": took < wanted["run_seconds"] - 1.0
        and not result.has("replan.json"),  # whose records are made before the directory
    }
    return no_fault(f"{metrics['run_seconds']:.4g} s", faults, far_apart(metrics, wanted, 1e-9))


def _sizes(result: Evidence) -> frozenset[str]:
    """The names of counts and sizes, costs of the front and sides of its hypervolume among them."""
    costs = cost_columns(result) if result.has("front.csv") else []
    return SIZES.union(costs, (f"hypervolume_{name}" for name in costs))


def ranges(result: Evidence) -> Verdict:
    """Every probability and share lies in [0, 1], every count and size is not negative."""
    faults, sizes = [], _sizes(result)
    for name, value in result.metrics.items():
        if value is None or isinstance(value, bool) or not isinstance(value, int | float):
            faults += [f"{name} is {value!r}"] * (name not in UNKNOWN or value is not None)
        elif name in SHARES or name.startswith("gp_coverage"):
            faults += [f"{name} {value:g} is not between 0 and 1"] * (not -1e-12 <= value <= 1 + 1e-12)
        elif name in sizes or name.startswith("seconds_"):
            faults += [f"{name} {value:g} is negative"] * (value < 0)
    return no_fault(f"{len(result.metrics)} numbers", faults)


def known_names(result: Evidence) -> Verdict | None:
    """Every number of metrics.json is one that a plan has; None if another package has added a stage."""
    if not STAGES.issuperset(result.run["stages"]):
        return None
    scores = result.wind.score if result.has("wind.nc") else {}
    known = SHARES.union(_sizes(result), scores, (f"seconds_{name}" for name in result.run["seconds"]))
    return no_fault(f"{len(result.metrics)} numbers", (name for name in result.metrics if name not in known))


def intervals(result: Evidence) -> Verdict | None:
    """Every rate lies in its interval, at least as large as each of its parts and at most their sum.

    The parts are mission, collision and, if border=wall, leaving the map.
    """
    faults, metrics = dict[str, bool](), result.metrics
    names = ["mission_failure_{}", "collision_{}", *["off_map_{}"] * (result.scene["border"] == "wall")]
    for law in LAWS:
        if f"failure_{law}" in metrics:
            rate, low, high = (metrics[f"failure_{law}{end}"] for end in ("", "_low", "_high"))
            parts = [metrics[name.format(law)] for name in names]
            faults[f"failure_{law}"] = not low <= rate <= high
            together = max(parts) - 1e-12 <= rate <= min(sum(parts), 1.0) + 1e-12
            faults[f"parts of failure_{law}"] = not together
    return no_fault("rates and their parts", faults)


CLAIMS: tuple[Claim, ...] = (
    Claim("run: how it ended", (), status),
    Claim("run: files of all stages", (), files),
    Claim("run: name, seed and stages", (), identity),
    Claim("run: fingerprint of the settings", (), settings_hash),
    Claim("run: fingerprints of the inputs", (), inputs),
    Claim("run: times", (), seconds),
    Claim("metrics: ranges", (), ranges),
    Claim("metrics: names", (), known_names),
    Claim("metrics: rates and intervals", (), intervals),
)
