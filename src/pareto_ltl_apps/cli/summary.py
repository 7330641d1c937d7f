"""What is printed at the end of a run or a sweep: failure rate of the plan, bounds, times, tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from careful_io.texts import probability_text, rate_text
from flight_quantities.medium import AIR, Medium
from pareto_ltl import Settings
from pareto_ltl.support.display import allowed_text, answer_text, branched_text, winds_text
from pareto_ltl_apps.cli.output import Answer, shown_table
from pareto_ltl_apps.exports.settings import ExportsConfig
from pareto_ltl_apps.view import PAGE_FILE
from pareto_ltl_apps.view.settings import ReportConfig

if TYPE_CHECKING:
    from rich.table import Table

    from pareto_ltl import Run, Scene
    from pareto_ltl.extend import Plan
    from pareto_ltl_apps.studies.sweep_summary import SweepSummary

MAX_WARNINGS = 5  # warnings that are printed, at most
WIDTH = 78  # columns of a terminal that tables fit into, without the edges of a table
GAP = 2  # columns between two columns of a table of a study
FAILED = "failed"  # the column that a table has before others


def run_answer(
    run: Run,
    directory: Path,
    metrics: Mapping[str, float],
    warnings: Sequence[str],
    *,
    verbose: bool = False,
    drawn: bool = True,
) -> Answer:
    """The most important numbers of a run, its warnings, its files and its directory.

    ``verbose`` adds the bounds, the simulated flights under every law and the time of each stage; ``drawn``
    is whether figures and page are written, or follow.
    """
    from rich.text import Text

    settings, plan, scene = run.settings, run.get("plan"), run.get("scene")
    covers = {key: text for key in ("covered", "not_covered") if (text := getattr(plan, key, ""))}
    document = {
        "directory": directory, "name": settings.name, "law": settings.fidelity.law, "metrics": metrics,
        "warnings": warnings, **covers,
    }  # fmt: skip
    flow = settings.medium.flow
    gap = "" if plan is None else plan.level_gap
    *rows, last = summary_rows(
        metrics, settings.fidelity.law, settings.medium, verbose=verbose,
        fails=f"fails in a {flow} of another level" if gap else "fails",
    )  # fmt: skip
    answer = answer_line(metrics, settings.fidelity.law, settings.medium, gap)
    lines: list[object] = [
        *([Text(answer, style="bold")] if answer else []),
        _summary_table(settings.name, [*rows, *limit_rows(plan, settings.medium, scene), last]),
        *([f"No promise: {gap}; the rates count flights in the {flow} used."] if gap else []),
        *warning_paragraphs(warnings, directory),
        *([] if plan is None else plan_paragraphs(run, directory, plan)),
        *(f"{key.replace('_', ' ').capitalize()}: {text}" for key, text in covers.items()),
        *([] if plan is None else [files_line(settings, drawn=drawn)]),
    ]
    if (tables := directory / "tables.md").is_file():  # of an evaluation
        lines += shown_markdown(tables.read_text(encoding="utf-8"), str(tables))
    shown = [Text(line) if isinstance(line, str) else line for line in lines]  # wrapped between words
    return Answer(document, [*shown, f"results in {directory}"], [directory])


def files_line(settings: Settings, *, drawn: bool) -> str:
    """What the directory of a plan has; ``drawn`` is whether figures and page are there already."""
    stages, report = settings.pipelines.stages, settings[ReportConfig]
    exports = "export" in stages and settings[ExportsConfig].files
    names = "Written: plan, front, trees, wind and flights" + ", and files for maps and autopilots" * exports
    figures = ["figures"] * (report.figures and "report" in stages)
    figures += [PAGE_FILE] * (report.page and "page" in stages)
    if not figures:
        return f"{names}; `pareto-ltl show DIR` writes a page."
    return f"{names}; {' and '.join(figures)}{'' if drawn else ' follow'}."


def _summary_table(title: str, rows: Iterable[tuple[str, str]]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE_HEAD, show_header=False)
    table.add_column(style="bold")
    table.add_column(justify="right")
    for row in rows:
        table.add_row(*row)
    return table


def warning_paragraphs(warnings: Sequence[str], directory: Path) -> Iterator[str]:
    """The first ``warnings``, and how many more the log in ``directory`` has."""
    for warning in warnings[:MAX_WARNINGS]:
        yield f"Warning: {warning}"
    if len(warnings) > MAX_WARNINGS:
        yield f"Warning: {len(warnings) - MAX_WARNINGS} more in {directory / 'run.log'}"


def plan_paragraphs(run: Run, directory: Path, plan: Plan) -> Iterator[str]:
    """Which path of the front is the plan, where flights judge; what detours through landmarks would save."""
    from pareto_ltl.planning.selection_rules import selection_rule

    cfg, scene, front = run.settings.selection, run.get("scene"), run.get("front")
    if not plan.epsilon_kept:
        yield "The plan is the path nearest to planner.epsilon, which no path keeps; the front has no other."
    elif run.settings.fidelity.judge == "flights" and (words := selection_rule(cfg).in_words(cfg)):
        yield f"The plan is {words}; `pareto-ltl choose {directory}` takes another point of the front."
    if plan.remedies:
        yield f"What helps, {plan.what_helps}."
    if scene is None or front is None:
        return
    from pareto_ltl_apps.view.trade import trade_lines

    yield from (f"{line}." for line in trade_lines(scene, front, plan))
    if scene.landmarks:
        from pareto_ltl_apps.view.limits import detour_lines

        yield from (f"Detour: {line}." for line in detour_lines(scene, front, plan))


def limit_rows(
    plan: Plan | None, medium: Medium = AIR, scene: Scene | None = None
) -> Iterator[tuple[str, str]]:
    """The segment of ``plan`` that is closest to its chance constraint, if any; ``scene`` has names."""
    if plan is None:
        return
    if plan.worst is not None and not plan.epsilon_kept:
        probability, barrier = plan.worst.probability, plan.worst.nearest
    elif plan.limits is not None:
        k = int(plan.limits.probability.argmax())
        probability, barrier = float(plan.limits.probability[k]), plan.limits.nearest[k]
    else:
        return
    title = barrier if scene is None else scene.barrier_title(barrier)
    yield (
        f"likeliest collision, {plan.models.law} {medium.flows}",
        f"{allowed_text(probability, plan.epsilon)}, {title}",
    )


def summary_rows(
    metrics: Mapping[str, float], law: str, medium: Medium = AIR, *, verbose: bool = True,
    fails: str = "fails",
) -> Iterator[tuple[str, str]]:  # fmt: skip
    """Names and values of the metrics that exist; ``law`` is the wind law of the plan, ``fails`` its rate.

    Where flights judge, the failure is said before (:func:`answer_line`), and only ``verbose`` has its row,
    the bounds and other simulated flights; only it has the times of stages.
    """
    flows = medium.flows
    if {"promise_failure", "length_m"} <= set(metrics) and not verbose:  # a plan, not a study of plans
        yield from _cost_rows(metrics, medium)
        if "branches" in metrics:
            yield "branches", f"{metrics['branches']:.0f}"
        yield "in all", f"{metrics['run_seconds']:.2f} s"
        return
    if "length_m" in metrics:
        yield from _cost_rows(metrics, medium)
        yield from _bound_rows(metrics, f"{law} {flows}", f"independent {flows}", fails)
    elif "wind_speed_m_s" in metrics:
        yield from _wind_rows(metrics)
    for key in metrics:
        if key.startswith("mission_risk_") and f"collision_risk_{key[13:]}" in metrics:
            bound = metrics[key] + metrics[f"collision_risk_{key[13:]}"]
            yield f"V + R of the controls, {key[13:]} {flows}", probability_text(bound)
        if key.startswith("failure_") and not key.endswith(("_low", "_high")):
            flown = key.removeprefix("failure_")
            rate = rate_text(metrics[key], metrics[f"{key}_low"], metrics[f"{key}_high"])
            yield f"failed of {metrics[f'runs_{flown}']:,.0f} simulated, {flown} {flows}", rate
            if (gone := f"off_map_{flown}") in metrics:
                yield f"left the map, {flown} {flows}", probability_text(metrics[gone])
    if "nodes" in metrics:
        yield "tree vertices", f"{metrics['nodes']:,.0f} ({metrics['nodes_per_second']:,.0f} a second)"
    for key, spent in metrics.items():
        if key.startswith("seconds_") and verbose:
            yield f"  {key.removeprefix('seconds_')}", f"{spent:.2f} s"
    yield "in all", f"{metrics['run_seconds']:.2f} s"


def _cost_rows(metrics: Mapping[str, float], medium: Medium) -> Iterator[tuple[str, str]]:
    from pareto_ltl.extend import known_costs

    yield "length", f"{metrics['length_m'] / 1e3:,.1f} km"
    steps = f" in steps of {metrics['dt_s']:,.6g} s" if "dt_s" in metrics else ""
    yield medium.time, f"{metrics['duration_s'] / 3600:,.2f} h{steps}"
    for cost in known_costs():
        if cost.name != "length" and cost.column in metrics:
            share = (
                f", {100 * metrics[of]:.0f} % of the capacity"
                if (of := f"{cost.name}_share") in metrics
                else ""
            )
            yield cost.name, cost.text(metrics[cost.column]) + share


def _bound_rows(metrics: Mapping[str, float], law: str, paper: str, fails: str) -> Iterator[tuple[str, str]]:
    """Bounds in the ``law`` of the plan and in the ``paper``'s, each a law with its medium."""
    if "promise_failure" in metrics:
        yield _promise_row(metrics, f"{fails}, {law}")
        yield f"bound V + R, {law}", probability_text(metrics["promise_bound"])
    yield f"mission risk f_o (paper), {paper}", probability_text(metrics["mission_risk_paper"])
    yield f"mission risk V, {law}", probability_text(metrics["mission_risk_ordered"])
    yield f"collision risk R, {law}", probability_text(metrics["collision_risk"])


def _wind_rows(metrics: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """The fitted wind, where it is what the run was for."""
    yield "expected wind speed, mean of the map", f"{metrics['wind_speed_m_s']:.1f} m/s"
    yield "standard deviation of a component", f"{metrics['wind_sd_m_s']:.1f} m/s"
    if not math.isnan(covered := metrics.get("gp_coverage_90", math.nan)):
        yield "held-out readings in 90 % intervals", f"{100 * covered:.0f} %"
        yield "their residuals (1: as predicted)", f"{metrics['gp_z_sd']:.2f} standard deviations"
    if "wind_modes" in metrics:
        share = 100 * metrics["wind_energy"]
        yield "modes of the error", f"{metrics['wind_modes']:.0f}, {share:.0f} % of its variance"


def _promise_row(metrics: Mapping[str, float], name: str) -> tuple[str, str]:
    rate = metrics["promise_failure"]
    kind = "weighted" if metrics.get("promise_weighted") else "fresh"
    named = f"{name}, {metrics['promise_runs']:,.0f} {kind} flights"
    shown = rate_text(rate, metrics["promise_low"], metrics["promise_high"])
    if rate >= (floor := metrics.get("promise_floor", 0.0)):
        return named, shown
    return named, f"below {probability_text(floor)}: the law's data cannot say less; simulated: {shown}"


def answer_line(metrics: Mapping[str, float], law: str, medium: Medium = AIR, gap: str = "") -> str:
    """How many flights of the plan fail, the first line of a summary; empty where bounds judge."""
    if not {"promise_failure", "length_m"} <= set(metrics):
        return ""
    of, floor = "branches" if "branches" in metrics else "promise", metrics.get("promise_floor", 0.0)
    rate, low, high = (metrics[f"{of}_{end}"] for end in ("failure", "low", "high"))
    sentence = answer_text(rate, low, high, winds_text(medium.flows, law, gap), floor)
    if of == "branches":
        sentence = branched_text(sentence, metrics["promise_failure"], floor)
    return f"{sentence[0].upper()}{sentence[1:]}."


# --- tables of studies -------------------------------------------------------------------------


def shown_markdown(text: str, source: str) -> Iterator[object]:
    """The parts of ``text``; of a table that is too wide, the columns that fit, and a line on the others."""
    from rich.markdown import Markdown

    for is_table, block in groupby(text.splitlines(), key=lambda line: line.startswith("|")):
        if not is_table:
            yield Markdown("\n".join(block))
            continue
        header, _, *rows = ([cell.strip() for cell in line.strip("|").split(" | ")] for line in block)
        fitting = fitting_columns([header, *rows])
        names, *cells = ([row[k] for k in fitting] for row in (header, *rows))
        yield shown_table(names, cells, left=names, gap=GAP)
        if left := [name for k, name in enumerate(header) if k not in fitting]:
            yield f"{len(left)} more column{'s' * (len(left) > 1)} in {source}: {', '.join(left)}"


def fitting_columns(rows: Sequence[Sequence[str]], width: int = WIDTH) -> list[int]:
    """The columns that fit into ``width``: the first one, failures, then the others from the left."""
    used, fitting = 0, list[int]()
    for k in sorted(range(len(rows[0])), key=lambda k: (k > 0, rows[0][k] != FAILED)):
        used += max(len(row[k]) for row in rows) + GAP
        if used > width and fitting:
            break
        fitting.append(k)
    return sorted(fitting)


# --- sweeps ---------------------------------------------------------------------------------


def sweep_answer(found: SweepSummary, page: Path) -> Answer:
    """The answer of a sweep whose summary is the file ``page``."""
    from pareto_ltl_apps.studies.sweep_summary import summary_content

    return Answer(summary_content(found), [found.line(), f"summary in {page}"], [page])
