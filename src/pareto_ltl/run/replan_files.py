"""Files and summary of a plan that was made during the flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pareto_ltl.run.directory import claimed_directory
from pareto_ltl.run.pipeline import Run, carry_out
from pareto_ltl.run.records import FRONT, PLAN, Records
from pareto_ltl.run.replanning import ADVICE, Replanned
from pareto_ltl.run.rest_of_flight import AUTOMATON_FILE
from pareto_ltl.support.display import distance_text, probability_text
from pareto_ltl.support.files import write_json

OF_RATES = ("front", "forecasts", "deployment")  # stages whose files are probabilities: not after an alarm


def write_replanned(done: Replanned, run: Run, place: Path, source: str, argv: Sequence[str] = ()) -> None:
    """Write a results directory of the new plan; without a fix, the rest of the old one as ``plan.json``."""
    from pareto_ltl.run.results import save_record

    with claimed_directory(place, run.table.files):
        if done.run is not None:
            settings, records = done.run.settings, done.run.records
            mission = replace(settings.mission, automaton=str(place / AUTOMATON_FILE))
            if done.situation.alarms:
                left = [name for name in settings.pipelines.stages if name not in OF_RATES]
                settings = replace(settings, pipelines=replace(settings.pipelines, stages=left))
                records = Records({key: records[key] for key in records if key is not FRONT})
            written = Run(
                replace(settings, mission=mission), run.table, records, dict(done.run.seconds), place
            )
            stages = [run.table[name] for name in settings.pipelines.stages]
            carry_out(written, [s for s in stages if s.makes not in written.records], argv)
        else:
            place.mkdir(parents=True, exist_ok=True)
            save_record(place, PLAN, done.plan)
        write_json(place / "replan.json", replan_document(done, source))


def replan_document(done: Replanned, source: str) -> dict[str, Any]:
    """The content of ``replan.json``: the old plan, time and position, and the comparison of both plans."""
    at, learnt = done.situation, done.situation.learnt
    compared = not at.alarms
    return {
        "schema": "pareto_ltl.replan/2",
        "source": source,
        "step": at.step,
        "time_s": at.time,
        "fixes": [
            {"step": fix.step, "place": fix.place, "sd": fix.sd, "distance": far}
            for fix, far in zip(at.fixes, () if learnt is None else learnt.distance.tolist(), strict=True)
        ],
        "wind": done.wind or None,
        "alarms": list(at.alarms),
        "position": None
        if learnt is None
        else {"mean": learnt.mean, "cov": learnt.cov, "before": learnt.before},
        "state": at.state,
        "certainty": at.certainty,
        "rest": {"x": done.rest.x, "u": done.rest.u},
        "old": asdict(done.old) if compared and done.old is not None else None,
        "new": asdict(done.new) if compared else None,
        "difference": dict(zip(("middle", "low", "high"), done.difference, strict=True))
        if compared and done.old is not None
        else None,
    }


def comparison_lines(done: Replanned) -> list[str]:
    """The summary for the user."""
    at = done.situation
    lines = [f"step {at.step}, {at.time / 3600:.4g} h after departure"]
    if at.learnt is None:
        return [
            *lines,
            "no fix: there is no new information, and the rest of the plan is unchanged; "
            f"the failure rate of the whole flight is {done.old}",
        ]
    if at.fixes:
        lines.append(
            f"position known to {distance_text(at.learnt.sd)} (before: {distance_text(at.learnt.sd_before)} "
            f"or more); automaton state {at.state}, reached by {probability_text(at.certainty)} of the "
            "histories that lead to the fix"
        )
    else:
        lines.append(f"no fix: the position is known to {distance_text(at.learnt.sd)}; the forecast is new")
    lines += [f"wind: {done.wind}"] if done.wind else []
    rest, new = (distance_text(path.objectives.length) for path in (done.rest, done.plan.path))
    if at.alarms:
        alarms = [f"ALARM: {alarm}" for alarm in at.alarms]
        return [*lines, *alarms, f"new plan: {new}; planned in {done.seconds:.1f} s", ADVICE["alarm"]]
    fails = f"failure rate of the new plan ({new}): {done.new}"
    if done.old is None:
        return [*lines, fails, f"planned in {done.seconds:.1f} s", ADVICE[done.advice]]
    gap, low, high = (100.0 * value for value in done.difference)
    lines += [
        f"failure rate of the rest of the old plan ({rest}): {done.old}",
        fails,
        f"difference: {gap:+.2f} points [{low:+.2f}, {high:+.2f}]; planned in {done.seconds:.1f} s",
        ADVICE[done.advice],
    ]
    return lines
