"""Figure and page of a law of parts: its parts, what the data say, and coverage of situations left out."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from careful_io.files import write_text
from careful_io.times import HOUR
from pareto_ltl.extend import LawOfParts
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import panel_row
from pareto_ltl_apps.view.components import page_environment
from pareto_ltl_apps.wind_errors.law_check import DISPLACEMENT, ERROR, LEVELS, CheckRow
from pareto_ltl_apps.wind_errors.law_estimate import LawEstimate, law_numbers
from pareto_ltl_apps.wind_errors.scale_mixture import coverage

LASTING = "lasting"
COLOURS = {
    "growing": style.VERMILLION, "slow": style.BLUE, "local": style.GREEN, LASTING: style.PURPLE,
}  # fmt: skip
DPI = 300
LONGEST = 72.0  # [h] of the panels
KM = 1e3
HEADROOM = 1.3  # above the curves, for the legend


def write_law_page(folder: Path, name: str, estimate: LawEstimate) -> tuple[Path, ...]:
    """Write ``name``.png, ``name``.svg and the page ``name``.html into ``folder``; return the paths."""
    with style.report_style():
        drawn = style.save_figure(law_figure(estimate), folder, name, DPI)
    picture = (folder / f"{name}.svg").read_text(encoding="utf-8")
    page = folder / f"{name}.html"
    write_text(page, law_page(estimate, picture[picture.index("<svg") :]))
    return (*drawn, page)


def law_figure(estimate: LawEstimate) -> Figure:
    """Three panels: errors by lead with their parts, displacements by time, and the tails."""
    figure, axes = panel_row(
        ("(a) error by lead", "(b) displacement by time", "(c) tails at 24 h"), height=2.35, width=1.86,
        west=0.44, gap=0.5, base=0.42, top=0.3,
    )  # fmt: skip
    _draw_parts(axes[0], estimate)
    _draw_displacements(axes[1], estimate)
    _draw_tails(axes[2], estimate)
    return figure


def law_page(estimate: LawEstimate, picture: str) -> str:
    """The page as HTML, complete in itself."""
    law = estimate.law
    template = files("pareto_ltl_apps.view").joinpath("wind_law.html").read_text(encoding="utf-8")
    numbers = [(name, value, *law.intervals[name]) for name, value in law_numbers(law).items()]
    rows = [
        (
            f"{left.row.kind} {left.row.hours:g} h",
            [
                (100 * share, 100 * low, 100 * high)
                for share, low, high in zip(left.covered, left.low, left.high, strict=True)
            ],
            float(np.sqrt(np.mean(left.row.z**2))),
            len(np.unique(left.row.situation)),
        )
        for left in sorted(estimate.left_out, key=lambda left: (left.row.kind, left.row.hours))
    ]
    return page_environment().from_string(template).render(
        law=law, parts=[(part.name, *part.words()) for part in law.parts], numbers=numbers, rows=rows,
        levels=[f"{100 * level:g} %" for level in LEVELS], notes=estimate.notes, picture=picture,
        lasting=law.part(LASTING) is not None and law.truth == "own",
    )  # fmt: skip


def _draw_parts(ax: Axes, estimate: LawEstimate) -> None:
    law = estimate.law
    hours = np.linspace(0.0, LONGEST, 200)
    for part in law.parts:
        sd = np.sqrt(part.variance(HOUR * hours))
        ax.plot(hours, sd, color=COLOURS[part.name], lw=0.9, label=part.name)
    for truth, look, label in _truths(law, "all"):
        ax.plot(
            hours, np.sqrt(law.variance(HOUR * hours, truth)), color=style.INK, lw=1.1, ls=look, label=label
        )
    _draw_rows(ax, estimate, ERROR, 1.0)
    ax.set_xlabel("lead [h]")
    ax.set_ylabel("sd of one component [m/s]")
    _finish(ax)


def _draw_displacements(ax: Axes, estimate: LawEstimate) -> None:
    hours = np.linspace(0.0, LONGEST, 37)[1:]
    for truth, look, label in _truths(estimate.law, "law"):
        sd = [displacement_sd(estimate.law, hour, truth) / KM for hour in hours]
        ax.plot(hours, sd, color=style.INK, lw=1.0, ls=look, label=label)
    _draw_rows(ax, estimate, DISPLACEMENT, KM)
    ax.set_xlabel("time [h]")
    ax.set_ylabel("sd of one component [km]")
    _finish(ax)


def _truths(law: LawOfParts, label: str) -> Iterator[tuple[str, Any, str]]:
    """Truth, dashes and label of the law, and of the law that newer runs show."""
    yield LawOfParts.OBSERVED, "-", label
    if law.part(LASTING) is not None:
        yield LawOfParts.OWN, (0, (4, 2)), f"{label}, without lasting"


def displacement_sd(law: LawOfParts, hours: float, truth: str) -> float:
    """Standard deviation [m] of the integral of the error over the first ``hours``, at one place."""
    at = np.linspace(0.0, hours * HOUR, 49)
    w = np.full(len(at), at[1])
    w[[0, -1]] /= 2
    total = 0.0
    for part in law.seen_by(truth):
        sd, clock = np.sqrt(part.variance(at)), part.clock(at)
        total += float((w * sd) @ np.exp(-np.abs(clock[:, None] - clock)) @ (w * sd))
    return float(np.sqrt(total))


def _draw_rows(ax: Axes, estimate: LawEstimate, kind: str, unit: float) -> None:
    rows = [row for row in estimate.rows if row.kind == kind and row.hours <= LONGEST]
    at, rms = [row.hours for row in rows], [row.rms / unit for row in rows]
    ax.plot(at, rms, "o", ms=3.4, mfc="white", mec=style.INK, mew=0.8, label="data", clip_on=False, zorder=5)


def _draw_tails(ax: Axes, estimate: LawEstimate) -> None:
    row = min(estimate.rows, key=lambda row: (row.kind != ERROR, abs(row.hours - 24)))
    z = np.linspace(0.0, 8.0, 300)
    values = np.sort(np.abs(row.z))
    beyond = 1.0 - np.arange(len(values)) / len(values)
    ax.plot(values, beyond, color=style.VERMILLION, lw=1.1, label=f"data, {row.hours:g} h")
    ax.plot(z, _beyond(z, row), color=style.INK, lw=1.0, label=f"law, s = {row.tail:.2f}")
    ax.plot(z, 1.0 - coverage(z, 0.0), color=style.STONE, lw=0.9, ls=(0, (4, 2)), label="normal")
    ax.axhline(estimate.law.floor, color=style.MIST, lw=0.7)
    ax.text(
        7.9,
        estimate.law.floor * 1.15,
        f"floor 1/{estimate.law.situations + 1}",
        ha="right",
        color=style.STONE,
    )
    ax.set_yscale("log")
    ax.set_xlim(0.0, 8.0)
    ax.set_ylim(1e-4, 1.0)
    ax.set_xlabel("error / sd [1]")
    ax.set_ylabel("share of errors beyond [1]")
    ax.legend(loc="upper right", handlelength=1.8, borderaxespad=0.2, labelspacing=0.3)


def _beyond(z: FloatArray, row: CheckRow) -> FloatArray:
    return np.maximum(1.0 - coverage(z, row.tail), 1e-9)


def _finish(ax: Axes) -> None:
    ax.set_xlim(0.0, LONGEST)
    ax.set_xticks(np.arange(0.0, LONGEST + 1, 12))
    ax.set_ylim(0.0, HEADROOM * ax.get_ylim()[1])
    ax.legend(loc="upper left", handlelength=1.8, borderaxespad=0.2, labelspacing=0.3)
