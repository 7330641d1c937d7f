"""The figure of the wind field, and the wind arrows on a map."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver

from flight_quantities.medium import medium_of
from pareto_ltl import Scene, WindField
from pareto_ltl.extend import Plan
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.geojson import border_corners
from pareto_ltl_apps.view import lattice, map_layers, style

SPEED = "speed [m/s]"
LONGEST = 0.95  # longest arrow, as a share of the distance between two arrows
ARROWS: dict[str, Any] = {
    "pivot": "mid", "units": "inches", "scale_units": "inches", "headwidth": 3.6, "headlength": 4.2,
    "headaxislength": 3.8, "minshaft": 1.5,
}  # fmt: skip


def flight_midpoint(plan: Plan | None) -> tuple[float, str]:
    """Time half-way through the flight [s since time_zero] and its text; departure without a plan."""
    if plan is None:
        return 0.0, "at departure"
    t = float(plan.path.t[0] + plan.path.t[-1]) / 2.0
    return t, f"at mid-flight ({_since(t)})"


def _since(t: float) -> str:
    """A time after departure [s]: ``9.2 h``, ``36 min``, ``90 s``."""
    return f"{t / 3600:.1f} h" if t >= 3600 else f"{t / 60:.0f} min" if t >= 120 else f"{t:.0f} s"


def utc_text(scene: Scene, t: float) -> str:
    """``9 Oct 2018, 12:30 UTC`` for ``t`` [s since time_zero]; empty if the scene has no time_zero."""
    if scene.time_zero is None:
        return ""
    when = datetime.fromisoformat(scene.time_zero) + timedelta(seconds=t)
    return f"{when.day} {when:%b %Y, %H:%M} UTC"


def draw_wind_arrows(
    chart: Axes, scene: Scene, wind: WindField, t: float, text: str, left: float, bottom: float
) -> None:
    """Expected wind at ``t`` [s] as arrows on lattice nodes; a scale arrow at ``left``, ``bottom`` [in].

    Calm wind gives a text instead.
    """
    figure = chart.figure
    assert isinstance(figure, Figure)
    quiver = draw_arrows(chart, wind, t, scene.bounds)
    if quiver is None:
        style.text_at(figure, left, bottom, f"{text}: calm", va="center", fontsize=6.5)
        return
    w, h = figure.get_size_inches()
    scale = float(quiver.scale or 1.0)
    unit = style.round_below(float(np.hypot(quiver.U, quiver.V).max()))
    middle = (left + unit / scale / 2) / w
    chart.quiverkey(quiver, middle, bottom / h, unit, "", coordinates="figure", color=style.SKY)
    beside = left + unit / scale + 0.06
    style.text_at(figure, beside, bottom, f"{unit:g} m/s, {text}", va="center", fontsize=6.5)


def draw_arrows(
    chart: Axes, wind: WindField, t: float, bounds: FloatArray, *,
    color: str = style.SKY, width: float = 0.009, zorder: float = 2.8,
) -> Quiver | None:  # fmt: skip
    """Expected wind at ``t`` [s] as arrows on lattice nodes within ``bounds`` (2, 2); None if it is calm."""
    x, y = lattice.lattice_nodes(wind)
    i, j = lattice.arrow_nodes(wind, bounds)
    field = lattice.interpolate_slots(wind.times, wind.mean, t)[np.ix_(i, j)]
    look: dict[str, Any] = {"color": color, "width": width, "zorder": zorder}
    top = float(np.hypot(field[..., 0], field[..., 1]).max(initial=0.0))
    if top == 0.0:
        return None
    gap = float(np.ptp(bounds, axis=0).max()) / lattice.ARROWS_ALONG * map_layers.inches_per_metre(chart)
    nodes = np.meshgrid(x[i], y[j], indexing="ij")
    return chart.quiver(*nodes, *np.moveaxis(field, -1, 0), scale=top / (LONGEST * gap), **ARROWS, **look)


def wind_figure(scene: Scene, wind: WindField, plan: Plan | None) -> Figure:
    """The wind half-way through the flight; without a plan, at departure."""
    return wind_panels(scene, wind, *flight_midpoint(plan), None if plan is None else plan.path.x)


def wind_panels(
    scene: Scene, wind: WindField, t: float, moment: str, route: FloatArray | None = None
) -> Figure:
    """Expected wind at ``t`` [s] with arrows, and standard deviation of the wind of one step.

    Both on the whole lattice, with the planned ``route`` (T+1, 2) [m]; ``moment`` says when that is.
    """
    x, y = lattice.lattice_nodes(wind)
    inner, west = 2.35, 0.48
    height = inner * float(np.clip(np.ptp(y) / max(np.ptp(x), 1.0), 0.35, 1.6))
    figure = style.blank_figure(style.PAGE_WIDTH, height + 0.85)
    sd = lattice.wind_deviation(wind, t)
    panels = (
        (f"(a) Expected {medium_of(wind.level).flow}", SPEED, expected_speed(wind, t), "viridis"),
        ("(b) Standard deviation, least at readings", "standard deviation [m/s]", sd, "cividis"),
    )
    for n, (title, label, values, cmap) in enumerate(panels):
        left = west + n * style.PAGE_WIDTH / 2
        chart = map_layers.map_axes(scene, style.axes_at(figure, left, 0.42, inner, height))
        _draw_surface(chart, scene, wind, values, cmap)
        if n == 0:
            _draw_white_arrows(chart, wind, t)
        if route is not None:
            map_layers.draw_mean_path(chart, route)
        scale = style.axes_at(figure, left + inner + 0.08, 0.42, 0.09, height)
        bar = figure.colorbar(chart.images[0], cax=scale, label=label)
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
    more = " and others" if others else ""
    return f"{medium_of(wind.level).flow} at {wind.level}{law}, source: {first}{more}"


def draw_wind(ax: Axes, scene: Scene, wind: WindField, t: float) -> None:
    """Expected wind at ``t`` [s] on axes of the reader: arrows, and the speed as colour with its scale."""
    _draw_surface(map_layers.map_axes(scene, ax), scene, wind, expected_speed(wind, t), "viridis")
    ax.figure.colorbar(ax.images[-1], ax=ax, label=SPEED)
    ax.apply_aspect()
    _draw_white_arrows(ax, wind, t)


def expected_speed(wind: WindField, t: float) -> FloatArray:
    """Speed of the expected wind at ``t`` [s], (NX, NY) [m/s]."""
    mean = lattice.interpolate_slots(wind.times, wind.mean, t)
    return np.hypot(mean[..., 0], mean[..., 1])


def _draw_white_arrows(chart: Axes, wind: WindField, t: float) -> None:
    """Arrows on the whole lattice."""
    x, y = lattice.lattice_nodes(wind)
    whole = np.array([[x[0], y[0]], [x[-1], y[-1]]])
    draw_arrows(chart, wind, t, whole, color="white", width=0.011, zorder=4)


def _draw_surface(chart: Axes, scene: Scene, wind: WindField, values: FloatArray, cmap: str) -> None:
    """``values`` (NX, NY) as colour, interpolated bilinearly, on the lattice, with the outlines of a map."""
    x, y = lattice.lattice_nodes(wind)
    half = wind.spacing / 2.0
    extent = (x[0] - half, x[-1] + half, y[0] - half, y[-1] + half)
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-3:  # a constant field gets a colour scale of finite width
        low, high = low - 0.5 if low >= 0.5 else 0.0, high + 0.5
    look: dict[str, Any] = {"norm": Normalize(low, high), "interpolation": "bilinear", "zorder": 0}
    chart.imshow(values.T, origin="lower", extent=extent, cmap=cmap, **look)
    chart.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    _draw_outlines(chart, scene)
    map_layers.number_obstacles(chart, scene)


def _draw_outlines(chart: Axes, scene: Scene) -> None:
    """Bounds, obstacles and regions as thin lines, with the names of the regions."""
    outlines = [*scene.obstacles, *scene.region_outlines]
    map_layers.draw_polygons(chart, [border_corners(scene.bounds)], fc="none", ec="black", lw=0.9, zorder=3)
    map_layers.draw_polygons(chart, outlines, fc="none", ec="black", lw=0.5, zorder=3)
    for name, there in scene.regions.items():
        if there:
            largest = max(there, key=lambda outline: float(np.ptp(outline, axis=0).prod()))
            halo = style.white_halo(1.6)
            map_layers.draw_text(chart, largest.mean(axis=0), name, fontweight="bold", path_effects=halo)
