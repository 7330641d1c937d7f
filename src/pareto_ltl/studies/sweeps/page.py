"""``summary.html``: a page that loads no other file, for a browser, a mail or an archive."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING
from urllib.parse import quote

from pareto_ltl.report.metric_names import is_probability, metric_label
from pareto_ltl.settings import LAWS
from pareto_ltl.studies.sweeps.table import column_names, is_seed
from pareto_ltl.support.display import interval_text, probability_text

if TYPE_CHECKING:
    from pareto_ltl.studies.sweeps.summary import SweepSummary
    from pareto_ltl.studies.sweeps.table import SeedGroup, SweepRow

SHOWN_METRICS = (  # risks by wind law: that of fidelity.law may differ from job to job
    "length_m",
    "mission_risk_paper",
    *(f"{risk}_{law}" for law in LAWS for risk in ("mission_risk", "collision_risk")),
    "front_size",
    "hypervolume",
)
LINE_BREAK = "<wbr>"  # where the head of a narrow column may be broken

PAGE_STYLE = """
:root { --ink: #222; --stone: #6b6b6b; --line: #e2e2e2; --ground: #fafafa }
body { font: 13px/1.4 system-ui, "DejaVu Sans", sans-serif; color: var(--ink);
  margin: 2rem auto; max-width: 80rem; padding: 0 1.2rem }
h1 { font-size: 1.5rem; margin: 0 0 .2rem } h2 { font-size: 1.1rem; margin: 2rem 0 .5rem }
p { margin: .2rem 0 .6rem; color: var(--stone) } code { font-size: .92em; color: var(--ink) }
code + code { margin-left: .5em }
.wide { overflow-x: auto } table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { padding: .28rem .6rem; text-align: right; white-space: nowrap;
  border-bottom: 1px solid var(--line); vertical-align: top }
th { font-weight: 600; border-bottom: 1.5px solid var(--ink); background: white; vertical-align: bottom;
  white-space: normal; line-height: 1.2 }
tbody tr:hover { background: var(--ground) } .word { text-align: left }
td.error { white-space: normal; min-width: 18rem; color: var(--stone); text-align: left }
td small { color: var(--stone); display: block } figure { margin: 1rem 0 0 }
figure svg { width: 46rem; max-width: 100%; height: auto }
.sortable th { cursor: pointer } .sortable th:hover { text-decoration: underline }
.status::before { content: ""; display: inline-block; width: .6em; height: .6em; border-radius: 50%;
  margin-right: .45em; background: #b8b8b8 }
.ok::before { background: #009e73 } .infeasible::before { background: #e69f00 }
.failed::before { background: #d55e00 } .running::before { background: #56b4e9 }
a { color: #0072b2; text-decoration: none }
"""
SORT_SCRIPT = """
for (const head of document.querySelectorAll(".sortable th")) head.onclick = () => {
  const body = head.closest("table").tBodies[0], i = head.cellIndex, down = head.dataset.down !== "1";
  head.dataset.down = down ? "1" : "0";
  const value = row => row.cells[i].dataset.value ?? row.cells[i].textContent;
  const rows = [...body.rows].sort((a, b) => {
    const [p, q] = [value(a), value(b)], [x, y] = [parseFloat(p), parseFloat(q)];
    return (isNaN(x) || isNaN(y) ? p.localeCompare(q) : x - y) * (down ? 1 : -1);
  });
  body.append(...rows);
};
"""


def render_page(summary: SweepSummary, picture: str | None, way: str = "") -> str:
    """The page as HTML; ``way`` leads from it to the directories of the jobs."""
    name = summary.place.resolve().name
    fixed = " ".join(f"<code>{escape(word)}</code>" for word in summary.manifest.fixed)
    parts = [
        f"<!doctype html><html lang=en><head><meta charset=utf-8><title>{escape(name)}: sweep</title>"
        "<meta name=viewport content='width=device-width'>"
        f"<style>{PAGE_STYLE}</style></head><body>",
        f"<h1>{escape(name)}</h1><p>{escape(summary.line())}{', with ' + fixed if fixed else ''}</p>",
        f"<figure>{picture}</figure>" if picture else "",
        _groups_section(summary),
        _jobs_section(summary, way),
        f"<script>{SORT_SCRIPT}</script></body></html>\n",
    ]
    return "\n".join(part for part in parts if part)


def _groups_section(summary: SweepSummary) -> str:
    keys = [key for key in summary.manifest.swept if not is_seed(key)]
    quartiles = [name for name in SHOWN_METRICS if any(name in group.quartiles for group in summary.groups)]
    rates = column_names(group.rates for group in summary.groups)
    head = [*keys, "jobs", *rates, *quartiles]
    lines = (
        [*_setting_cells(group, keys), *_measured_cells(group, rates, quartiles)] for group in summary.groups
    )
    return (
        "<h2>Over seeds</h2><p>Rates: pooled over all flights, with exact 95 % intervals (Clopper-Pearson); "
        "other figures: medians with quartiles.</p>" + _html_table(head, lines, words=len(keys))
    )


def _setting_cells(group: SeedGroup, keys: Sequence[str]) -> list[str]:
    return [_word_cell(group.overrides.get(key, "")) for key in keys]


def _measured_cells(group: SeedGroup, rates: Sequence[str], quartiles: Sequence[str]) -> list[str]:
    told = ", ".join(f"{number} {status}" for status, number in group.counts.items())
    cells = [f"<td>{told}</td>"]
    for name in rates:
        rate = group.rates.get(name)
        cells.append(
            "<td></td>"
            if rate is None
            else _number_cell(
                rate["rate"],
                metric_text(name, rate["rate"])
                + f" <small>{escape(interval_text(rate['low'], rate['high']))}</small>",
            )
        )
    for name in quartiles:
        spread = group.quartiles.get(name)
        cells.append(
            "<td></td>"
            if spread is None
            else _number_cell(spread[1], _median_text(name, spread, single=sum(group.counts.values()) == 1))
        )
    return cells


def _median_text(name: str, quartiles: Sequence[float], *, single: bool) -> str:
    """A median, and its quartiles where there is more than one job."""
    low, middle, high = (metric_text(name, value) for value in quartiles)
    return middle if single else f"{middle} <small>{low} to {high}</small>"


def _jobs_section(summary: SweepSummary, way: str) -> str:
    keys = list(summary.manifest.swept)
    results = column_names(row.results for row in summary.rows)
    laws = [name for name in results if name.startswith("failure_") and not name.endswith(("_low", "_high"))]
    shown = [name for name in (*laws, *SHOWN_METRICS) if name in results]
    failed = any(row.state.error for row in summary.rows)
    head = ["job", *keys, "status", *shown, "run_seconds", *(["error"] if failed else [])]
    lines = (_job_cells(row, keys, shown, failed, way) for row in summary.rows)
    words = 2 + len(keys)
    return f"<h2>Jobs</h2>{_html_table(head, lines, words=words, sortable=True)}"


def _job_cells(row: SweepRow, keys: Sequence[str], shown: Sequence[str], failed: bool, way: str) -> list[str]:
    cells = [f"<td class=word><a href='{way}{quote(row.job, safe='')}/'>{escape(row.job[:8])}</a></td>"]
    cells += [_word_cell(row.overrides.get(key, "")) for key in keys]
    cells.append(f"<td class=word><span class='status {row.state.status}'>{row.state.status}</span></td>")
    for name in (*shown, "run_seconds"):
        value = row.state.metrics.get(name)
        cells.append("<td></td>" if value is None else _number_cell(value, metric_text(name, value)))
    if failed:
        cells.append(f"<td class=error>{escape(row.state.error or '')}</td>")
    return cells


def _html_table(
    head: Sequence[str], lines: Iterable[Sequence[str]], words: int, sortable: bool = False
) -> str:
    cells = "".join(
        f"<th{' class=word' if i < words else ''} title='{escape(name)}'>{_broken_name(metric_label(name))}"
        "</th>"
        for i, name in enumerate(head)
    )
    body = "\n".join(f"<tr>{''.join(line)}</tr>" for line in lines)
    kind = " class=sortable" if sortable else ""
    return (
        f"<div class=wide><table{kind}><thead><tr>{cells}</tr></thead><tbody>\n{body}\n</tbody></table></div>"
    )


def _broken_name(name: str) -> str:
    return escape(name).replace("_", f"_{LINE_BREAK}").replace(".", f".{LINE_BREAK}")


def _word_cell(text: str) -> str:
    return f"<td class=word>{escape(text)}</td>"


def _number_cell(value: float, shown: str) -> str:
    return f"<td data-value={value!r}>{shown}</td>"


def metric_text(name: str, value: float) -> str:
    """A metric as text for people; probabilities in per cent."""
    if is_probability(name):
        return escape(probability_text(value))
    return f"{value / 1e3:,.1f}" if name == "length_m" else short_number(value)


def short_number(value: float) -> str:
    """A number with four significant digits, or all digits of an integer."""
    if value == 0 or (float(value).is_integer() and abs(value) < 1e7):
        return f"{value:,.0f}"
    return f"{value:,.1f}" if abs(value) >= 100 else f"{value:.4g}"
