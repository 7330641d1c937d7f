"""The figures of a comparison as Markdown: medians, and ratios with their 95 % intervals.

python -m peers.tables build/peers.json
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from peers.ratios import median, median_ratio

Figures = dict[str, Any]


class Row(NamedTuple):
    """One figure of ours and of a peer for each repetition; inf if a run has no result."""

    case: str
    figure: str
    peer: str
    ours: Sequence[float]
    theirs: Sequence[float]
    more: bool = False  # whether a larger figure is the better one
    digits: int = 1

    def cells(self) -> list[str]:
        better, worse = (self.theirs, self.ours) if self.more else (self.ours, self.theirs)
        ratio = median_ratio(better, worse)
        said = f"{ratio.value:.3g} ({ratio.low:.3g} to {ratio.high:.3g})"
        return [self.case, self.figure, self.shown(self.ours), self.peer, self.shown(self.theirs), said]

    def shown(self, values: Sequence[float]) -> str:
        middle = median(values)
        return "none" if middle == float("inf") else f"{middle:,.{self.digits}f}"


HEAD = ["", "figure", "ours", "peer", "theirs", "times better (95 %)"]


def markdown(data: Figures) -> str:
    """All tables of ``data``, with the machine and the versions."""
    versions = ", ".join(f"{name} {number}" for name, number in data["versions"].items())
    machine = data["machine"]
    told = (
        f"{data['date']}, {machine['processor']}, {machine['cores']} cores, {machine['system']}; "
        f"{data['repeats']} repetitions; {versions}."
    )
    missions = [row for name, case in data["missions"].items() for row in mission_rows(name, case)]
    logic = [row for name, case in data["logic"].items() for row in logic_rows(name, case)]
    return "\n\n".join([told, *(table(rows) for rows in (missions, logic) if rows)])


def table(rows: Sequence[Row]) -> str:
    lines = [HEAD, ["---"] * len(HEAD), *(row.cells() for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def mission_rows(name: str, case: Figures) -> Iterator[Row]:
    first = [number(value, 1e3) for value in case["first"]]
    speed = [plan["vertices"] / plan["grown"] / 1e3 for plan in case["plan"]]
    for peer, runs in case["ompl"].items():
        if not runs["first"]:
            continue
        theirs = [number(run["cpu"] if run["length"] else None, 1e3) for run in runs["first"]]
        yield Row(name, "first path [CPU ms]", f"OMPL {peer}", first, theirs, digits=2)
    for peer, runs in case["ompl"].items():
        half = [run["0.5"] for run in runs["budgets"]]
        if not half or not half[0]["vertices"]:
            continue  # AORRTC does not show its trees
        theirs = [run["vertices"] / run["cpu"] / 1e3 for run in half]
        free = [run["vertices"] / (run["cpu"] - run["checks"] * case["check_seconds"]) / 1e3 for run in half]
        yield Row(name, "thousand vertices per CPU second", f"OMPL {peer}", speed, theirs, more=True)
        yield Row(name, "the same", f"OMPL {peer}, without collision tests", speed, free, more=True)
    for peer, runs in case["ompl"].items():
        for budget in runs["budgets"][0] if runs["budgets"] else ():
            theirs = [number(run[budget]["length"]) for run in runs["budgets"]]
            ours = [length_after(float(budget), plan) for plan in case["plan"]]
            yield Row(name, f"length after {budget} CPU s [km]", f"OMPL {peer}", ours, theirs)
    if case["drake"]:
        sets = case["drake"][0]["sets"]
        ours = [plan["planned"] for plan in case["plan"]]
        theirs = [run["build"] + run["solve"] for run in case["drake"]]
        yield Row(name, "plan [CPU s]", f"Drake GCS, {sets} sets", ours, theirs, digits=2)
        lengths = [number(plan["planned_length"]) for plan in case["plan"]]
        theirs = [number(run["length"], 100.0) for run in case["drake"]]
        yield Row(name, "its length [km]", "Drake GCS", lengths, theirs)


def length_after(seconds: float, plan: Figures) -> float:
    """Length [km] of the smoothed plan if it is found in time, otherwise of the trees' best path or inf."""
    if plan["planned"] <= seconds:
        return number(plan["planned_length"])
    return number(plan["grown_length"]) if plan["grown"] <= seconds else float("inf")


def logic_rows(name: str, case: Figures) -> Iterator[Row]:
    ours = [number(value, 1e3) for value in case["ours"]]
    said = f"{name}, {case['states']:,} states"
    for key, peer in (("through", "ltlf2dfa with MONA"), ("alone", "MONA alone")):
        if case[key]:
            yield Row(said, "automaton [CPU ms]", peer, ours, [number(value, 1e3) for value in case[key]])


def number(value: float | None, scale: float = 1.0) -> float:
    """``value`` times ``scale``; inf for None."""
    return float("inf") if value is None else value * scale


if __name__ == "__main__":
    print(markdown(json.loads(Path(sys.argv[1]).read_text())))
