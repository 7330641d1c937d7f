"""The figure of ``pareto-ltl wind-error``: errors by lead, changes by time, their correlation in space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from careful_io.times import HOUR
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import panel_row
from pareto_ltl_apps.wind_errors.error_estimate import ASYMMETRY, MIXED, ErrorEstimate, ErrorTable, LengthFit
from wind_laws.forecast_error import ForecastError
from wind_laws.gp import CORRELATIONS

ERROR_COLOUR, CHANGE_COLOUR = style.VERMILLION, style.BLUE
DPI = 300


def draw_wind_error(
    folder: Path, name: str, estimate: ErrorEstimate, law: ForecastError, usual: ForecastError
) -> tuple[Path, ...]:
    """Write ``name``.png and ``name``.svg into ``folder``; return the paths.

    Parameters
    ----------
    law, usual : ForecastError
        The estimated law, and the packaged law.
    """
    with style.report_style():
        return style.save_figure(wind_error_figure(estimate, law, usual), folder, name, DPI)


def wind_error_figure(estimate: ErrorEstimate, law: ForecastError, usual: ForecastError) -> Figure:
    """Three panels: error of forecasts, change of the wind, correlation of both by distance."""
    figure, axes = panel_row(
        ("(a) error of forecasts", "(b) change of the wind", "(c) correlation in space"), height=2.35,
        width=1.86, west=0.44, gap=0.5, base=0.42, top=0.3,
    )  # fmt: skip
    _draw_errors(axes[0], estimate.forecast, law, usual)
    _draw_changes(axes[1], estimate.change, law, usual)
    _draw_correlations(axes[2], estimate)
    return figure


def _draw_errors(ax: Axes, table: ErrorTable | None, law: ForecastError, usual: ForecastError) -> None:
    last = 24.0 if table is None else max(12.0, 1.5 * float(table.at[-1]) / HOUR)
    hours = np.linspace(0.0, last, 200)
    if table is not None:
        ax.plot(hours, np.sqrt(law.forecast_variance(HOUR * hours)), color=ERROR_COLOUR, lw=1.0, zorder=2)
        _draw_table(ax, table, ERROR_COLOUR, hollow=ASYMMETRY)
    else:
        text = "no forecast can be\ncompared with analyses"
        ax.text(0.5, 0.3, text, transform=ax.transAxes, ha="center", va="center", color=style.STONE)
    _draw_usual(ax, hours, np.sqrt(usual.forecast_variance(HOUR * hours)), usual)
    ax.set_xlabel("lead [h]")
    ax.set_ylabel("sd of one component [m/s]")
    _finish(ax, last, table is not None and ASYMMETRY in table.ways, "from asymmetry", ERROR_COLOUR)


def _draw_changes(ax: Axes, table: ErrorTable, law: ForecastError, usual: ForecastError) -> None:
    last = 1.08 * float(table.at[-1]) / HOUR
    hours = np.linspace(0.0, last, 300)
    ax.plot(hours, np.sqrt(law.change_variance(HOUR * hours)), color=CHANGE_COLOUR, lw=1.0, zorder=2)
    _draw_usual(ax, hours, np.sqrt(usual.change_variance(HOUR * hours)), usual)
    _draw_table(ax, table, CHANGE_COLOUR, hollow=MIXED)
    ax.set_xlabel("time between two winds [h]")
    _finish(ax, last, MIXED in table.ways, "with forecasts", CHANGE_COLOUR)


def _draw_table(ax: Axes, table: ErrorTable, colour: str, hollow: str) -> None:
    """Estimates with their intervals; those made the way ``hollow`` are drawn hollow."""
    for at, sd, way in zip(table.at / HOUR, table.sd, table.ways, strict=True):
        ax.plot([at, at], [sd.low, sd.high], color=colour, lw=0.9, zorder=3, clip_on=False)
        face = "white" if way == hollow else colour
        ax.plot(at, sd.value, "o", ms=3.6, mfc=face, mec=colour, mew=0.9, zorder=4, clip_on=False)


def _draw_usual(ax: Axes, hours: FloatArray, sd: FloatArray, usual: ForecastError) -> None:
    label = f"packaged law {usual.name}"
    ax.plot(hours, sd, color=style.STONE, lw=0.9, ls=(0, (4, 2)), zorder=1, label=label)


def _finish(ax: Axes, last: float, marked: bool, text: str, colour: str) -> None:
    """Limits, and a legend of the curves and, if there are any, of hollow marks."""
    ax.set_xlim(0.0, last)
    ax.set_ylim(0.0, None)
    ticks = (float(step) for step in (1, 3, 6, 12, 24, 48, 96) if last / step <= 9)  # at most nine
    ax.set_xticks(np.arange(0.0, last, next(ticks, 240.0)))
    if marked:
        ax.plot([], [], "o", ms=3.6, mfc="white", mec=colour, mew=0.9, label=text)
    ax.legend(loc="lower right", handlelength=1.8, borderaxespad=0.2, labelspacing=0.3)


def _draw_correlations(ax: Axes, estimate: ErrorEstimate) -> None:
    ax.axhline(0.0, color=style.MIST, lw=0.6, zorder=1)
    farthest = 100e3
    for fit, colour, mark, what in (
        (estimate.change_length, CHANGE_COLOUR, "o", "change"),
        (estimate.forecast_length, ERROR_COLOUR, "s", "error"),
    ):
        if len(fit.distances):
            farthest = max(farthest, float(fit.distances[-1]))
            _draw_fit(ax, fit, colour, mark, what)
    if estimate.forecast_length.length is None:
        ax.plot([], [], " ", label="error: not in the data")
    ax.set_xlim(0.0, farthest * 1.03 / 1e3)
    ax.set_xticks(np.arange(0.0, farthest / 1e3, style.round_below(farthest / 2e3)))
    ax.set_ylim(top=1.0)
    ax.set_xlabel("distance [km]")
    ax.set_ylabel("correlation")
    ax.legend(loc="upper right", handlelength=1.8, borderaxespad=0.2, labelspacing=0.3)


def _draw_fit(ax: Axes, fit: LengthFit, colour: str, mark: str, what: str) -> None:
    ax.plot(fit.distances / 1e3, fit.observed, mark, ms=3.2, color=colour, mew=0, zorder=4, clip_on=False)
    if (length := fit.length) is None:
        return
    r = np.linspace(0.0, fit.distances[-1], 300)
    km = f"{length.value / 1e3:.0f} km"
    middle = CORRELATIONS["matern32"](r / length.value)
    ax.plot(r / 1e3, middle, color=colour, lw=1.0, zorder=3, label=f"{what}: {km}")
    if np.isfinite(length.low + length.high):
        low, high = (CORRELATIONS["matern32"](r / end) for end in (length.low, length.high))
        ax.fill_between(r / 1e3, low, high, color=colour, alpha=0.15, lw=0, zorder=2)
