"""A table of budgets at the end of the terminal output: measured value, limit, and value of the last release.

A benchmark sets its budget in ``benchmark.extra_info``: ``budget`` [s] for its median time, or, for other
figures, ``figures`` = [(name, reached, limit), ...] with ``sense`` "<=" (default) or ">="; a fourth entry is
a figure's own sense. ``--record VERSION`` makes the measured values the ones of the last release.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from machine import cpu_facts, processor

LAST_RELEASE = Path(__file__).parent / "last_release.json"


class Figure(NamedTuple):
    """A measured value with its limit, both in seconds if ``timed``."""

    name: str
    reached: float
    sense: str
    limit: float
    timed: bool = False

    @property
    def kept(self) -> bool:
        return self.reached <= self.limit if self.sense == "<=" else self.reached >= self.limit

    def text(self, value: float) -> str:
        if not self.timed:
            return f"{value:,.4g}"
        return f"{value * 1e3:,.1f} ms" if value < 1 else f"{value:,.2f} s"


def pytest_addoption(parser: Any) -> None:
    parser.addoption(
        "--record", metavar="VERSION", help=f"write the figures of a release to {LAST_RELEASE.name}"
    )


def pytest_terminal_summary(terminalreporter: Any, config: Any) -> None:
    session = getattr(config, "_benchmarksession", None)
    figures = [figure for bench in getattr(session, "benchmarks", ()) for figure in _figures(bench)]
    if not figures:
        return
    release = json.loads(LAST_RELEASE.read_text()) if LAST_RELEASE.exists() else {"figures": {}}
    terminalreporter.section("budgets")
    if release["figures"]:
        terminalreporter.write_line(f"last release: {release['version']}, {release['machine']}")
    width = max(len(figure.name) for figure in figures)
    terminalreporter.write_line(f"{'':<{width}}  {'measured':>12}  {'budget':>12}  {'last release':>12}")
    for figure in figures:
        before = release["figures"].get(figure.name)
        columns = (
            figure.text(figure.reached),
            f"{figure.sense} {figure.text(figure.limit)}",
            "-" if before is None else figure.text(before),
        )
        cells = [f"{figure.name:<{width}}", *(f"{column:>12}" for column in columns)]
        terminalreporter.write_line("  ".join(cells if figure.kept else [*cells, "MISSED"]))
    if version := config.getoption("--record"):
        _record(version, release["figures"] | {figure.name: figure.reached for figure in figures})


def _record(version: str, figures: dict[str, float]) -> None:
    rounded = {name: float(f"{value:.4g}") for name, value in sorted(figures.items())}
    family = cpu_facts().get("cpu family", "?")
    machine = f"{processor()}, family {family}, Python {platform.python_version()}"
    document = {"version": version, "machine": machine, "figures": rounded}
    LAST_RELEASE.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")


def _figures(bench: Any) -> Iterator[Figure]:
    name = bench.name.removeprefix("test_").replace("_", " ")
    info = bench.extra_info
    if not bench.stats.data:  # it failed before its first repetition, and pytest says so
        return
    if "budget" in info:
        yield Figure(name, bench.stats.median, "<=", info["budget"], timed=True)
    for figure, reached, limit, *own in info.get("figures", ()):
        yield Figure(f"{name}: {figure}", reached, own[0] if own else info.get("sense", "<="), limit)
