"""Claims about the run itself: how it ended, its files, its inputs, and the ranges of its metrics."""

from __future__ import annotations

import math
from pathlib import Path

from pareto_ltl.support.fingerprints import data_fingerprint, file_fingerprint
from pareto_ltl.verify.claims.verdict import Claim, Verdict, close, no_fault
from pareto_ltl.verify.evidence import OUTPUTS, Evidence

SHARES = (
    "mission_risk", "collision_risk", "failure", "collision_", "promise_failure", "promise_low",
    "promise_high", "promise_claimed", "promise_bound", "promise_passed", "least_failure", "hypervolume",
    "wind_energy", "wind_rho", "gp_coverage", "completed", "safest",
)  # fmt: skip
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
)


def status(result: Evidence) -> Verdict:
    """A run with status ok has a plan, an infeasible one has none, and the metrics agree with that."""
    planned = result.has("plan.json")
    said = (result.run["status"], float(result.metrics["completed"]))
    fitting = ("ok", 1.0) if planned else ("infeasible", 0.0)
    faults = (
        []
        if said == fitting
        else [f"plan.json {'is' if planned else 'is not'} there, metrics completed {said[1]:g}"]
    )
    faults += ["measured"] * (result.run["measured"] is not True)
    faults += ["an error is noted"] * ((result.run["error"] is not None) == planned)
    return no_fault(str(said[0]), faults)


def files(result: Evidence) -> Verdict:
    """The files of every stage that ended are there."""
    ended = result.run["stages"] if result.run["status"] == "ok" else list(result.run["seconds"])[:-1]
    if result.run["status"] != "ok":
        ended = [stage for stage in ended if stage in ("scene", "decomposition", "automaton", "wind")]
    missing = [name for stage in ended for name in OUTPUTS.get(stage, ()) if not result.has(name)]
    return no_fault(f"{len(ended)} stages", [f"{name} is missing" for name in missing])


def settings_hash(result: Evidence) -> Verdict:
    """The fingerprint of the settings in config_resolved.yaml is that of run.json."""
    content = {
        name: dict(value) if isinstance(value, dict) else value for name, value in result.settings.items()
    }
    content.pop("sweep"), content["planner"].pop("threads")
    told = {"version": result.run["version"], "code": result.run["code_hash"], "settings": content}
    return Verdict(
        result.run["config_hash"][:12],
        data_fingerprint(told)[:12],
        result.run["config_hash"] == data_fingerprint(told),
    )


def identity(result: Evidence) -> Verdict:
    """Name, seed and stages of run.json are those of the settings."""
    told = result.settings
    pairs = {"name": told["name"], "seed": told["seed"], "stages": told["pipelines"]["stages"]}
    return no_fault(
        f"{told['name']}, seed {told['seed']}",
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
    """Times of the stages [s] add up to that of the run and are the same in metrics.json and run.json."""
    told = {
        name.removeprefix("seconds_"): value
        for name, value in result.metrics.items()
        if name.startswith("seconds_")
    }
    faults = [] if told == result.run["seconds"] else ["stages differ"]
    faults += ["run_seconds"] * (not close(result.metrics["run_seconds"], math.fsum(told.values()), 1e-9))
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
            faults += [f"{name} is {value!r}"] * (name != "nodes_per_second" or value is not None)
        elif name.startswith(SHARES) and not name.endswith(("_m", "_j")) and not -1e-12 <= value <= 1 + 1e-12:
            faults.append(f"{name} {value:g} is not between 0 and 1")
        elif name.startswith(COUNTS) and value < 0:
            faults.append(f"{name} {value:g} is negative")
    return no_fault(f"{len(result.metrics)} numbers", faults)


def intervals(result: Evidence) -> Verdict | None:
    """Every rate lies in its interval, at least as large as each of its parts and at most their sum.

    The parts are mission, collision and, if border=wall, leaving the map.
    """
    faults, told = [], result.metrics
    for law in ("independent", "coherent"):
        if f"failure_{law}" not in told:
            continue
        rate, low, high = (told[f"failure_{law}{end}"] for end in ("", "_low", "_high"))
        parts = [told[f"mission_failure_{law}"], told[f"collision_{law}"]]
        if result.scene["border"] == "wall":
            parts.append(told[f"off_map_{law}"])
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
    Claim("metrics: rates and intervals", (), intervals),
)
