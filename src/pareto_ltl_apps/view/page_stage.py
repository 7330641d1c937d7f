"""``report.html`` of a run: of a run that works, and from a results directory."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from careful_io.files import write_bytes
from careful_io.reading import read_json, read_text
from pareto_ltl import Run, Settings
from pareto_ltl_apps.view import PAGE_FILE

if TYPE_CHECKING:
    from pareto_ltl_apps.view.records import Origin, ShownRun

LOG = logging.getLogger("pareto_ltl.view.page_stage")
MAX_RUNS = 500  # flights of each point of the front
SHOWN_FACTS = ("seed", "fidelity", "version", "code_hash", "config_hash", "python")


def make_page(run: Run) -> Path:
    """``report.html`` from the records that exist; without a plan the page states the reason."""
    from pareto_ltl_apps.view.records import Origin

    place, hashes = run.place, run.input_hashes()
    begun = (place / "run.json").is_file()  # only a pipeline writes it, before its first stage
    origin = origin_of(place, read_json(place / "run.json"), hashes) if begun else Origin("", {}, hashes, "")
    return write_page(place / PAGE_FILE, shown_run(run, origin, run.failure))


def write_page(path: Path, shown: ShownRun) -> Path:
    """Write the page of ``shown`` as ``path``; return it."""
    from pareto_ltl_apps.view.page.content import page_bytes, page_content

    write_bytes(path, page_bytes(page_content(shown)))
    return path


def shown_run(run: Run, origin: Origin, why: str = "") -> ShownRun:
    """The records of ``run`` for the page; points of the front are flown in the winds of the plan."""
    from pareto_ltl_apps.view.records import ShownRun

    settings, height, plan = run.settings, run.settings.flight_height, run.get("plan")
    return ShownRun(
        name=settings.name,
        seeds=run.seeds("deployment"),
        origin=origin,
        height=height,
        air=(plan and plan.air) or settings.flight_air(height),
        runs=min(settings.deployment.runs, MAX_RUNS),
        why=why,
        automaton=run.get("automaton"),
        problem=run.get("problem"),
        **drawn_records(run),
    )


def drawn_records(run: Run) -> dict[str, Any]:
    """The records that figures and page show, as arguments of their ``DrawnRun``; None if not made."""
    shown = {name: run.get(name) for name in ("forest", "front", "plan", "deployments", "forecasts")}
    for name in ("deployments", "forecasts"):
        shown[name] = shown[name] or {}
    return run.make("scene", "wind") | shown


# --- where a result comes from -----------------------------------------------------------------


def origin_in_memory(settings: Settings) -> Origin:
    """The origin of a plan that was made in this process and has no directory."""
    record = Run(settings).provenance
    return _origin(record, Run(settings).input_hashes(), settings.as_yaml())


def origin_of(directory: Path, record: Mapping[str, Any], inputs: Mapping[str, str]) -> Origin:
    """The origin from ``run.json`` (``record``) and ``config_resolved.yaml`` of ``directory``."""
    return _origin(record, inputs, read_text(directory / "config_resolved.yaml"))


def _origin(record: Mapping[str, Any], inputs: Mapping[str, str], settings: str) -> Origin:
    import shlex

    from pareto_ltl_apps.view.records import Origin

    argv = [str(word) for word in record.get("argv", ())]
    facts = {key.replace("_", " "): str(record[key]) for key in SHOWN_FACTS if record.get(key) is not None}
    git = record.get("git") or {}
    if git.get("commit"):
        facts["commit"] = f"{git['commit']}{' and changes' if git.get('changed') else ''}"
    packages = record.get("packages") or {}
    facts["packages"] = ", ".join(f"{name} {number}" for name, number in packages.items() if number)
    return Origin(
        command=shlex.join(["pareto-ltl", *argv]) if argv else "",
        facts=facts,
        inputs={Path(name).name: str(digest) for name, digest in inputs.items()},
        settings=settings,
    )
