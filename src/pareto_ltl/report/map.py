"""The figure of a plan on its map."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from itertools import cycle

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pareto_ltl.planning.records import Forest, Plan
from pareto_ltl.report import style
from pareto_ltl.report.map_layers import (
    DRAWN_VERTICES,
    draw_covariances,
    draw_endpoints,
    draw_flights,
    draw_graticule,
    draw_ground,
    draw_mean_path,
    draw_trees,
    map_axes,
)
from pareto_ltl.report.wind import draw_wind_arrows, flight_midpoint
from pareto_ltl.settings import ReportConfig
from pareto_ltl.simulation.records import Deployment
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.cells import Decomposition
from pareto_ltl.world.scene import Scene

TEXT_LINE = 0.15  # height of a line of small text [in]


def plan_figure(
    cfg: ReportConfig,
    scene: Scene,
    decomposition: Decomposition,
    wind: WindField,
    forest: Forest | None,
    plan: Plan | None,
    deployments: Mapping[str, Deployment],
) -> Figure:
    """Map with trees, expected wind, planned path, 95 % ellipses and flights, as Figure 1 of the paper.

    Without ``plan`` the wind is that at departure, and the heading says why there is no plan.
    """
    title = _plan_heading(plan, forest, deployments)
    keys = _plan_legend(forest, plan, deployments, cfg.paths)
    if scene.landmarks:
        keys.append(Patch(fc="none", ec=style.PURPLE, lw=0.9, ls="--", label="landmark"))
    rows = (len(keys) + 1) // 2 + 1
    width, bottom, top = style.COLUMN_WIDTH, 0.42 + TEXT_LINE * rows, 0.26 + TEXT_LINE * len(title)
    west, east = 0.50, 0.42 if scene.crs else 0.12
    span = np.ptp(scene.bounds, axis=0)
    inner = width - west - east
    height = inner * float(np.clip(span[1] / span[0], 0.35, 1.6))
    figure = style.blank_figure(width, bottom + height + top)
    chart = map_axes(scene, style.axes_at(figure, west, bottom, inner, height))
    draw_graticule(chart, scene)
    draw_ground(chart, scene, decomposition)
    if forest is not None:
        draw_trees(chart, forest)
    if plan is not None:
        draw_covariances(chart, plan.path.x, plan.path.cov)
    for colour, deployment in zip(cycle(style.FLIGHT_COLOURS), deployments.values(), strict=False):
        draw_flights(chart, deployment, cfg.paths, colour)
    if plan is not None:
        draw_mean_path(chart, plan.path.x)
    draw_endpoints(chart, scene, plan)
    t, moment = flight_midpoint(scene, plan)
    draw_wind_arrows(chart, scene, wind, t, f"expected wind {moment}", west, bottom - 0.40)
    figure.legend(
        handles=keys,
        ncols=2,
        loc="upper left",
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.6,
        columnspacing=1.2,
        labelspacing=0.35,
        bbox_to_anchor=((west - 0.02) / width, (bottom - 0.52) / figure.get_size_inches()[1]),
    )
    for row, line in enumerate(reversed(title)):
        style.text_at(figure, west, bottom + height + 0.24 + TEXT_LINE * row, line, va="bottom")
    return figure


def _plan_legend(
    forest: Forest | None, plan: Plan | None, deployments: Mapping[str, Deployment], count: int
) -> list[Artist]:
    """Legend entries; for flights and vertices they give the number drawn and the total."""
    keys: list[Artist] = []
    if plan is not None:
        keys.append(Line2D([], [], color=style.BLUE, lw=1.3, label="planned path (mean)"))
        keys.append(Patch(fc=style.BLUE + "14", ec=style.BLUE, lw=0.5, label="95 % of positions"))
    for colour, (law, d) in zip(cycle(style.FLIGHT_COLOURS), deployments.items(), strict=False):
        name = f"{law} winds: " if len(deployments) > 1 else "flights: "
        keys.append(Line2D([], [], color=colour, lw=0.8, label=f"{name}{min(count, len(d.x))} of {len(d.x)}"))
    if deployments:
        bad = " and ".join(str(int((~d.accepted | d.collided).sum())) for d in deployments.values())
        runs = max(len(d.x) for d in deployments.values())
        keys.append(Line2D([], [], color=style.VERMILLION, lw=0.8, label=f"failed: {bad} of {runs}"))
    keys.append(Patch(fc=style.GREEN + "30", ec=style.GREEN, lw=1.0, label="region"))
    keys.append(Patch(fc="#6E6E6E", ec="#4A4A4A", lw=0.5, label="obstacle"))
    if forest is not None:
        total = sum(map(len, forest.trees))
        label = (
            f"{total:,} vertices" if total <= DRAWN_VERTICES else f"{DRAWN_VERTICES:,} of {total:,} vertices"
        )
        keys.append(Line2D([], [], color=style.STONE, lw=0.6, alpha=0.8, label=label))
    keys.append(Line2D([], [], color=style.MIST, lw=0.7, ls=":", label="cells"))
    keys.append(Line2D([], [], ls="", marker="o", ms=4, mfc="white", mec="black", mew=0.9, label="start"))
    if plan is not None:
        keys.append(Line2D([], [], ls="", marker="s", ms=4, mfc="white", mec="black", mew=0.9, label="end"))
    return keys


def _plan_heading(
    plan: Plan | None, forest: Forest | None, deployments: Mapping[str, Deployment]
) -> list[str]:
    """Lines above the map: the formula and its bounds, or the reason why there is no plan."""
    if plan is None:
        grown = (
            ""
            if forest is None
            else f" ({len(forest.trees)} trees, {sum(map(len, forest.trees)):,} vertices)"
        )
        return [
            "No plan: no path completes the mission"
            if forest is None or not len(forest.accepted)
            else "No plan: no path satisfies the selection rule",
            f"Trees as far as they came{grown}",
        ]
    o = plan.path.objectives
    mission = risk_percent(o.mission_risk)
    collision = risk_percent(o.collision_risk)
    promise = f"length {o.length / 1000:,.0f} km, mission risk ≤ {mission}, collision risk ≤ {collision}"
    return [*textwrap.wrap(plan.formula, 52, max_lines=2, placeholder=" …"), *textwrap.wrap(promise, 62)]


def risk_percent(probability: float) -> str:
    """``0.62 %``; a probability below 1e-9 is shown as 1e-9, the accuracy of the wind model."""
    if probability < 1e-9:
        return "10⁻⁷\N{NO-BREAK SPACE}%"
    if probability < 1e-5:
        mantissa, power = f"{100 * probability:.1e}".split("e")
        raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{mantissa}·10{raised}\N{NO-BREAK SPACE}%"
    return f"{100 * probability:.2g}\N{NO-BREAK SPACE}%"


__all__ = ["plan_figure", "risk_percent"]
