"""``summary.html``: a page that loads no other file, for a browser, a mail or an archive."""

from __future__ import annotations

from functools import partial
from importlib.resources import files
from typing import TYPE_CHECKING
from urllib.parse import quote

from pareto_ltl.report.metric_names import is_probability, metric_label
from pareto_ltl.settings.fidelity import LAWS
from pareto_ltl.studies.sweeps.table import column_names, is_seed
from pareto_ltl.support.display import interval_text, probability_text

if TYPE_CHECKING:
    from markupsafe import Markup

    from pareto_ltl.studies.sweeps.summary import SweepSummary

SHOWN_METRICS = (  # risks by wind law: fidelity.law may differ from job to job
    "length_m",
    "mission_risk_paper",
    *(f"{risk}_{law}" for law in LAWS for risk in ("mission_risk", "collision_risk")),
    "front_size",
    "hypervolume",
)


def render_page(summary: SweepSummary, picture: str | None, way: str = "") -> str:
    """The page as HTML; ``way`` leads from it to the directories of the jobs."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    template = files("pareto_ltl.studies.sweeps").joinpath("summary.html").read_text(encoding="utf-8")
    swept, groups, rows = list(summary.manifest.swept), summary.groups, summary.rows
    results = column_names(row.results for row in rows)
    laws = [name for name in results if name.startswith("failure_") and not name.endswith(("_low", "_high"))]
    return environment.from_string(template).render(
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
