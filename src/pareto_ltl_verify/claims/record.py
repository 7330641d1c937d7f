"""Claims about the run itself: how it ended, its files, its inputs, and the ranges of its metrics."""

from __future__ import annotations

import math
from pathlib import Path

from pareto_ltl.support.fingerprints import data_fingerprint, file_fingerprint
from pareto_ltl_verify.claims.verdict import Claim, Verdict, close, no_fault
from pareto_ltl_verify.evidence import LAWS, Evidence

SHARES = (
    "mission_risk", "collision_risk", "failure", "collision_", "promise_failure", "promise_low",
    "promise_high", "promise_claimed", "promise_bound", "promise_passed", "least_failure", "hypervolume",
    "wind_energy", "wind_rho", "gp_coverage", "completed", "safest",
)  # fmt: skip
UNKNOWN = (  # may be null: growth too fast to be measured, readings too few to hold some of them out
    "nodes_per_second", "gp_coverage_90", "gp_z_sd", "gp_nlpd",
)  # fmt: skip
SIDES = ("hypervolume_",)  # of the box, in the units of the costs
COUNTS = (
    "runs",
    "front_runs",
    "promise_runs",
    "nodes",
    "trees",
    "front_size",
    "steps",
    "seconds",
    "memory",
    "length",
    "shortest",
    "end_sd",
    "duration",
    "energy",
    "arrival",
    "turns",
)


STAGES = frozenset({
    "readings", "scene", "decomposition", "automaton", "observations", "wind", "problem", "forest", "front",
    "plan", "forecasts", "deployment", "export", "report", "page", "tabulate",
})  # fmt: skip
OF_A_LAW = (
    "mission_risk_{}", "collision_risk_{}", "end_sd_{}_m", "runs_{}", "failure_{}", "failure_{}_low",
    "failure_{}_high", "mission_failure_{}", "collision_{}", "off_map_{}",
)  # fmt: skip
NAMES = frozenset({
    "completed", "wind_speed_m_s", "wind_sd_m_s", "wind_modes", "wind_energy", "wind_rho", "trees", "nodes",
    "accepted_nodes", "growth_seconds", "nodes_per_second", "front_size", "hypervolume",
    "hypervolume_length_m", "hypervolume_energy_j", "front_size_raw", "shortest_raw_m", "shortest_m",
    "safest_raw", "safest", "dt_s", "least_failure", "front_runs", "least_failure_raw", "length_m",
    "mission_risk_paper", "mission_risk",
    "mission_risk_ordered", "collision_risk", "steps", "duration_s", "energy_j", "energy_share",
    "promise_failure", "promise_low", "promise_high", "promise_runs", "promise_weighted", "promise_claimed",
    "promise_bound", "promise_passed", "linearity", "run_seconds", "memory_mib",
    *(name.format(law) for law in LAWS for name in OF_A_LAW),
})  # fmt: skip
OUTPUTS = {
    "scene": ("scene.json",),
    "decomposition": ("cells.json",),
    "automaton": ("automaton.json", "automaton.hoa"),
    "wind": ("wind.nc",),
    "forest": ("trees.npz",),
    "front": ("front.csv", "front.npz"),
    "plan": ("plan.json", "plan.csv"),
    "deployment": ("deployments.npz",),
}  # the files of each stage


def status(result: Evidence) -> Verdict:
    """A run with status ok has a plan, an infeasible one has none, and the metrics agree with that."""
    planned = result.has("plan.json")
    stated = (result.run["status"], float(result.metrics["completed"]))
    fitting = ("ok", 1.0) if planned else ("infeasible", 0.0)
    faults = (
        []
        if stated == fitting
        else [f"plan.json {'is' if planned else 'is not'} there, metrics completed {stated[1]:g}"]
    )
    faults += ["measured"] * (result.run["measured"] is not True)
    faults += ["an error is noted"] * ((result.run["error"] is not None) == planned)
    return no_fault(str(stated[0]), faults)


def files(result: Evidence) -> Verdict:
    """The files of every stage that ended are there."""
    ended = result.run["stages"] if result.run["status"] == "ok" else list(result.run["seconds"])[:-1]
    if result.run["status"] != "ok":
        ended = [stage for stage in ended if stage in ("scene", "decomposition", "automaton", "wind")]
    missing = [name for stage in ended for name in OUTPUTS.get(stage, ()) if not result.has(name)]
    return no_fault(f"{len(ended)} stages", [f"{name} is missing" for name in missing])


def settings_hash(result: Evidence) -> Verdict:
    """The fingerprint of the settings in config_resolved.yaml agrees with run.json."""
    content = {
        name: dict(value) if isinstance(value, dict) else value for name, value in result.settings.items()
    }
    content.pop("sweep"), content["planner"].pop("threads")
    hashed = {"version": result.run["version"], "code": result.run["code_hash"], "settings": content}
    return Verdict(
        result.run["config_hash"][:12],
        data_fingerprint(hashed)[:12],
        result.run["config_hash"] == data_fingerprint(hashed),
    )


def identity(result: Evidence) -> Verdict:
    """Name, seed and stages of run.json agree with the settings."""
    settings = result.settings
    pairs = {"name": settings["name"], "seed": settings["seed"], "stages": settings["pipelines"]["stages"]}
    return no_fault(
        f"{settings['name']}, seed {settings['seed']}",
        [name for name, value in pairs.items() if result.run[name] != value],
    )


def inputs(result: Evidence) -> Verdict | None:
    """Input files that still exist have the fingerprint that run.json names; None if no file exists."""
    here = {name: digest for name, digest in result.run["inputs"].items() if Path(name).is_file()}
    if not here:
        return None
    return no_fault(
        f"{len(here)} of {len(result.run['inputs'])} files",
        [name for name, digest in here.items() if file_fingerprint(Path(name)) != digest],
    )


def seconds(result: Evidence) -> Verdict:
    """Times of the stages [s] add up to the time of the run; metrics.json and run.json agree."""
    stated = {
        name.removeprefix("seconds_"): value
        for name, value in result.metrics.items()
        if name.startswith("seconds_")
    }
    faults = [] if stated == result.run["seconds"] else ["stages differ"]
    faults += ["run_seconds"] * (not close(result.metrics["run_seconds"], math.fsum(stated.values()), 1e-9))
    if "growth_seconds" in result.metrics:
        speed = (
            result.metrics["nodes"] / result.metrics["growth_seconds"]
            if result.metrics["growth_seconds"]
            else math.nan
        )
        faults += ["nodes_per_second"] * (
            not close(result.metrics["nodes_per_second"] or math.nan, speed, 1e-9)
        )
    return no_fault(f"{result.metrics['run_seconds']:.4g} s", faults)


def ranges(result: Evidence) -> Verdict:
    """Every probability and share lies in [0, 1], every count and size is not negative."""
    faults = []
    for name, value in result.metrics.items():
        if value is None or isinstance(value, bool) or not isinstance(value, int | float):
            faults += [f"{name} is {value!r}"] * (name not in UNKNOWN or value is not None)
        elif name.startswith(SHARES) and not name.startswith(SIDES) and not -1e-12 <= value <= 1 + 1e-12:
            faults.append(f"{name} {value:g} is not between 0 and 1")
        elif name.startswith(COUNTS) and value < 0:
            faults.append(f"{name} {value:g} is negative")
    return no_fault(f"{len(result.metrics)} numbers", faults)


def known_names(result: Evidence) -> Verdict | None:
    """Every number of metrics.json is one that a plan has; None if another package has added a stage."""
    if not STAGES.issuperset(result.run["stages"]):
        return None
    scores = {} if not result.has("wind.nc") else result.wind.score
    known = NAMES.union(scores, (f"seconds_{stage}" for stage in result.run["seconds"]))
    return no_fault(f"{len(result.metrics)} numbers", [name for name in result.metrics if name not in known])


def intervals(result: Evidence) -> Verdict | None:
    """Every rate lies in its interval, at least as large as each of its parts and at most their sum.

    The parts are mission, collision and, if border=wall, leaving the map.
    """
    faults, metrics = [], result.metrics
    for law in ("independent", "coherent"):
        if f"failure_{law}" not in metrics:
            continue
        rate, low, high = (metrics[f"failure_{law}{end}"] for end in ("", "_low", "_high"))
        parts = [metrics[f"mission_failure_{law}"], metrics[f"collision_{law}"]]
        if result.scene["border"] == "wall":
            parts.append(metrics[f"off_map_{law}"])
        faults += [f"failure_{law}"] * (not low <= rate <= high)
        faults += [f"parts of failure_{law}"] * (
            not max(parts) - 1e-12 <= rate <= min(sum(parts), 1.0) + 1e-12
        )
    return no_fault("rates and their parts", faults)


CLAIMS = (
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
