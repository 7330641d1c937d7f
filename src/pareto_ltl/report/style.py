"""How our pictures look: colours, sizes, ticks, and files that come out the same every time.

Figures are made at the width they are printed at (3.5 in a column, 7.16 in a page), so that 7 pt in
the file is 7 pt on paper. Colours are those of Okabe and Ito, which stay apart for colour-blind readers;
scales are ``cividis`` and ``viridis``, made for the same readers.
"""

from __future__ import annotations

import math
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from pareto_ltl.support.arrays import FloatArray

COLUMN, PAGE = 3.5, 7.16  # widths of a column and of a page [in]

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILLION, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
FLIGHTS = (ORANGE, PURPLE)  # one colour a wind law
INK, STONE, MIST = "#333333", "#8C8C8C", "#B8B8B8"

CHI2_95 = -2.0 * math.log(0.05)  # 95 % quantile of χ² with two degrees of freedom: its tail is exp(-x/2)

RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so letters are the same on every machine
    "font.size": 7.0,
    "axes.labelsize": 7.0,
    "axes.titlesize": 7.0,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "axes.labelpad": 2.5,
    "svg.hashsalt": "pareto_ltl",  # names inside an SVG would be random otherwise
    "svg.fonttype": "path",
}

_LOCK = threading.Lock()  # matplotlib's settings belong to the whole process


@contextmanager
def styled() -> Iterator[None]:
    """Our settings and nothing of a user's matplotlibrc, for one thread at a time."""
    with _LOCK, matplotlib.style.context(["default", RC]):
        yield


def blank(width: float, height: float) -> Figure:
    """A figure of ``width`` x ``height`` [in] that draws itself without a screen."""
    figure = Figure(figsize=(width, height), facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def box(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at a place given in inches."""
    w, h = figure.get_size_inches()
    return figure.add_axes((left / w, bottom / h, width / w, height / h))


def note(figure: Figure, left: float, bottom: float, text: str, **kwargs: Any) -> None:
    """Text at a place given in inches; ``$`` and ``_`` are letters like any other."""
    w, h = figure.get_size_inches()
    figure.text(left / w, bottom / h, text, parse_math=False, **kwargs)


def halo(width: float = 1.6) -> list[withStroke]:
    """A white rim that keeps letters and symbols readable on any ground."""
    return [withStroke(linewidth=width, foreground="white")]


def save(figure: Figure, folder: Path, name: str, dpi: int) -> tuple[Path, Path]:
    """Write ``name``.png and ``name``.svg without a date or a version inside: the same bytes every time."""
    png, svg = folder / f"{name}.png", folder / f"{name}.svg"
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Glyph .* missing from font"
        )  # a region's name may be in any script
        figure.savefig(png, dpi=dpi, metadata={"Software": None})
        figure.savefig(svg, dpi=dpi, metadata={"Date": None, "Creator": None})
    return png, svg


def nice(value: float) -> float:
    """The largest of 1, 2, 5 x 10^k that is not above ``value`` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * next(m for m in (5.0, 2.0, 1.0) if m * power <= value * (1 + 1e-9) or m == 1.0)


def floor_of(values: FloatArray, least: float = 1e-9) -> tuple[float, bool]:
    """Where a logarithmic axis of probabilities ends, and whether values lie on or below that end.

    The end is the decade below the smallest value that is at least ``least``: a model of the wind promises
    nothing about probabilities under 10⁻⁹, and 0 has no place on the axis.
    """
    shown = values[values >= least]
    end = 10.0 ** (math.floor(math.log10(shown.min()) + 1e-9)) if len(shown) else least
    hidden = bool(np.any(values < end))
    return (max(end / 10.0, least) if hidden else end), hidden


def ellipses(x: FloatArray, cov: FloatArray, corners: int = 48) -> FloatArray:
    """Outlines that hold 95 % of a Gaussian each, {y : (y - x)' Σ⁻¹ (y - x) = χ²₀.₉₅}, shape (n, corners, 2).

    Parameters
    ----------
    x : (n, 2) float
        Means.
    cov : (n, 2, 2) float
        Covariances Σ; singular ones give segments and points.
    """
    values, vectors = np.linalg.eigh(cov)
    roots = vectors * np.sqrt(CHI2_95 * np.clip(values, 0.0, None))[:, None, :]
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    outlines: FloatArray = x[:, None, :] + circle @ roots.transpose(0, 2, 1)
    return outlines


def crossings(along: FloatArray, value: FloatArray, wanted: int = 4) -> list[tuple[float, float]]:
    """Where ``value``, monotone on an edge, passes round numbers: pairs (place on the edge, round number)."""
    span = float(np.ptp(value))
    if not span > 0:
        return []
    step = next(
        s
        for s in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60)
        if span / s <= wanted + 1 or s == 60
    )
    order = np.argsort(value)
    marks = np.arange(math.ceil(value.min() / step), math.floor(value.max() / step) + 1) * step
    return [(float(np.interp(m, value[order], along[order])), float(round(m, 6))) for m in marks]


def degrees(value: float, positive: str, negative: str) -> str:
    """``92°W`` for (-92, "E", "W")."""
    side = positive if value > 0 else negative if value < 0 else ""
    return f"{abs(value):g}°{side}"
