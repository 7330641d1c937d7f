"""``report.html`` of a run: its stage, and the same page from a results directory."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.run import provenance
from pareto_ltl.run import records as keys
from pareto_ltl.run.stage_table import StageInputs
from pareto_ltl.settings import Settings
from pareto_ltl.settings.heights import flight_air, flight_height
from pareto_ltl.settings.outputs import PAGE_FILE
from pareto_ltl.support.files import write_bytes
from pareto_ltl.support.reading import read_json, read_text

if TYPE_CHECKING:
    from numpy.random import SeedSequence

    from pareto_ltl.report.records import Origin, ShownRun
    from pareto_ltl.run.records import Records

LOG = logging.getLogger(__name__)
DEPLOYMENT_STREAM = "deployment"
MOST_RUNS = 500  # flights of each point of the front
SHOWN_FACTS = ("seed", "fidelity", "version", "code_hash", "config_hash", "python")


def make_page(inputs: StageInputs) -> tuple[Path, ...]:
    """``report.html`` from the records that exist; without a plan the page states the reason."""
    settings = inputs.settings
    if not settings.report.page:
        return ()
    from pareto_ltl.report.records import Origin

    place, hashes = inputs.directory, inputs.hashes
    begun = (place / "run.json").is_file()  # only a pipeline writes it, before its first stage
    origin = origin_of(place, read_json(place / "run.json"), hashes) if begun else Origin("", {}, hashes, "")
    shown = shown_run(settings, inputs.records, origin, inputs.seeds, inputs.failure)
    return (write_page(place / PAGE_FILE, shown),)


def write_page(path: Path, shown: ShownRun) -> Path:
    """Write the page of ``shown`` as ``path``; return it."""
    from pareto_ltl.report.page.content import page_bytes, page_content

    write_bytes(path, page_bytes(page_content(shown)))
    return path


def shown_run(
    settings: Settings, records: Records, origin: Origin, seeds: SeedSequence, why: str = ""
) -> ShownRun:
    """The records for the page, selected from ``records``; ``seeds`` are the seeds of the deployment."""
    from pareto_ltl.report.records import ShownRun

    height, plan = flight_height(settings), records.get(keys.PLAN)
    return ShownRun(
        name=settings.name,
        seeds=seeds,
        origin=origin,
        height=height,
        air=(plan and plan.air) or flight_air(settings, height),
        runs=min(settings.deployment.runs, MOST_RUNS),
        why=why,
        automaton=records.get(keys.AUTOMATON),
        problem=records.get(keys.PROBLEM),
        **drawn_records(records),
    )


def drawn_records(records: Records) -> dict[str, Any]:
    """The records that figures and page show, as arguments of their ``DrawnRun``; None if not made."""
    return {
        "scene": records[keys.SCENE],
        "wind": records[keys.WIND],
        "forest": records.get(keys.FOREST),
        "front": records.get(keys.FRONT),
        "plan": records.get(keys.PLAN),
        "deployments": records.get(keys.DEPLOYMENTS) or {},
        "forecasts": records.get(keys.FORECASTS) or {},
    }


# --- where a result comes from -----------------------------------------------------------------


def origin_in_memory(settings: Settings) -> Origin:
    """The origin of a plan that was made in this process and has no directory."""
    record = provenance.begin(settings, ())
    return _origin(record, provenance.input_hashes(settings), provenance.settings_text(settings))


def origin_of(directory: Path, record: Mapping[str, Any], inputs: Mapping[str, str]) -> Origin:
    """The origin from ``run.json`` (``record``) and ``config_resolved.yaml`` of ``directory``."""
    return _origin(record, inputs, read_text(directory / "config_resolved.yaml"))


def _origin(record: Mapping[str, Any], inputs: Mapping[str, str], settings: str) -> Origin:
    import shlex

    from pareto_ltl.report.records import Origin

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
