"""``summary.csv``, ``timings.csv``, ``summary.json`` and ``summary.html``, from the directories of the runs.

``summary.csv`` has only values that the settings of a job determine, so that it is the same file, byte for
byte, also if the sweep was killed and resumed; times and memory are in ``timings.csv``. The page loads no
other file, so that it can be opened in a browser, mailed or archived.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from careful_io.files import write_csv, write_json, write_text
from careful_io.messages import shown_text
from careful_io.texts import interval_text, probability_text
from pareto_ltl import Settings
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.studies import sweeps
from pareto_ltl_apps.studies.sweeps import (
    FigureChoice,
    SeedGroup,
    SweepManifest,
    SweepRow,
    column_names,
    is_seed,
)
from pareto_ltl_apps.view.components import page_environment
from pareto_ltl_apps.view.metric_names import is_probability, metric_label

if TYPE_CHECKING:
    from markupsafe import Markup

SUMMARY_SCHEMA = "pareto_ltl.summary/1"
PROMISED = "promise_failure"
SHOWN_METRICS = (  # risks by wind law: fidelity.law may differ from job to job
    "length_m",
    "mission_risk_paper",
    *(f"{risk}_{law}" for law in Settings.LAWS for risk in ("mission_risk", "collision_risk")),
    "front_size",
    "hypervolume",
)


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
        return sweeps.status_counts(self.rows)

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
    manifest = sweeps.read_manifest(place, key)
    if figure is not None:
        noted = manifest.figure
        merged = FigureChoice(figure.x or noted.x, figure.y or noted.y, figure.by or noted.by)
        manifest = replace(manifest, figure=merged)
    rows = sweeps.sweep_rows(place, manifest, given_up)
    summary = SweepSummary(place, manifest, rows, sweeps.seed_groups(rows))
    out = place if key is None else place / sweeps.OLDER_SWEEPS / key
    out.mkdir(parents=True, exist_ok=True)
    _write_files(summary, out)
    return summary


def _write_files(summary: SweepSummary, out: Path) -> None:
    """Write the four files, and the figure if there is something to draw.

    Raises
    ------
    ConfigError
        If the figure needs a column that does not exist; the files are written in any case.
    """
    swept, rows = list(summary.manifest.swept), summary.rows
    results: list[dict[str, Any]] = [{"error": row.state.error, **row.results} for row in rows]
    clocks: list[dict[str, Any]] = [row.clock for row in rows]
    for name, columns in (("summary.csv", results), ("timings.csv", clocks)):
        names = column_names(columns)
        lines = (
            [row.job, *map(row.overrides.get, swept), row.state.status, *map(own.get, names)]
            for row, own in zip(rows, columns, strict=True)
        )
        write_csv(out / name, ["job", *swept, "status", *names], lines)
    write_json(out / "summary.json", summary_content(summary))
    picture, wrong = None, None
    try:
        picture = _draw_figure(summary, out)
    except ConfigError as error:  # the page must not be lost with its figure
        wrong = error
    write_text(out / "summary.html", render_page(summary, picture, "" if out == summary.place else "../../"))
    if wrong is not None:
        raise wrong


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
    from pareto_ltl_apps.view.sweep_figures import draw_sweep_figure

    folder = out / "figures"
    folder.mkdir(exist_ok=True)
    series = figure_series(summary, *figure)
    missing = len(summary.rows) - sum(map(len, series.values()))
    return draw_sweep_figure(folder, *figure, series, missing=missing)


def chosen_figure(summary: SweepSummary) -> tuple[str, str, str | None] | None:
    """x, y and by of the figure; by default the first swept setting that is no seed, and the promised rate.

    The promise is in the winds of planning, which `fidelity` may vary from job to job.
    """
    metrics = column_names(row.state.metrics for row in summary.rows)
    if not metrics:
        return None
    requested, swept = summary.manifest.figure, list(summary.manifest.swept)
    varied = [key for key in swept if not is_seed(key)] or swept
    rates = [name for name in metrics if name.startswith("failure_") and not name.endswith(("_low", "_high"))]
    x = requested.x or (varied[0] if varied else "job")
    y = requested.y or _shared_metric(summary, (PROMISED, *rates, "mission_risk", "run_seconds", *metrics))
    others = [key for key in varied if key != x]
    by = requested.by or (others[0] if others else None)
    for role, name, known in (("x", x, [*swept, *metrics, "job"]), ("y", y, metrics), ("by", by, swept)):
        if name is not None and name not in known:
            there = ", ".join(known)
            raise ConfigError(f"sweep.{role}={shown_text(name)} is not among the columns; there are {there}")
    return x, y, by


def _shared_metric(summary: SweepSummary, names: Sequence[str]) -> str:
    """The first of the metrics ``names`` that most of the jobs with results have, so that all are shown."""
    made = [row.state.metrics for row in summary.rows if row.state.metrics]
    return max(dict.fromkeys(names), key=lambda name: sum(name in metrics for metrics in made))


def figure_series(
    summary: SweepSummary, x: str, y: str, by: str | None
) -> dict[str, list[tuple[str, float]]]:
    """Values (x as text, y) of every job that has both, by the value of the setting ``by``."""
    series: dict[str, list[tuple[str, float]]] = {}
    for row in summary.rows:
        across = row.job if x == "job" else row.overrides.get(x, row.state.metrics.get(x))
        if across is not None and (up := row.state.metrics.get(y)) is not None:
            name = row.overrides.get(by, "") if by else ""
            series.setdefault(name, []).append((str(across), float(up)))
    return series


def check_figure(figure: FigureChoice, swept: Sequence[str]) -> None:
    """Raise ConfigError, before a sweep begins, for a figure by a setting that it does not vary."""
    if figure.by is not None and figure.by not in swept:
        raise ConfigError(
            f"sweep.by={figure.by} is not a setting that this sweep varies; "
            f"there are {', '.join(swept) or 'none'}"
        )


# --- the page --------------------------------------------------------------------------------


def render_page(summary: SweepSummary, picture: str | None, way: str = "") -> str:
    """The page as HTML; ``way`` leads from it to the directories of the jobs."""
    template = files("pareto_ltl_apps.studies").joinpath("summary.html").read_text(encoding="utf-8")
    swept, groups, rows = list(summary.manifest.swept), summary.groups, summary.rows
    results = column_names(row.results for row in rows)
    laws = [name for name in results if name.startswith("failure_") and not name.endswith(("_low", "_high"))]
    return (
        page_environment()
        .overlay(keep_trailing_newline=True)
        .from_string(template)
        .render(
            name=summary.place.resolve().name,
            line=summary.line(),
            fixed=summary.manifest.fixed,
            picture=picture,
            way=way,
            groups=groups,
            rows=rows,
            swept=swept,
            varied=[key for key in swept if not is_seed(key)],
            rates=column_names(group.rates for group in groups),
            medians=[name for name in SHOWN_METRICS if any(name in group.quartiles for group in groups)],
            shown=[*(name for name in (*laws, *SHOWN_METRICS) if name in results), "run_seconds"],
            failed=any(row.state.error for row in rows),
            label=metric_label,
            text=metric_text,
            interval=interval_text,
            broken=_broken_name,
            quote=partial(quote, safe=""),
        )
    )


def _broken_name(name: str) -> Markup:
    """``name`` for the head of a narrow column, which may be broken at its dots and underscores."""
    from markupsafe import Markup, escape

    return Markup(escape(name).replace("_", Markup("_<wbr>")).replace(".", Markup(".<wbr>")))


def metric_text(name: str, value: float) -> str:
    """A metric as text for people; probabilities in per cent."""
    if is_probability(name):
        return probability_text(value)
    return f"{value / 1e3:,.1f}" if name == "length_m" else short_number(value)


def short_number(value: float) -> str:
    """A number with four significant digits, or all digits of an integer."""
    if value == 0 or (float(value).is_integer() and abs(value) < 1e7):
        return f"{value:,.0f}"
    return f"{value:,.1f}" if abs(value) >= 100 else f"{value:.4g}"
