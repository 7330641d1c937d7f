"""``summary.csv``, ``timings.csv``, ``summary.json`` and ``summary.html``, from the directories of the runs.

``summary.csv`` has only values that the settings of a job determine, so that it is the same file, byte for
byte, also if the sweep was killed and resumed; times and memory are in ``timings.csv``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pareto_ltl.studies.sweeps.manifest import OLDER_SWEEPS, FigureChoice, SweepManifest, read_manifest
from pareto_ltl.studies.sweeps.table import (
    SeedGroup,
    SweepRow,
    column_names,
    is_seed,
    seed_groups,
    status_counts,
    sweep_rows,
)
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.files import write_csv, write_json, write_text
from pareto_ltl.support.messages import shown_text

SUMMARY_SCHEMA = "pareto_ltl.summary/1"
PROMISED = "promise_failure"


@dataclass(frozen=True, slots=True)
class SweepSummary:
    """All runs and groups of a sweep."""

    place: Path
    manifest: SweepManifest
    rows: Sequence[SweepRow]
    groups: Sequence[SeedGroup]

    @property
    def counts(self) -> dict[str, int]:
        """Number of jobs by status."""
        return status_counts(self.rows)

    def line(self) -> str:
        """``18 ok, 2 infeasible of 20 jobs``."""
        counts = ", ".join(f"{number} {status}" for status, number in self.counts.items())
        return f"{counts} of {len(self.rows)} jobs"


def write_summary(
    place: Path,
    key: str | None = None,
    figure: FigureChoice | None = None,
    given_up: Mapping[str, str] | None = None,
) -> SweepSummary:
    """Write and return the summary of the newest sweep of ``place``, or of the one named ``key``.

    Files of the newest sweep are written to ``place``, files of an older one to its folder in ``sweeps/``.
    """
    place = Path(place)
    manifest = read_manifest(place, key)
    if figure is not None:
        manifest = replace(manifest, figure=_merged_choice(manifest.figure, figure))
    rows = sweep_rows(place, manifest, given_up)
    summary = SweepSummary(place, manifest, rows, seed_groups(rows))
    out = place if key is None else place / OLDER_SWEEPS / key
    out.mkdir(parents=True, exist_ok=True)
    _write_files(summary, out)
    return summary


def _merged_choice(noted: FigureChoice, wanted: FigureChoice) -> FigureChoice:
    """``wanted``, with values of ``noted`` where it has none."""
    return FigureChoice(wanted.x or noted.x, wanted.y or noted.y, wanted.by or noted.by)


def _write_files(summary: SweepSummary, out: Path) -> None:
    """Write the four files, and the figure if there is something to draw.

    Raises
    ------
    ConfigError
        If the figure needs a column that does not exist; the files are written in any case.
    """
    swept = list(summary.manifest.swept)
    results = column_names(row.results for row in summary.rows)
    clock = column_names(row.clock for row in summary.rows)
    write_csv(
        out / "summary.csv",
        ["job", *swept, "status", "error", *results],
        (
            [*_first_cells(row, swept), row.state.error, *map(row.results.get, results)]
            for row in summary.rows
        ),
    )
    write_csv(
        out / "timings.csv",
        ["job", *swept, "status", *clock],
        ([*_first_cells(row, swept), *map(row.clock.get, clock)] for row in summary.rows),
    )
    write_json(out / "summary.json", summary_content(summary))
    from pareto_ltl.studies.sweeps import page

    picture, wrong = None, None
    try:
        picture = _draw_figure(summary, out)
    except ConfigError as error:  # the page must not be lost with its figure
        wrong = error
    write_text(out / "summary.html", page.render_page(summary, picture, _way_to_jobs(out, summary.place)))
    if wrong is not None:
        raise wrong


def _first_cells(row: SweepRow, swept: Sequence[str]) -> list[Any]:
    return [row.job, *(row.overrides.get(key) for key in swept), row.state.status]


def _way_to_jobs(out: Path, place: Path) -> str:
    """Relative path from the page to the jobs."""
    return "" if out == place else "../../"


def summary_content(summary: SweepSummary) -> dict[str, Any]:
    """The content of ``summary.json``."""
    return {
        "schema": SUMMARY_SCHEMA,
        "sweep": summary.manifest.key,
        "swept": summary.manifest.swept,
        "fixed": summary.manifest.fixed,
        "counts": summary.counts,
        "groups": [asdict(group) for group in summary.groups],
        "jobs": [
            {
                "job": row.job,
                "overrides": row.overrides,
                "status": row.state.status,
                "error": row.state.error,
                "metrics": row.state.metrics,
            }
            for row in summary.rows
        ],
    }


# --- the figure ------------------------------------------------------------------------------


def _draw_figure(summary: SweepSummary, out: Path) -> str | None:
    """Draw the figure of the sweep; return its SVG, or None if no job has the metrics."""
    figure = chosen_figure(summary)
    if figure is None:
        return None
    from pareto_ltl.report.sweep_figures import draw_sweep_figure as draw

    series = figure_series(summary, figure)
    folder = out / "figures"
    folder.mkdir(exist_ok=True)
    return draw(folder, figure.x or "", figure.y or "", figure.by, series)


def chosen_figure(summary: SweepSummary) -> FigureChoice | None:
    """The figure with its defaults: the first swept setting that is no seed, the promised failure rate.

    The promise is in the winds of planning, which `fidelity` may vary from job to job.
    """
    metrics = column_names(row.state.metrics for row in summary.rows)
    if not metrics:
        return None
    asked, swept = summary.manifest.figure, list(summary.manifest.swept)
    varied = [key for key in swept if not is_seed(key)] or swept
    rates = [name for name in metrics if name.startswith("failure_") and not name.endswith(("_low", "_high"))]
    x = asked.x or (varied[0] if varied else "job")
    y = asked.y or next(
        (name for name in (PROMISED, *rates, "mission_risk", "run_seconds") if name in metrics), metrics[0]
    )
    others = [key for key in varied if key != x]
    by = asked.by or (others[0] if others else None)
    for role, name, known in (("x", x, [*swept, *metrics, "job"]), ("y", y, metrics), ("by", by, swept)):
        if name is not None and name not in known:
            there = ", ".join(known)
            raise ConfigError(f"sweep.{role}={shown_text(name)} is not among the columns; there are {there}")
    return FigureChoice(x, y, by)


def figure_series(summary: SweepSummary, figure: FigureChoice) -> dict[str, list[tuple[str, float]]]:
    """Values (x as text, y) of every job that has both, by the value of ``figure.by``."""
    series: dict[str, list[tuple[str, float]]] = {}
    for row in summary.rows:
        across = row.overrides.get(figure.x or "", row.state.metrics.get(figure.x or ""))
        up = row.state.metrics.get(figure.y or "")
        if up is None or (across is None and figure.x != "job"):
            continue
        name = row.overrides.get(figure.by, "") if figure.by else ""
        series.setdefault(name, []).append((row.job if figure.x == "job" else str(across), float(up)))
    return series


def check_figure(figure: FigureChoice, swept: Sequence[str]) -> None:
    """Raise ConfigError, before a sweep begins, for a figure by a setting that it does not vary."""
    if figure.by is not None and figure.by not in swept:
        raise ConfigError(
            f"sweep.by={figure.by} is not a setting that this sweep varies; "
            f"there are {', '.join(swept) or 'none'}"
        )
