"""All figures of one run.

``plan`` shows the plan and its simulated flights, ``front`` the paths it was selected from, ``wind`` the wind
field. A run without a plan still has a map with its trees.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from matplotlib.collections import LineCollection

from pareto_ltl.report import style
from pareto_ltl.report.front import front_figure
from pareto_ltl.report.map import plan_figure
from pareto_ltl.report.map_layers import tree_layer
from pareto_ltl.report.records import DrawnRun
from pareto_ltl.report.wind import wind_figure
from pareto_ltl.settings import ReportConfig

Files = list[tuple[str, bytes]]
DRAWN_AT_PLAN = ("wind", "front")  # figures that need no record made after the plan
AFTER_PLAN = ("deployments", "forecasts")


def run_figures(cfg: ReportConfig, run: DrawnRun) -> Iterator[tuple[str, bytes]]:
    """Name and content of each file, as soon as it is drawn: ``plan``, ``wind`` and ``front``.

    Each is drawn in ``report.formats``; without ``front`` if the run has none, or an empty one.
    """
    for name in _figure_names(run):
        yield from _figure_files(name, cfg, run)


def _figure_names(run: DrawnRun) -> tuple[str, ...]:
    there = run.front is not None and len(run.front.paths) > 0
    return ("plan", "wind", "front") if there else ("plan", "wind")


def _figure_files(name: str, cfg: ReportConfig, run: DrawnRun, trees: LineCollection | None = None) -> Files:
    with style.report_style():
        if name == "plan":
            figure = plan_figure(cfg, run, trees)
        elif name == "wind":
            assert run.wind is not None
            figure = wind_figure(run.scene, run.wind, run.plan)
        else:
            assert run.front is not None
            figure = front_figure(run.scene, run.forest, run.front, run.plan)
        return [(f"{name}.{kind}", style.figure_bytes(figure, kind, cfg.dpi)) for kind in cfg.formats]


class FiguresOfRecords:
    """The figures of a run whose records come one by one; figures are drawn as early as possible."""

    def __init__(self, cfg: ReportConfig) -> None:
        self._cfg = cfg
        self._records: dict[str, Any] = {}
        self._drawn: dict[str, Files] = {}
        self._trees: LineCollection | None = None

    def add(self, name: str, record: Any) -> None:
        """Add a record; ``name`` is its attribute of :class:`DrawnRun`."""
        self._records[name] = record
        if name not in AFTER_PLAN:
            self._drawn.clear()
        with suppress(Exception):  # an error comes again, and is reported, when all figures are drawn
            if name == "forest":
                with style.report_style():
                    self._trees = tree_layer(self._records["scene"], record)
            if name == "plan":
                run = DrawnRun(**self._records)
                for figure in DRAWN_AT_PLAN:
                    if figure in _figure_names(run):
                        self._drawn[figure] = _figure_files(figure, self._cfg, run)

    def files(self) -> Iterator[tuple[str, bytes]]:
        """What :func:`run_figures` yields for the records added so far."""
        run = DrawnRun(**self._records)
        trees, self._trees = self._trees, None  # they can belong to one figure only
        for name in _figure_names(run):
            yield from self._drawn.get(name) or _figure_files(name, self._cfg, run, trees)
