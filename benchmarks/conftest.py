"""A table of budgets at the end of the terminal output: measured value and limit.

A benchmark sets its budget in ``benchmark.extra_info``: ``budget`` [s] for its median time, or, for other
figures, ``figures`` = [(name, reached, limit), ...] with ``sense`` "<=" (default) or ">="; a fourth entry is
a figure's own sense.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

Row = tuple[str, str, str, bool]


def pytest_terminal_summary(terminalreporter: Any, config: Any) -> None:
    session = getattr(config, "_benchmarksession", None)
    rows = [row for bench in getattr(session, "benchmarks", ()) for row in _rows(bench)]
    if not rows:
        return
    terminalreporter.section("budgets")
    width = max(len(name) for name, *_ in rows)
    for name, reached, limit, kept in rows:
        terminalreporter.write_line(
            f"{name:<{width}}  {reached:>14}  {limit:>16}  {'' if kept else 'MISSED'}"
        )


def _rows(bench: Any) -> Iterator[Row]:
    name = bench.name.removeprefix("test_").replace("_", " ")
    info = bench.extra_info
    if "budget" in info:
        median = bench.stats.median
        yield name, _seconds(median), f"<= {_seconds(info['budget'])}", median <= info["budget"]
    for figure, reached, limit, *own in info.get("figures", ()):
        sense = own[0] if own else info.get("sense", "<=")
        kept = reached <= limit if sense == "<=" else reached >= limit
        yield f"{name}: {figure}", f"{reached:,.4g}", f"{sense} {limit:,.4g}", kept


def _seconds(value: float) -> str:
    return f"{value * 1e3:,.1f} ms" if value < 1 else f"{value:,.2f} s"
