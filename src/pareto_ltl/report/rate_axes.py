"""Logarithmic axes and colour bars of probabilities, in per cent."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from pareto_ltl.report.style import SUPERSCRIPTS

GRID_COLOUR = "#E5E5E5"
MOST_TICKS = 6


def scale_rate_axis(ax: Axes, axis: str, low: float, high: float = 1.0, *, hidden: bool = True) -> None:
    """Make ``axis`` (x or y) a logarithmic axis of probabilities from ``low`` to ``high``, in per cent.

    If ``hidden`` values lie below ``low``, its tick has a ``≤``.
    """
    getattr(ax, f"set_{axis}scale")("log")
    getattr(ax, f"set_{axis}lim")(low, high)
    set_rate_ticks(ax.xaxis if axis == "x" else ax.yaxis, low, high, hidden=hidden)
    ax.grid(axis=axis, color=GRID_COLOUR, lw=0.4)  # type: ignore[arg-type]


def set_rate_ticks(side: Axis, low: float, high: float, *, hidden: bool) -> None:
    """Ticks at round percentages between ``low`` and ``high``."""
    side.set_major_locator(FixedLocator(rate_ticks(low, high)))
    side.set_major_formatter(FuncFormatter(lambda value, _: rate_tick_text(value, low if hidden else 0.0)))
    side.set_minor_formatter(NullFormatter())


def rate_ticks(low: float, high: float) -> list[float]:
    """Powers of ten from ``low`` to ``high``: every n-th if they are many, with 2 and 5 times if few."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    if last - first >= 2:
        stride = -(-(last - first + 1) // MOST_TICKS)
        ticks = [10.0**k for k in range(last, first - 1, -stride)][::-1]
        return ticks if math.isclose(ticks[0], low, rel_tol=1e-6) else [low, *ticks]
    fine = [m * 10.0**k for k in range(first - 1, last + 1) for m in (1.0, 2.0, 5.0)]
    return [tick for tick in fine if low * (1 - 1e-9) <= tick <= high * (1 + 1e-9)]


def rate_tick_text(value: float, low: float = 0.0) -> str:
    """``value`` in per cent; with ``≤`` at the end ``low`` of the axis."""
    percent = 100.0 * value
    text = f"{percent:g}"
    if percent < 0.999e-3:
        text = "10" + str(round(math.log10(percent))).translate(SUPERSCRIPTS)
    return ("≤ " if value <= low * 1.01 else "") + text
