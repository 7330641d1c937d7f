"""The fronts of a default run, of the paper's method and of the widest search known, in one figure.

    python benchmarks/draw_fronts.py docs/images [--seeds 4]

All paths are judged by coherent flights that no search has used, with the border open, as in the paper, and
with the border as a wall.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.random import SeedSequence

from pareto_ltl.extend import simulate_flights
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.axes import scale_rate_axis
from search_best_known import KEPT, benchmark_run, paper_run

FLIGHTS = 4000
LOW = 1e-3  # of the axis of rates
LEFT, BOTTOM, WIDTH, TALL, GAP, TOP = 0.62, 0.45, 2.75, 1.75, 0.25, 0.42  # [in]
LOOKS = {
    "best known": {"color": style.INK, "lw": 1.0, "ls": "--"},
    "fidelity=full": {"color": style.BLUE, "lw": 0.9, "marker": "o", "ms": 2.4},
    "fidelity=paper": {"color": style.VERMILLION, "lw": 0.0, "marker": "s", "ms": 3.0, "mfc": "none"},
}


def full_front(name: str, border: str, seed: int) -> FloatArray:
    """Lengths [m] and failure rates of a default run."""
    front = benchmark_run(name, border, seed).front
    rows = zip(front.paths, front.rates, strict=True)
    return np.array([[path.objectives.length, rate.failure] for path, rate in rows])


def paper_front(name: str, border: str, seed: int) -> FloatArray:
    """Lengths [m] and failure rates of the paper's method; its paths are then flown in coherent winds."""
    run = benchmark_run(name, border, seed)
    problem, front = run.problem, paper_run(run).front
    rows = []
    for path in front.paths:
        flown = simulate_flights(problem, path.u, FLIGHTS, "coherent", SeedSequence(9), path.x)
        rows.append([path.objectives.length, float(flown.failed.mean())])
    return np.array(rows)


def draw(ax: Axes, name: str, border: str, seeds: int) -> None:
    """One mission with one border."""
    known = json.loads(KEPT.read_text())[f"{name}_{border}"]
    best = np.array([[row["length_m"], row["failure"]] for row in known])
    ends = [best[0, 0], best[-1, 0]]
    drawn = [("best known", best)]
    for seed in range(seeds):
        drawn += [("fidelity=full", full_front(name, border, seed))]
        drawn += [("fidelity=paper", paper_front(name, border, seed))]
    for label, found in drawn:
        rows = found[np.argsort(found[:, 0])]
        ax.plot(rows[:, 0] / 1e3, np.maximum(rows[:, 1], LOW), **LOOKS[label])  # type: ignore[arg-type]
        ends += [rows[0, 0], rows[-1, 0]]
    scale_rate_axis(ax, "y", LOW, 1.0, hidden=False)
    ax.set_xlim(min(ends) / 1e3 - 30.0, max(ends) / 1e3 + 30.0)
    ax.set_title(f"{name}, border {'open' if border == 'open' else 'a wall'}", loc="left")
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Plan, fly, and write ``fronts.png``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=4)
    asked = parser.parse_args()
    with style.report_style():
        figure = style.blank_figure(LEFT + 2 * WIDTH + GAP + 0.1, BOTTOM + 2 * TALL + TOP + 0.5)
        for row, border in enumerate(("wall", "open")):
            for column, name in enumerate(("phi1", "phi2")):
                place = LEFT + column * (WIDTH + GAP), BOTTOM + row * (TALL + TOP)
                ax = style.axes_at(figure, *place, WIDTH, TALL)
                draw(ax, name, border, asked.seeds)
                if row == 0:
                    ax.set_xlabel("path length [km]")
                if column == 0:
                    ax.set_ylabel("failed flights, coherent winds [%]")
                else:
                    ax.tick_params(labelleft=False)
        keys = [Line2D([], [], label=label, **look) for label, look in LOOKS.items()]  # type: ignore[arg-type]
        figure.legend(handles=keys, loc="upper center", ncols=3)
        style.save_figure(figure, asked.folder, "fronts", 200, ("png",))


if __name__ == "__main__":
    main()
