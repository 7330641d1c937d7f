"""The figure of the wind field, and the wind arrows on a map."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from pareto_ltl.planning.records import Plan
from pareto_ltl.report import style
from pareto_ltl.report.lattice import (
    ARROWS_ALONG,
    arrow_nodes,
    interpolate_slots,
    lattice_nodes,
    spaced_nodes,
    wind_deviation,
)
from pareto_ltl.report.map_layers import MapAxes, map_axes, number_obstacles
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.medium import medium_of
from pareto_ltl.wind.records import WindField
from pareto_ltl.world.scene import Scene


def flight_midpoint(plan: Plan | None) -> tuple[float, str]:
    """Time half-way through the flight [s since time_zero] and its text; departure without a plan."""
    t = 0.0 if plan is None else float(plan.path.t[0] + plan.path.t[-1]) / 2.0
    words = (
        "at departure"
        if plan is None
        else f"at mid-flight ({t / 3600:.1f} h)"
        if t >= 3600
        else f"at mid-flight ({t:.0f} s)"
    )
    return t, words


def utc_text(scene: Scene, t: float) -> str:
    """``9 Oct 2018, 12:30 UTC`` for ``t`` [s since time_zero]; empty if the scene has no time_zero."""
    if scene.time_zero is None:
        return ""
    when = datetime.fromisoformat(scene.time_zero) + timedelta(seconds=t)
    return f"{when.day} {when:%b %Y, %H:%M} UTC"


def draw_wind_arrows(
    chart: MapAxes, scene: Scene, wind: WindField, t: float, text: str, left: float, bottom: float
) -> None:
    """Expected wind at ``t`` [s] as arrows on lattice nodes; a scale arrow at ``left``, ``bottom`` [in].

    The longest arrow is 0.95 times the distance between two arrows. Calm wind gives a text instead.
    """
    figure, ax = chart.ax.figure, chart.ax
    assert isinstance(figure, Figure)
    (west, south), (east, north) = scene.bounds
    x, y = lattice_nodes(wind)
    gap = max(east - west, north - south) / ARROWS_ALONG
    i, j = arrow_nodes(wind, scene.bounds)
    field = interpolate_slots(wind.times, wind.mean, t)[np.ix_(i, j)]
    speed = np.hypot(field[..., 0], field[..., 1])
    if speed.size == 0 or not speed.max() > 0:
        style.text_at(figure, left, bottom, f"{text}: calm", va="center", fontsize=6.5)
        return
    inches = ax.get_position().width * figure.get_size_inches()[0] * gap / (east - west)
    scale = float(speed.max()) / (0.95 * inches)
    quiver = ax.quiver(
        *(np.meshgrid(x[i] * chart.per_metre, y[j] * chart.per_metre, indexing="ij")),
        field[..., 0],
        field[..., 1],
        color=style.SKY,
        pivot="mid",
        scale=scale,
        scale_units="inches",
        units="inches",
        width=0.009,
        headwidth=3.6,
        headlength=4.2,
        headaxislength=3.8,
        minshaft=1.5,
        zorder=2.8,
    )
    w, h = figure.get_size_inches()
    unit = style.round_below(float(speed.max()))
    ax.quiverkey(
        quiver, (left + unit / scale / 2) / w, bottom / h, unit, "", coordinates="figure", color=style.SKY
    )
    style.text_at(
        figure, left + unit / scale + 0.06, bottom, f"{unit:g} m/s, {text}", va="center", fontsize=6.5
    )


def wind_figure(scene: Scene, wind: WindField, plan: Plan | None) -> Figure:
    """The wind half-way through the flight; without a plan, at departure."""
    return wind_panels(scene, wind, *flight_midpoint(plan), None if plan is None else plan.path.x)


def wind_panels(
    scene: Scene, wind: WindField, t: float, moment: str, route: FloatArray | None = None
) -> Figure:
    """Expected wind at ``t`` [s] with arrows, and standard deviation of the wind of one step.

    Both on the whole lattice, with the planned ``route`` (T+1, 2) [m]; ``moment`` says when that is.
    """
    mean = interpolate_slots(wind.times, wind.mean, t)
    x, y = lattice_nodes(wind)
    inner, west = 2.35, 0.48
    height = inner * float(np.clip(np.ptp(y) / max(np.ptp(x), 1.0), 0.35, 1.6))
    figure = style.blank_figure(style.PAGE_WIDTH, height + 0.85)
    deviation = wind_deviation(wind, t)
    panels = (
        (
            f"(a) Expected {medium_of(wind.level).flow}",
            "speed [m/s]",
            np.hypot(mean[..., 0], mean[..., 1]),
            "viridis",
        ),
        (
            "(b) Standard deviation, least at readings",
            "standard deviation [m/s]",
            deviation,
            "cividis",
        ),
    )
    for n, (title, label, values, cmap) in enumerate(panels):
        left = west + n * style.PAGE_WIDTH / 2
        chart = map_axes(scene, style.axes_at(figure, left, 0.42, inner, height))
        _draw_surface(chart, wind, values, cmap)
        _draw_outlines(chart, scene)
        number_obstacles(chart, scene, "white")
        if n == 0:
            _draw_directions(chart, wind, mean)
        if route is not None:
            look = {"lw": 1.3, "zorder": 6, "path_effects": style.white_halo(2.2)}
            chart.ax.plot(*(route * chart.per_metre).T, color=style.BLACK, **look)  # type: ignore[arg-type]
        bar = figure.colorbar(
            chart.ax.images[0], cax=style.axes_at(figure, left + inner + 0.08, 0.42, 0.09, height)
        )
        bar.set_label(label)
        bar.outline.set_linewidth(0.5)
        style.text_at(figure, left, 0.42 + height + 0.05, title, va="bottom", fontweight="bold")
    when = ", ".join(text for text in (utc_text(scene, t), moment, _origin_text(wind)) if text)
    style.text_at(figure, west, 0.42 + height + 0.22, when[:1].upper() + when[1:], va="bottom")
    return figure


def _origin_text(wind: WindField) -> str:
    """Level, source and law of forecast errors; empty for a field of unknown source."""
    if not wind.source:
        return ""
    law = "" if wind.error is None else f", forecast errors: {wind.error.name}"
    first, *others = wind.source.split(", ")
    return (
        f"{medium_of(wind.level).flow} at {wind.level}{law}, source: {first}{' and others' if others else ''}"
    )


def _draw_surface(chart: MapAxes, wind: WindField, values: FloatArray, cmap: str) -> None:
    """``values`` (NX, NY) as colour, interpolated bilinearly, on the extent of the lattice."""
    x, y = (nodes * chart.per_metre for nodes in lattice_nodes(wind))
    half = wind.spacing * chart.per_metre / 2.0
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-3:  # a constant field gets a colour scale of finite width
        low, high = low - 0.5 if low >= 0.5 else 0.0, high + 0.5
    chart.ax.imshow(
        values.T,
        origin="lower",
        extent=extent,
        cmap=cmap,
        norm=Normalize(low, high),
        interpolation="bilinear",
        zorder=0,
    )
    chart.ax.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


def _draw_directions(chart: MapAxes, wind: WindField, mean: FloatArray) -> None:
    """Arrows along the expected wind; their length is proportional to its speed."""
    x, y = lattice_nodes(wind)
    gap = max(np.ptp(x), np.ptp(y)) / ARROWS_ALONG
    i, j = spaced_nodes(x, x[0], x[-1], gap), spaced_nodes(y, y[0], y[-1], gap)
    field = mean[np.ix_(i, j)]
    top = float(np.hypot(field[..., 0], field[..., 1]).max())
    if top > 0:
        chart.ax.quiver(
            *np.meshgrid(x[i] * chart.per_metre, y[j] * chart.per_metre, indexing="ij"),
            field[..., 0],
            field[..., 1],
            color="white",
            pivot="mid",
            angles="xy",
            scale=top / (0.95 * gap * chart.per_metre),
            scale_units="xy",
            units="inches",
            width=0.011,
            headwidth=3.6,
            headlength=4.2,
            headaxislength=3.8,
            minshaft=1.5,
            zorder=4,
        )


def _extent(outline: FloatArray) -> float:
    """Area [m²] of the box around ``outline``."""
    return float(np.ptp(outline, axis=0).prod())


def _draw_outlines(chart: MapAxes, scene: Scene) -> None:
    """Bounds, obstacles and regions as thin lines, with the names of the regions."""
    (west, south), (east, north) = scene.bounds
    frame = np.array([[west, south], [east, south], [east, north], [west, north]])
    for polygons, width in (([frame], 0.9), ([*scene.obstacles, *scene.region_outlines], 0.5)):
        chart.ax.add_collection(
            PolyCollection(
                [p * chart.per_metre for p in polygons],
                facecolors="none",
                edgecolors="black",
                linewidths=width,
                zorder=3,
            ),
            autolim=False,
        )
    for name, outlines in scene.regions.items():
        if not outlines:
            continue
        x, y = max(outlines, key=_extent).mean(axis=0) * chart.per_metre
        chart.ax.text(
            x,
            y,
            name,
            ha="center",
            va="center",
            fontweight="bold",
            zorder=9,
            path_effects=style.white_halo(1.6),
            parse_math=False,
        )
