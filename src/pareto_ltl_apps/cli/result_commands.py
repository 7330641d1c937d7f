"""What commands answer about a results directory; ``command_table`` has their arguments."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from careful_io.messages import shown_text, shown_value
from careful_io.texts import distance_text, interval_text, probability_text
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.run_status import ending_text
from pareto_ltl_apps.cli.output import COLUMNS, Answer, collected_warnings, shown_table

if TYPE_CHECKING:
    from pareto_ltl.extend import Front
    from pareto_ltl_verify.judge import Finding

LEG_NUMBER = "  12-14  "  # at the begin of a line on legs
CLAIM_FAILS = 3  # exit code; 1 is for a crash, 2 for an input that cannot be read


# --- the front and its points ----------------------------------------------------------------


def front(options: Namespace) -> Answer:
    """The paths of a front with all their costs."""
    from pareto_ltl import Run
    from pareto_ltl_apps.view.limits import chosen_number
    from pareto_ltl_apps.view.page.points import shown_points

    run = Run.open(options.directory)
    front = run.get("front")
    if front is None:
        status = run.provenance.get("status")
        why = "give the results of a plan" if status == "ok" else ending_text(options.directory, status)
        raise DataError(f"{options.directory}: there is no front: {why}")
    chosen = chosen_number(front, run.get("plan"))
    points = [
        {"path": k, **row, "further": dict(path.objectives.further_costs)}
        for k, (row, path) in enumerate(zip(shown_points(front), front.paths, strict=True))
    ]
    return Answer(
        {"directory": options.directory, "plan": chosen, "points": points},
        list(_front_lines(front, points, chosen)),
    )


def _front_lines(front: Front, points: Sequence[dict[str, Any]], chosen: int | None) -> Iterator[object]:
    flown = bool(front.rates)
    risk = f"{'fails (95 %)' if flown else 'V + R'},\n{front.models.law} winds"
    costs = map(str, front.paths[0].objectives.further_costs)
    rows = [
        (
            f"{'plan ' if point['path'] == chosen else ''}{point['path']}",
            _risk_text(point),
            distance_text(point["length_m"]),
            f"{point['duration_s'] / 3600:.2f}",
            *point["costs"],
            point["order"],
        )
        for point in points
    ]
    yield shown_table(("path", risk, "length", "hours", *costs, "order"), rows, left=("order",))
    if flown:
        yield f"rates of the {points[0]['runs']:,} flights that the front was chosen with"
    yield "pareto-ltl choose DIR --point N takes another path as the plan"


def _risk_text(point: dict[str, Any]) -> str:
    """A rate with its interval, short enough for one line; or a bound."""
    if point["failure_low"] is None:
        return probability_text(point["failure"])
    interval = interval_text(point["failure_low"], point["failure_high"]).removesuffix(" %")
    return f"{probability_text(point['failure'])} ({interval})"


def choose(options: Namespace) -> Answer:
    """Write the plan of another path."""
    from pareto_ltl import Run
    from pareto_ltl.extend import Choice
    from pareto_ltl_apps.cli.summary import run_answer

    choice = Choice(
        failure=options.failure, energy=options.energy, length=options.length, knee=options.knee,
        point=options.point, selection=read_selection(options.rule, options.settings),
    )  # fmt: skip
    source = Run.open(options.directory)
    place = options.out or choice.place(source.place)
    with collected_warnings() as warnings:
        words = ("pareto-ltl", "choose", *options.words)
        run = choice.make(source, place, words)
    return run_answer(run, place, run.metrics, warnings)


def read_selection(rule: str | None, words: Sequence[str]) -> dict[str, Any] | None:
    """Settings of the selection from ``rule`` and words ``selection.KEY=VALUE``; None without a rule.

    Raises
    ------
    ConfigError
        If there are words without a rule, or one that is no setting of the selection.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException
    from yaml import YAMLError

    words = [word.removeprefix("+") for word in words]  # Hydra asks for it before a new key
    for word in words:
        if rule is None or not word.startswith("selection.") or "=" not in word:
            raise ConfigError(
                f"{shown_value(word)} is not known; expected selection.KEY=VALUE, with --rule NAME"
            )
    try:
        read: Any = OmegaConf.to_container(OmegaConf.from_dotlist(words))
    except (OmegaConfBaseException, YAMLError) as error:
        raise ConfigError(f"{shown_value(' '.join(words))} cannot be read: {error}") from None
    return None if rule is None else {**read.get("selection", {}), "rule": rule}


def export(options: Namespace) -> Answer:
    """Write files of a plan."""
    from pareto_ltl import export

    settings: dict[str, Any] = {}
    if options.altitude is not None:
        settings["altitude"] = options.altitude
    if options.between is not None:
        settings["altitude_lower"], settings["altitude_upper"] = options.between
    name = "exports" if options.point is None else f"exports_point_{options.point}"
    place = options.to or options.directory / name
    written = export(options.directory, place, options.formats, point=options.point, **settings)
    return Answer({"files": written}, [str(path) for path in written], written)


# --- what a plan is --------------------------------------------------------------------------


def show(options: Namespace) -> Answer:
    """Open the page of a result; without a browser, only its path is given."""
    from pareto_ltl_apps.view.showing import open_page, page_of

    path = page_of(options.directory, as_is=options.as_is).resolve()
    opened = not options.print and open_page(path)
    lines = [f"opened {path}" if opened else str(path)]
    if not opened and not options.print:
        lines.append("found no browser: copy this file to a machine with a browser, and open it there")
    return Answer({"page": path, "opened": opened}, lines, [path])


def explain(options: Namespace) -> Answer:
    """A plan leg by leg, or what limits it."""
    from pareto_ltl_apps.view.showing import explanation

    if options.branches:
        return _explain_branches(options)
    reported = explanation(options.directory, point=options.point, limits=options.limits, each=options.legs)
    lines = list(chain.from_iterable(map(_in_columns, reported.lines)))
    return Answer({"directory": options.directory, **reported.document}, lines)


def _explain_branches(options: Namespace) -> Answer:
    """Where a plan branches, and what each number of branches would give."""
    from pareto_ltl import Run
    from pareto_ltl_apps.exports.branches import branch_lines

    if options.point is not None or options.limits or options.legs:
        raise ConfigError("--branches shows the branches of the plan: leave out --point, --limits and --legs")
    run = Run.open(options.directory)
    tree = run.plan.branching
    if tree is None:
        raise DataError(
            f"{options.directory}: the plan has no branches: plan with branch.leaves=2 and branch.at=[HOURS]"
        )
    document = {
        "directory": options.directory,
        "step": tree.fix.step,
        "failure": tree.rate.failure,
        "alone": tree.alone.failure,
        "branches": [
            {
                "name": one.name,
                "step": own.fix.step,
                "where": one.cell.words,
                "share": one.share,
                "failure": one.rate.failure,
            }
            for own, one in tree.all_branches()
        ],
    }
    lines = list(chain.from_iterable(map(_in_columns, branch_lines(run.plan, run.scene.frame))))
    return Answer(document, lines)


def _in_columns(line: str) -> list[str]:
    """``line`` in lines of at most ``COLUMNS`` characters, those after the first one indented."""
    indent = " " * (len(LEG_NUMBER) if line.startswith(" ") else 2)
    return wrap(line, COLUMNS, subsequent_indent=indent, break_on_hyphens=False) or [line]


def beacons(options: Namespace) -> Answer:
    """The best places for beacons; writes table and figure."""
    from pareto_ltl.extend import planned_run
    from pareto_ltl_apps.flight import beacons

    run = planned_run(options.directory)
    found = beacons.beacons(run, radius=options.radius, number=options.number, flights=options.flights)
    folder = options.out or options.directory / "beacons"
    beacons.write_beacons(run, found, folder)
    lines = [*beacons.beacon_lines(run, found), f"table and figure in {folder}"]
    return Answer({"directory": folder, **beacons.beacon_document(run, found)}, lines, [folder])


def verify(options: Namespace) -> Answer:
    """Check a result; the exit code is 0 if all claims hold and 3 if one fails."""
    from pareto_ltl_verify.evidence import open_evidence
    from pareto_ltl_verify.judge import judge_evidence, needs_rerun, unchecked_claims

    result = open_evidence(options.directory, options.source)
    found = judge_evidence(result)
    failed = [finding for finding in found if not finding.holds]
    shown, unchecked = failed if options.failed_only else found, unchecked_claims(result)
    unprovable = () if options.failed_only else needs_rerun(result)
    broken = f"{len(failed)} of {len(found)} claims fail: {'; '.join(finding.claim for finding in failed)}"
    lines = [
        *chain.from_iterable(map(_claim_lines, shown)),
        broken if failed else f"{len(found)} claims hold",
        *(f"not checked, because {reason}: {'; '.join(claims)}" for reason, claims in unchecked.items()),
        *([f"only pareto-ltl rerun can show: {'; '.join(unprovable)}"] if unprovable else []),
    ]
    document = {
        "directory": options.directory,
        "claims": [
            {"claim": f.claim, "claimed": f.claimed, "derived": f.derived, "holds": f.holds} for f in shown
        ],
        "checked": len(found),
        "failed": len(failed),
        "unchecked": unchecked,
        "needs_rerun": list(needs_rerun(result)),
    }
    return Answer(document, lines, code=CLAIM_FAILS if failed else 0)


def _claim_lines(found: Finding) -> tuple[str, ...]:
    """A line of 80 columns for a claim that holds; what is claimed and what follows for one that fails."""
    if found.holds:
        return (shown_text(f"holds  {found.claim}: {found.claimed}"),)
    return (
        f"FAILS  {found.claim}",
        f"       claimed     {found.claimed}",
        f"       re-derived  {found.derived}",
    )


# --- the rest of a flight --------------------------------------------------------------------


def replan(options: Namespace) -> Answer:
    """Write a new plan for the rest of a flight."""
    from pareto_ltl import replan
    from pareto_ltl_apps.flight.replanning import comparison_lines, replan_document

    if options.time is None and options.fixes is None:
        raise ConfigError(
            "replan needs --time, e.g. --time 6h, or --fixes FILE.csv with the times of the fixes"
        )
    place = options.out or default_place(options.directory, options.time or options.fixes.stem)
    done = replan(
        options.directory, options.time, options.fix, fixes=options.fixes, wind=options.wind,
        quick=not options.full, out=place,
    )  # fmt: skip
    document = {"directory": place, "advice": done.advice, **replan_document(done, str(options.directory))}
    return Answer(document, [*comparison_lines(done), f"results in {place}"], [place])


def default_place(directory: Path, time: str) -> Path:
    """A folder beside ``directory``, with the time in its name."""
    directory = directory.resolve()
    kept = "".join(letter for letter in time if letter.isalnum())
    return directory.with_name(f"{directory.name}_replanned_{kept}")
