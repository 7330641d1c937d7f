"""``summary.csv``, ``timings.csv``, ``summary.json`` and ``summary.html``, from the directories alone.

``summary.csv`` holds what a job's settings determine, so that it is the same file, byte for byte, however
often the sweep was killed on its way; what depends on the clock stands in ``timings.csv``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pareto_ltl.run.results import write_bytes, write_csv, write_json
from pareto_ltl.studies.sweeps import manifest as manifests
from pareto_ltl.studies.sweeps import table as tables
from pareto_ltl.studies.sweeps.manifest import Figure, Manifest
from pareto_ltl.studies.sweeps.table import Group, Row
from pareto_ltl.support.errors import ConfigError

SCHEMA = "pareto_ltl.cli.summary/1"


@dataclass(frozen=True, slots=True)
class Summary:
    """All that is known of a sweep."""

    place: Path
    manifest: Manifest
    rows: Sequence[Row]
    groups: Sequence[Group]

    @property
    def counts(self) -> dict[str, int]:
        return tables.counts(self.rows)

    def line(self) -> str:
        """``18 ok, 2 infeasible of 20 jobs``."""
        told = ", ".join(f"{number} {status}" for status, number in self.counts.items())
        return f"{told} of {len(self.rows)} jobs"


def gather(place: Path, manifest: Manifest, given_up: Mapping[str, str] | None = None) -> Summary:
    table = tables.rows(place, manifest, given_up)
    return Summary(place, manifest, table, tables.groups(table))


def build(
    place: Path,
    key: str | None = None,
    figure: Figure | None = None,
    given_up: Mapping[str, str] | None = None,
) -> Summary:
    """Write the summary of the newest sweep of ``place``, or of the one named ``key``.

    Files of the newest sweep are written to ``place``, those of an older one to its folder in ``sweeps/``.
    """
    place = Path(place)
    found = manifests.read(place, key)
    if figure is not None:
        found = Manifest(found.points, found.swept, found.fixed, merged(found.figure, figure))
    summary = gather(place, found, given_up)
    out = place if key is None else place / manifests.HISTORY / key
    out.mkdir(parents=True, exist_ok=True)
    write(summary, out)
    return summary


def merged(noted: Figure, wanted: Figure) -> Figure:
    """What is wanted now, and as noted where nothing is said."""
    return Figure(wanted.x or noted.x, wanted.y or noted.y, wanted.by or noted.by)


def write(summary: Summary, out: Path) -> None:
    """The four files, and the figure where there is something to draw.

    Raises
    ------
    ConfigError
        Where the figure is to show what no column holds; the files are there all the same.
    """
    swept = list(summary.manifest.swept)
    results = tables.columns(row.results for row in summary.rows)
    clock = tables.columns(row.clock for row in summary.rows)
    write_csv(
        out / "summary.csv",
        ["job", *swept, "status", "error", *results],
        ([*_head(row, swept), row.state.error, *map(row.results.get, results)] for row in summary.rows),
    )
    write_csv(
        out / "timings.csv",
        ["job", *swept, "status", *clock],
        ([*_head(row, swept), *map(row.clock.get, clock)] for row in summary.rows),
    )
    write_json(out / "summary.json", _content(summary))
    from pareto_ltl.studies.sweeps import page

    picture, wrong = None, None
    try:
        picture = _figure(summary, out)
    except ConfigError as error:  # the page must not be lost with its figure
        wrong = error
    write_bytes(out / "summary.html", page.render(summary, picture, _way(out, summary.place)).encode())
    if wrong is not None:
        raise wrong


def _head(row: Row, swept: Sequence[str]) -> list[Any]:
    return [row.job, *(row.overrides.get(key) for key in swept), row.state.status]


def _way(out: Path, place: Path) -> str:
    """From the page to the jobs."""
    return "" if out == place else "../../"


def _content(summary: Summary) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
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


def _figure(summary: Summary, out: Path) -> str | None:
    """Draw what the sweep asks for; its SVG, or None where no job has what is to be shown."""
    figure = chosen(summary)
    if figure is None:
        return None
    from pareto_ltl.report.sweep_figures import draw_sweep_figure as draw

    series = points(summary, figure)
    folder = out / "figures"
    folder.mkdir(exist_ok=True)
    return draw(folder, figure.x or "", figure.y or "", figure.by, series)


def chosen(summary: Summary) -> Figure | None:
    """The figure with its defaults: the first swept setting that is no seed, the first failure rate."""
    metrics = tables.columns(row.state.metrics for row in summary.rows)
    if not metrics:
        return None
    asked, swept = summary.manifest.figure, list(summary.manifest.swept)
    varied = [key for key in swept if not tables.is_seed(key)] or swept
    rates = [name for name in metrics if name.startswith("failure_") and not name.endswith(("_low", "_high"))]
    x = asked.x or (varied[0] if varied else "job")
    y = asked.y or next(
        iter([*rates, *(m for m in ("mission_risk", "run_seconds") if m in metrics)]), metrics[0]
    )
    others = [key for key in varied if key != x]
    by = asked.by or (others[0] if others else None)
    for role, name, known in (("x", x, [*swept, *metrics, "job"]), ("y", y, metrics), ("by", by, swept)):
        if name is not None and name not in known:
            raise ConfigError(f"sweep.{role}={name} is not among the columns; there are {', '.join(known)}")
    return Figure(x, y, by)


def points(summary: Summary, figure: Figure) -> dict[str, list[tuple[str, float]]]:
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


def check_figure(figure: Figure, swept: Sequence[str]) -> None:
    """Refuse, before a sweep begins, a figure by a setting that it does not vary."""
    if figure.by is not None and figure.by not in swept:
        raise ConfigError(
            f"sweep.by={figure.by} is no setting that this sweep varies; "
            f"there are {', '.join(swept) or 'none'}"
        )
