"""``follow.png``: a watched flight on the map, and its promise over time."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from pareto_ltl.inflight.journal import NAME, read_journal
from pareto_ltl.run.results import Results


def draw_watch(results: Results, folder: Path) -> Path | None:
    """Draw the journal of ``folder`` on the map of ``results``; None without a status."""
    from pareto_ltl.report.study_axes import save_figures
    from pareto_ltl.report.watch import watch_figure

    events = list(read_journal(folder / NAME))
    if not any(event["event"] in ("status", "end") for event in events):
        return None
    draw = partial(watch_figure, results.scene, results.decomposition, results.plan, events)
    return save_figures(folder, results.settings.report, {"follow": draw})[0]
