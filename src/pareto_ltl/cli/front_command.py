"""``pareto-ltl front DIR``: the paths of a front, as a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer
from pareto_ltl.support.display import distance_text, interval_text, probability_text
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.run_status import ending_text

if TYPE_CHECKING:
    from pareto_ltl.planning.records import Front


def front_command(argv: Sequence[str]) -> Answer:
    """The paths of a front with all their costs."""
    parser = CommandArguments(
        prog="pareto-ltl front",
        description="Show the paths of the front of DIR: failure rate, length, duration and further costs. "
        "The plan is marked. front.csv has more columns.",
    )
    parser.add_result()
    options = parser.parse_args(argv)
    from pareto_ltl.report.limits import chosen_number
    from pareto_ltl.report.page.points import shown_points
    from pareto_ltl.run.interface import load_results
    from pareto_ltl.run.records import FRONT, PLAN

    results = load_results(options.directory)
    records = results.records()
    if FRONT not in records:
        status = results.run.get("status")
        why = "give the results of a plan" if status == "ok" else ending_text(options.directory, status)
        raise DataError(f"{options.directory}: there is no front: {why}")
    front = records[FRONT]
    chosen = chosen_number(front, records.get(PLAN))
    points = [
        {"path": k, **row, "further": dict(path.objectives.further_costs)}
        for k, (row, path) in enumerate(zip(shown_points(front), front.paths, strict=True))
    ]
    return Answer(
        {"directory": options.directory, "plan": chosen, "points": points},
        list(_lines(front, points, chosen)),
    )


def _lines(front: Front, points: Sequence[dict[str, Any]], chosen: int | None) -> Iterator[object]:
    from rich import box
    from rich.table import Table

    flown = bool(front.rates)
    risk = f"{'fails (95 %)' if flown else 'V + R'},\n{front.models.law} winds"
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("path", justify="right")
    for column in (risk, "length", "hours", *map(str, front.paths[0].objectives.further_costs)):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("order")
    for point in points:
        mark = "plan " if point["path"] == chosen else ""
        table.add_row(
            f"{mark}{point['path']}",
            _rate_text(point),
            distance_text(point["length_m"]),
            f"{point['duration_s'] / 3600:.2f}",
            *point["costs"],
            point["order"],
        )
    yield table
    if flown:
        yield f"rates of the {points[0]['runs']:,} flights that the front was chosen with"
    yield "pareto-ltl choose DIR --point N takes another path as the plan"


def _rate_text(point: dict[str, Any]) -> str:
    """A rate with its interval, short enough for one line; or a bound."""
    if point["failure_low"] is None:
        return probability_text(point["failure"])
    interval = interval_text(point["failure_low"], point["failure_high"]).removesuffix(" %")
    return f"{probability_text(point['failure'])} ({interval})"
