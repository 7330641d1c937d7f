"""Run the cases and print seconds, memory and slope; ``make scale ARGS="states coverage"`` picks by name.

Each size runs in its own process, whose peak memory is measured. Machine code is compiled before that, in a
run of the smallest size that is not counted.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scale.case import GIBIBYTE, Case
from scale.planning import CASES as PLANNING

FOLDER = Path(__file__).parents[2] / "outputs" / "scale"
HEAD = f"{'size':>10}  {'seconds':>9}  {'limit':>7}  {'GiB':>6}  {'limit':>6}"
PATIENCE = 3.0  # times the limit: then a size is given up
COMPILING = 200.0  # [s] before the first size
STARTING = 60.0  # [s] more, for reading data and machine code


@dataclass(frozen=True, slots=True)
class Measured:
    """Measurement of one size: ``seconds`` is NaN if there is no answer, and ``fault`` says why."""

    size: int
    seconds: float
    memory: float
    fault: str = ""


def all_cases() -> list[Case]:
    """The cases of planning, and of the wind if their module exists."""
    try:
        from scale.wind import CASES as WIND
    except ImportError:
        return PLANNING
    return [*PLANNING, *WIND]


def measure(case: Case, size: int) -> Measured:
    """Measure one size in a new process."""
    command = [sys.executable, "-m", "scale", "--one", case.name, str(size)]
    folder = Path(__file__).parents[1]
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE * case.limit + 60,
        )
    except subprocess.TimeoutExpired:
        return Measured(size, math.nan, math.nan, f"no answer within {PATIENCE * case.limit + 60:.0f} s")
    lines = done.stdout.splitlines()
    if done.returncode != 0 or not lines:
        tail = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
        return Measured(size, math.nan, math.nan, tail)
    found = json.loads(lines[-1])
    return Measured(size, found["seconds"], found["memory"])


def run_one(case: Case, size: int) -> None:
    """The work of the new process; the last line that it prints is the result."""
    seconds = case.run(size)
    memory = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({"seconds": seconds, "memory": memory}))


def slope(rows: Sequence[Measured]) -> float:
    """Exponent b of seconds = a size^b by least squares over the three largest sizes."""
    known = [row for row in rows if math.isfinite(row.seconds)][-3:]
    if len(known) < 2:
        return math.nan
    x, y = (
        [math.log(value) for value in column]
        for column in zip(*[(r.size, r.seconds) for r in known], strict=True)
    )
    mx, my = sum(x) / len(x), sum(y) / len(y)
    return sum((a - mx) * (b - my) for a, b in zip(x, y, strict=True)) / sum((a - mx) ** 2 for a in x)


def missed(case: Case, rows: Sequence[Measured]) -> bool:
    """Whether the largest size has no answer or takes more than allowed."""
    last = rows[-1]
    kept = last.size == case.sizes[-1] and last.seconds <= case.limit and last.memory <= case.memory
    return not kept


def show(case: Case, row: Measured) -> str:
    """One line of the table."""
    if not math.isfinite(row.seconds):
        return f"{row.size:>10,}  no answer: {row.fault[:120]}"
    end = row.size == case.sizes[-1]
    seconds, memory = (f"{case.limit:.0f}", f"{case.memory / GIBIBYTE:.2f}") if end else ("", "")
    return f"{row.size:>10,}  {row.seconds:>9.2f}  {seconds:>7}  {row.memory / GIBIBYTE:>6.2f}  {memory:>6}"


def draw(case: Case, rows: Sequence[Measured], folder: Path) -> None:
    """Seconds against size on logarithmic axes, with the limit at the largest size."""
    from pareto_ltl_apps.view.style import blank_figure, report_style, save_figure

    known = [row for row in rows if math.isfinite(row.seconds)]
    if not known:
        return
    with report_style():
        figure = blank_figure(3.4, 2.5)
        ax = figure.add_axes((0.17, 0.19, 0.79, 0.69))
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.plot([r.size for r in known], [r.seconds for r in known], "o-", ms=3.5, lw=1.1)
        ax.plot(case.sizes[-1], case.limit, "_", color="black", ms=14)
        ax.annotate("limit", (case.sizes[-1], case.limit), (-8, -3), textcoords="offset points", ha="right")
        ax.set_ylim(top=2.0 * max(case.limit, *[r.seconds for r in known]))
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter("{x:,g}")
            axis.set_minor_formatter("")
        ax.set_xlabel(case.unit)
        ax.set_ylabel("seconds")
        ax.set_title(f"{case.name}: slope {slope(rows):.1f}")
        folder.mkdir(parents=True, exist_ok=True)
        save_figure(figure, folder, case.name.replace(", ", "_").replace(" ", "_"), 200)


def run_case(case: Case, folder: Path) -> bool:
    """Measure, print and draw one case; whether its limits are kept."""
    print(f"\n{case.name} [{case.unit}]\n{HEAD}", flush=True)
    rows: list[Measured] = []
    measure(Case(case.name, case.sizes, case.run, case.unit, COMPILING), case.sizes[0])
    for size in case.sizes:
        rows.append(measure(case, size))
        print(show(case, rows[-1]), flush=True)
        if not math.isfinite(rows[-1].seconds):
            break
    bad = missed(case, rows)
    print(f"{'slope':>10}  {slope(rows):>9.2f}  {'MISSED' if bad else ''}", flush=True)
    draw(case, rows, folder)
    return not bad


def main() -> int:
    """Run the chosen cases; return 1 if a limit is exceeded, otherwise 0."""
    parser = argparse.ArgumentParser(prog="make scale", description=__doc__)
    parser.add_argument("names", nargs="*", help="beginnings of the names of cases; default: all")
    parser.add_argument("--one", nargs=2, metavar=("CASE", "SIZE"), help=argparse.SUPPRESS)
    asked, cases = parser.parse_args(), all_cases()
    if asked.one:
        run_one({case.name: case for case in cases}[asked.one[0]], int(asked.one[1]))
        sys.stdout.flush()
        os._exit(0)  # large forests take seconds to free
    chosen = [c for c in cases if not asked.names or any(c.name.startswith(name) for name in asked.names)]
    if not chosen:
        parser.error(f"no case begins so; there are: {'; '.join(case.name for case in cases)}")
    kept = [run_case(case, FOLDER) for case in chosen]
    print(f"\n{sum(kept)} of {len(kept)} cases keep their limits; figures are in {FOLDER}")
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
