"""The figure of a plan on its map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from careful_io.texts import distance_text, probability_text
from pareto_ltl import Scene
from pareto_ltl.extend import Decomposition, Forest, Plan
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import map_layers, style
from pareto_ltl_apps.view.land import draw_land
from pareto_ltl_apps.view.map_layers import DRAWN_VERTICES, dense_path, timed_obstacles, visited_outlines
from pareto_ltl_apps.view.records import DrawnRun
from pareto_ltl_apps.view.settings import ReportConfig
from pareto_ltl_apps.view.wind import draw_arrows, draw_wind_arrows, flight_midpoint

TEXT_LINE = 0.15  # height of a line of small text [in]
HINTED = 1.05  # width of letters of a picture, at most, compared with their outlines
LEFT = 0.10  # left edge of headings and legends [in]
WEST = 0.50  # left edge of the map [in]
SCALE_BELOW = 0.84  # below a map for its axis and a colour scale [in]


def plan_figure(cfg: ReportConfig, run: DrawnRun, heading: Sequence[str] | None = None) -> Figure:
    """Map with expected wind, planned path, 95 % ellipses and flights; with ``cfg.trees`` also the trees.

    Without a plan the wind is that at departure, and the heading says why there is no plan; ``heading``
    replaces it. Every probability is given with its wind law.
    """
    keys, flights = _map_keys(cfg, run), _flight_keys(cfg, run)
    legend = TEXT_LINE * (-(-len(keys) // 2) + _key_lines(flights)) + 0.08
    below = legend + (0.42 if run.wind is None else 0.60)  # for the axis, and the scale of the wind arrows
    figure, chart = column_map(run.scene, _heading(run) if heading is None else heading, below)
    _draw_layers(chart, cfg, run)
    if run.wind is not None:
        t, moment = flight_midpoint(run.plan)
        text = f"expected {run.medium.flow} {moment}"
        draw_wind_arrows(chart, run.scene, run.wind, t, text, LEFT + 0.02, below - 0.46)
    for entries, columns in ((flights, 1), (keys, 2)):
        if entries:
            style.legend_at(figure, entries, (LEFT, legend), columns, handlelength=1.6, columnspacing=1.2)
            legend -= TEXT_LINE * _key_lines(entries)
    return figure


def column_map(scene: Scene, heading: Sequence[str], below: float) -> tuple[Figure, Axes]:
    """A figure of the width of a column: a map with ``heading`` above it, and ``below`` [in] below it."""
    width, size = (style.COLUMN_WIDTH - 2 * LEFT) / HINTED, float(style.RC_SETTINGS["font.size"])
    lines = [line for text in heading for line in style.fitted_lines(text, width, size)]
    inner, span = style.COLUMN_WIDTH - WEST - (0.42 if scene.crs else 0.12), np.ptp(scene.bounds, axis=0)
    tall = inner * float(np.clip(span[1] / span[0], 0.35, 1.6))
    figure = style.blank_figure(style.COLUMN_WIDTH, below + tall + 0.26 + TEXT_LINE * len(lines))
    for row, line in enumerate(reversed(lines)):
        style.text_at(figure, LEFT, below + tall + 0.22 + TEXT_LINE * row, line, va="bottom")
    chart = map_layers.map_axes(scene, style.axes_at(figure, WEST, below, inner, tall))
    map_layers.draw_graticule(chart, scene)
    return figure, chart


def draw_map(chart: Axes, cfg: ReportConfig, run: DrawnRun) -> None:
    """The map of a run on axes of the reader, without heading and legend."""
    map_layers.map_axes(run.scene, chart).apply_aspect()
    _draw_layers(chart, cfg, run)
    if run.wind is not None:
        draw_arrows(chart, run.wind, flight_midpoint(run.plan)[0], run.scene.bounds)


def _draw_layers(chart: Axes, cfg: ReportConfig, run: DrawnRun) -> None:
    draw_land(chart, run.scene, taken_points(run.scene, run.plan))
    map_layers.draw_ground(chart, run.scene, _shown_cells(cfg, run))
    map_layers.number_obstacles(chart, run.scene)
    if (forest := _shown_forest(cfg, run)) is not None:
        map_layers.draw_trees(chart, forest)
    if run.plan is not None:
        map_layers.draw_covariances(chart, run.plan.path.x, run.plan.path.cov)
    for flown in sorted(run.deployments.values(), key=lambda flown: -float(flown.x[:, -1].std(axis=0).sum())):
        map_layers.draw_flights(chart, flown, cfg.paths)  # the widest spread first, below the others
    if run.plan is not None:
        map_layers.draw_branches(chart, run.plan)
        map_layers.draw_mean_path(chart, run.plan.path.x)
    map_layers.draw_endpoints(chart, run.scene, run.plan)
    map_layers.name_regions(chart, run.scene, taken_points(run.scene, run.plan))


def _shown_cells(cfg: ReportConfig, run: DrawnRun) -> Decomposition | None:
    """The cells of the search, if its trees are wanted, or if there is no plan to show."""
    return run.decomposition if cfg.trees or run.plan is None else None


def _shown_forest(cfg: ReportConfig, run: DrawnRun) -> Forest | None:
    """The trees, if they are wanted, or if there is no plan to show."""
    return run.forest if cfg.trees or run.plan is None else None


def draw_route(chart: Axes, scene: Scene, plan: Plan) -> None:
    """Ground, the path with its ends, and the names of the regions beside them."""
    draw_land(chart, scene, taken_points(scene, plan))
    map_layers.draw_ground(chart, scene, None)
    map_layers.draw_branches(chart, plan)
    map_layers.draw_mean_path(chart, plan.path.x)
    map_layers.draw_endpoints(chart, scene, plan)
    map_layers.name_regions(chart, scene, taken_points(scene, plan))


def draw_scale(chart: Axes, layer: ScalarMappable, ticks: Mapping[float, str], label: str) -> None:
    """The scale of the colours of ``layer`` with its axis, below a map with ``SCALE_BELOW``."""
    figure = chart.figure
    assert isinstance(figure, Figure)
    box = chart.get_position(original=True)
    width, height = figure.get_size_inches()
    place = style.axes_at(figure, WEST, box.y0 * height - 0.50, box.width * width, 0.08)
    bar = figure.colorbar(layer, cax=place, orientation="horizontal")
    bar.set_ticks(list(ticks), labels=list(ticks.values()))
    bar.minorticks_off()
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)


def taken_points(scene: Scene, plan: Plan | None) -> FloatArray:
    """Points that names of regions should not cover: start, planned path and end, (n, 2) [m]."""
    start = np.asarray(scene.start, float)[None]
    return start if plan is None else np.vstack([start, dense_path(plan.path.x)])


# --- text ---------------------------------------------------------------------------------------


def _heading(run: DrawnRun) -> list[str]:
    """Lines above the map: failures, formula and length of the plan, or why there is no plan.

    A plan without flights has bounds instead of failures.
    """
    if run.plan is None:
        return _failure_heading(run.forest)
    path, models = run.plan.path, run.plan.models
    hours, steps = (path.t[-1] - path.t[0]) / 3600, len(path.u)
    length = f"{distance_text(path.objectives.length)}, {hours:,.1f} h, {steps} steps of {run.plan.dt:,.8g} s"
    if run.plan.alarmed:
        answer = [Plan.NO_PROMISE]
    elif run.plan.promise is not None:
        answer = promise_lines(run.plan, run.medium.flows)
    else:
        answer = [
            f"planned in {models.law} {run.medium.flows}: {models.mission_symbol} ≤ "
            f"{shown_probability(path.objectives.mission_risk)}, "
            f"R ≤ {shown_probability(path.objectives.collision_risk)}"
        ]
    return [*answer, run.plan.formula, length]


def promise_lines(plan: Plan, flows: str) -> list[str]:
    """How many fresh flights of the plan fail, in a sentence; empty without them."""
    if plan.promise is None:
        return []
    sentence = plan.answer(flows)
    return [sentence[0].upper() + sentence[1:]]


def _failure_heading(forest: Forest | None) -> list[str]:
    trees = (
        "" if forest is None else f" ({len(forest.trees)} trees, {sum(map(len, forest.trees)):,} vertices)"
    )
    return [
        "No plan: no path completes the mission"
        if forest is None or not len(forest.accepted)
        else "No plan: no path satisfies the selection rule",
        f"Trees as far as they came{trees}",
    ]


def shown_probability(probability: float) -> str:
    """The text of a probability in figures: with a minus sign, superscript powers, no break before %."""
    text = probability_text(probability)
    digits, _, power = text.removesuffix(" %").partition("e")
    raised = power.translate(style.SUPERSCRIPTS)
    return f"{digits}·10{raised}\N{NO-BREAK SPACE}%" if power else text.replace(" ", "\N{NO-BREAK SPACE}")


def flight_text(run: DrawnRun, law: str, count: int) -> str:
    """Text on the simulated flights under ``law``; at most ``count`` of them are drawn.

    V + R is added for plans that are judged by bounds: it says little of a plan that was flown.
    """
    deployment = run.deployments[law]
    failed, runs = int(deployment.failed.sum()), len(deployment.x)
    text = f"{law} {run.medium.flows}: {failed:,} of {runs:,} flights failed "
    text += f"({shown_probability(failed / runs)}), {min(count, runs)} drawn"
    if gone := int(deployment.off_map.sum()):
        text += f"\n{shown_probability(gone / runs)} left the map"
        text += ", which is a failure" if deployment.walled else ", which is no failure"
    if law not in run.forecasts or (run.plan is not None and run.plan.promise is not None):
        return text
    bound = run.forecasts[law].mission_risk + run.forecasts[law].collision_risk
    return f"{text}\nbound V + R of the controls {shown_probability(bound)}"


# --- legends ------------------------------------------------------------------------------------


def _flight_keys(cfg: ReportConfig, run: DrawnRun) -> list[Artist]:
    """One entry for each wind law, and one for the flights that failed."""
    keys: list[Artist] = [
        Line2D([], [], color=style.law_colour(law), ls=style.law_dashes(law), lw=1.0,
               label=flight_text(run, law, cfg.paths))
        for law in run.deployments
    ]  # fmt: skip
    if keys:
        failed = "flights that failed, with their ends"
        keys.append(Line2D([], [], color=style.FAILED, marker="x", ms=3.2, mew=0.7, lw=0.8, label=failed))
    return keys


def _branch_keys(plan: Plan) -> list[Artist]:
    """Entries of the legend: the fix, each of its branches with its share, those after a second fix."""
    if (tree := plan.branching) is None:
        return []
    mark: dict[str, Any] = {"mec": style.BLACK, "mew": 0.6, "ms": 4.0}
    keys: list[Artist] = [Line2D([], [], color=style.ORANGE, marker="D", ls="", label="position fix", **mark)]
    for branch in tree.branches:
        text = f"branch {branch.name}, {100 * branch.share:.0f} %"
        keys.append(Line2D([], [], color=map_layers.branch_colour(branch.name), lw=1.1, label=text))
    if tree.fixes > 1:
        keys.append(Line2D([], [], color=style.STONE, lw=1.1, ls=(0, (1, 1.2)), label="after a second fix"))
    return keys


def _map_keys(cfg: ReportConfig, run: DrawnRun) -> list[Artist]:
    """Entries of the legend for everything else on the map."""
    start = Line2D([], [], label="start", **map_layers.START_LOOK)
    keys: list[Artist] = [start]
    if run.plan is not None:
        law = f"{run.plan.models.law} {run.medium.flows}"
        keys = [
            Line2D([], [], color=style.BLACK, lw=1.3, label="planned path (mean)"),
            Patch(fc=style.INK + "10", ec=style.INK, lw=0.5, label=f"95 % of positions, {law}"),
            start,
            Line2D([], [], label="end", **map_layers.END_LOOK),
        ]
        keys += _branch_keys(run.plan)
    keys += ground_keys(run.scene)
    if (forest := _shown_forest(cfg, run)) is not None:
        total = sum(map(len, forest.trees))
        text = (
            f"{total:,} vertices" if total <= DRAWN_VERTICES else f"{DRAWN_VERTICES:,} of {total:,} vertices"
        )
        keys.append(Line2D([], [], color=style.STONE, lw=0.6, alpha=0.8, label=text))
    if _shown_cells(cfg, run) is not None:
        keys.append(Line2D([], [], color=style.MIST, lw=0.7, ls=":", label="cells"))
    return keys


def ground_keys(scene: Scene) -> list[Artist]:
    """Entries for regions, obstacles and landmarks; also for those that are active for a limited time."""
    timed = any(name not in scene.forbidden for name in scene.windows)
    entries = (
        (visited_outlines(scene), map_layers.REGION_LOOK, "region, with times" if timed else "region"),
        (scene.obstacles, map_layers.OBSTACLE_LOOK, "obstacle"),
        (timed_obstacles(scene), map_layers.TIMED_LOOK, "obstacle for a time"),
        (scene.landmarks, map_layers.LANDMARK_LOOK, "landmark"),
    )
    return [Patch(**look, label=label) for outlines, look, label in entries if outlines]


def _key_lines(keys: Sequence[Artist]) -> int:
    """Lines of text of a legend of one column."""
    return sum(str(key.get_label()).count("\n") + 1 for key in keys)
