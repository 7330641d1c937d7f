"""The figure of a plan on its map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pareto_ltl.planning.records import NO_PROMISE, Forest, Plan, Promise
from pareto_ltl.report import style
from pareto_ltl.report.map_labels import dense_path
from pareto_ltl.report.map_layers import (
    DRAWN_VERTICES,
    LANDMARK_LOOK,
    OBSTACLE_LOOK,
    REGION_LOOK,
    TIMED_LOOK,
    MapAxes,
    draw_covariances,
    draw_endpoints,
    draw_flights,
    draw_graticule,
    draw_ground,
    draw_mean_path,
    map_axes,
    name_regions,
    number_obstacles,
    tree_layer,
)
from pareto_ltl.report.records import DrawnRun
from pareto_ltl.report.timed_places import timed_obstacles, visited_outlines
from pareto_ltl.report.wind import draw_wind_arrows, flight_midpoint
from pareto_ltl.settings import ReportConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import distance_text, probability_text
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

TEXT_LINE = 0.15  # height of a line of small text [in]
HINTED = 1.05  # width of letters of a picture, at most, compared with their outlines
LEFT = 0.10  # left edge of headings and legends [in]
WEST = 0.50  # left edge of the map [in]


@dataclass(frozen=True, slots=True)
class _Sheet:
    """Heights of the parts of the figure, from below [in]."""

    keys: list[Artist]
    flights: list[Artist]
    title: list[str]
    inner: float
    height: float
    windy: bool

    @property
    def legend_top(self) -> float:
        return TEXT_LINE * (-(-len(self.keys) // 2) + _key_lines(self.flights)) + 0.08

    @property
    def bottom(self) -> float:
        """Lower edge of the map; the scale of the wind arrows and the name of the axis are below it."""
        return self.legend_top + (0.60 if self.windy else 0.42)

    @property
    def total(self) -> float:
        return self.bottom + self.height + 0.26 + TEXT_LINE * len(self.title)


def plan_figure(cfg: ReportConfig, run: DrawnRun, heading: Sequence[str] | None = None) -> Figure:
    """Map with expected wind, planned path, 95 % ellipses and flights; with ``cfg.trees`` also the trees.

    Without a plan the wind is that at departure, and the heading says why there is no plan; ``heading``
    replaces it. Every probability is given with its wind law.
    """
    sheet = _sheet(cfg, run, _heading(run) if heading is None else fitted_heading(heading))
    figure = style.blank_figure(style.COLUMN_WIDTH, sheet.total)
    chart = map_axes(run.scene, style.axes_at(figure, WEST, sheet.bottom, sheet.inner, sheet.height))
    draw_graticule(chart, run.scene)
    _draw_layers(chart, cfg, run)
    if run.wind is not None:
        t, moment = flight_midpoint(run.plan)
        text = f"expected {run.medium.flow} {moment}"
        draw_wind_arrows(chart, run.scene, run.wind, t, text, LEFT + 0.02, sheet.bottom - 0.46)
    below = _add_legend(figure, sheet.flights, sheet.legend_top, columns=1)
    _add_legend(figure, sheet.keys, below, columns=2)
    for row, line in enumerate(reversed(sheet.title)):
        place = sheet.bottom + sheet.height + 0.22 + TEXT_LINE * row
        style.text_at(figure, LEFT, place, line, va="bottom")
    return figure


def _sheet(cfg: ReportConfig, run: DrawnRun, title: list[str]) -> _Sheet:
    inner, height = map_size(run.scene)
    return _Sheet(_map_keys(cfg, run), _flight_keys(cfg, run), title, inner, height, run.wind is not None)


def map_size(scene: Scene) -> tuple[float, float]:
    """Width and height [in] of a map in a column."""
    inner = style.COLUMN_WIDTH - WEST - (0.42 if scene.crs else 0.12)
    span = np.ptp(scene.bounds, axis=0)
    return inner, inner * float(np.clip(span[1] / span[0], 0.35, 1.6))


def _draw_layers(chart: MapAxes, cfg: ReportConfig, run: DrawnRun) -> None:
    draw_ground(chart, run.scene, run.decomposition)
    number_obstacles(chart, run.scene, "white")
    if (forest := _shown_forest(cfg, run)) is not None:
        chart.ax.add_collection(tree_layer(run.scene, forest), autolim=False)
    if run.plan is not None:
        draw_covariances(chart, run.plan.path.x, run.plan.path.cov)
    for deployment in _widest_first(run):
        draw_flights(chart, deployment, cfg.paths)
    if run.plan is not None:
        draw_mean_path(chart, run.plan.path.x)
    draw_endpoints(chart, run.scene, run.plan)
    name_regions(chart, run.scene, run.decomposition, taken_points(run.scene, run.plan))


def _shown_forest(cfg: ReportConfig, run: DrawnRun) -> Forest | None:
    """The trees, if they are wanted, or if there is no plan to show."""
    return run.forest if cfg.trees or run.plan is None else None


def _widest_first(run: DrawnRun) -> list[Deployment]:
    """Simulated flights, the law with the widest spread first, so that it does not cover the others."""
    return sorted(run.deployments.values(), key=lambda d: -float(d.x[:, -1].std(axis=0).sum()))


def draw_route(chart: MapAxes, scene: Scene, decomposition: Decomposition | None, plan: Plan) -> None:
    """Ground, graticule, the path with its ends, and the names of the regions beside them."""
    draw_graticule(chart, scene)
    draw_ground(chart, scene, None)
    draw_mean_path(chart, plan.path.x)
    draw_endpoints(chart, scene, plan)
    name_regions(chart, scene, decomposition, taken_points(scene, plan))


def draw_scale(
    figure: Figure, layer: ScalarMappable, at: tuple[float, float, float], ticks: Mapping[float, str],
    label: str,
) -> None:  # fmt: skip
    """The scale of the colours of ``layer`` with its axis below, at ``at`` (left, bottom, width) [in]."""
    left, bottom, width = at
    bar = figure.colorbar(
        layer, cax=style.axes_at(figure, left, bottom, width, 0.08), orientation="horizontal"
    )
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
    """Lines above the map: formula, length and risks of the plan, or why there is no plan."""
    if run.plan is None:
        return _failure_heading(run.forest)
    path, models = run.plan.path, run.plan.models
    hours, steps = (path.t[-1] - path.t[0]) / 3600, len(path.u)
    lines = [
        f"{distance_text(path.objectives.length)}, {hours:,.1f} h, {steps} steps of {run.plan.dt:,.8g} s",
        NO_PROMISE
        if run.plan.alarmed
        else f"planned in {models.law} {run.medium.flows}: {models.mission_symbol} ≤ "
        f"{shown_probability(path.objectives.mission_risk)}, "
        f"R ≤ {shown_probability(path.objectives.collision_risk)}",
        *promise_lines(run.plan.promise, run.medium.flows),
    ]
    return fitted_heading([run.plan.formula, *lines])


def fitted_heading(texts: Sequence[str]) -> list[str]:
    """``texts`` in lines that fit above the map."""
    width, size = (style.COLUMN_WIDTH - 2 * LEFT) / HINTED, float(style.RC_SETTINGS["font.size"])
    return [line for text in texts for line in style.fitted_lines(text, width, size)]


def promise_lines(promise: Promise | None, flows: str = "winds") -> list[str]:
    """Failure rate of fresh flights, its upper limit, wind law and number of flights; empty without them."""
    if promise is None:
        return []
    rate = promise.rate
    fails, upper = shown_probability(rate.failure), shown_probability(rate.high)
    return [f"fails {fails}, at most {upper} (95 %), {rate.law} {flows}, {rate.sample}"]


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
    """Text on the simulated flights under ``law``, and V + R there; at most ``count`` flights are drawn."""
    deployment = run.deployments[law]
    failed, runs = int(deployment.failed.sum()), len(deployment.x)
    text = f"{law} {run.medium.flows}: {failed:,} of {runs:,} flights failed "
    text += f"({shown_probability(failed / runs)}), {min(count, runs)} drawn"
    if gone := int(deployment.off_map.sum()):
        text += f"\n{shown_probability(gone / runs)} left the map"
        text += ", which is a failure" if deployment.walled else ", which is no failure"
    if law not in run.forecasts:
        return text
    bound = run.forecasts[law].mission_risk + run.forecasts[law].collision_risk
    return f"{text}\nbound V + R of the controls {shown_probability(bound)}"


# --- legends ------------------------------------------------------------------------------------


def _flight_keys(cfg: ReportConfig, run: DrawnRun) -> list[Artist]:
    """One entry for each wind law, and one for the flights that failed."""
    keys: list[Artist] = [
        Line2D(
            [],
            [],
            color=style.law_colour(law),
            ls=style.law_dashes(law),
            lw=1.0,
            label=flight_text(run, law, cfg.paths),
        )
        for law in run.deployments
    ]
    if keys:
        look: dict[str, Any] = {"marker": "x", "ms": 3.2, "mew": 0.7, "lw": 0.8}
        keys.append(Line2D([], [], color=style.FAILED, label="flights that failed, with their ends", **look))
    return keys


def _map_keys(cfg: ReportConfig, run: DrawnRun) -> list[Artist]:
    """Entries of the legend for everything else on the map."""
    keys: list[Artist] = []
    look: dict[str, Any] = {"ls": "", "ms": 4, "mfc": "white", "mec": "black", "mew": 0.9}
    if run.plan is not None:
        keys.append(Line2D([], [], color=style.BLACK, lw=1.3, label="planned path (mean)"))
        law = run.plan.models.law
        keys.append(
            Patch(
                fc=style.INK + "10",
                ec=style.INK,
                lw=0.5,
                label=f"95 % of positions, {law} {run.medium.flows}",
            )
        )
    keys.append(Line2D([], [], marker="o", label="start", **look))
    if run.plan is not None:
        keys.append(Line2D([], [], marker="s", label="end", **look))
    keys += ground_keys(run.scene)
    if (forest := _shown_forest(cfg, run)) is not None:
        keys.append(Line2D([], [], color=style.STONE, lw=0.6, alpha=0.8, label=_vertices_text(forest)))
    if run.decomposition is not None:
        keys.append(Line2D([], [], color=style.MIST, lw=0.7, ls=":", label="cells"))
    return keys


def ground_keys(scene: Scene) -> list[Artist]:
    """Entries for regions, obstacles and landmarks; also for those that are active for a limited time."""
    keys: list[Artist] = []
    if visited_outlines(scene):
        timed = any(name not in scene.forbidden for name in scene.windows)
        keys.append(Patch(**REGION_LOOK, label="region, with times" if timed else "region"))
    if scene.obstacles:
        keys.append(Patch(**OBSTACLE_LOOK, label="obstacle"))
    if timed_obstacles(scene):
        keys.append(Patch(**TIMED_LOOK, label="obstacle for a time"))
    if scene.landmarks:
        keys.append(Patch(**LANDMARK_LOOK, label="landmark"))
    return keys


def _vertices_text(forest: Forest) -> str:
    total = sum(map(len, forest.trees))
    few = total <= DRAWN_VERTICES
    return f"{total:,} vertices" if few else f"{DRAWN_VERTICES:,} of {total:,} vertices"


def _add_legend(figure: Figure, keys: list[Artist], top: float, columns: int) -> float:
    """A legend whose upper edge lies at ``top`` [in]; return where the next one begins."""
    if not keys:
        return top
    w, h = figure.get_size_inches()
    figure.legend(
        handles=keys,
        ncols=columns,
        loc="upper left",
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.6,
        columnspacing=1.2,
        labelspacing=0.35,
        bbox_to_anchor=(LEFT / w, top / h),
    )
    return top - TEXT_LINE * _key_lines(keys)


def _key_lines(keys: list[Artist]) -> int:
    """Lines of text of a legend of one column."""
    return sum(str(key.get_label()).count("\n") + 1 for key in keys)
