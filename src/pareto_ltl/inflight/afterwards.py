"""What watched flights say about the wind law, from their journals: where the truth was, and ranks of fixes.

A place that is r standard deviations from the estimate has the rank P = 1 - exp(-r²/2), which is uniform in
[0, 1] if the law is right. Ranks of fixes that were not used count as well: they are how a wrong law shows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.exports.ellipses import ellipse_scale
from pareto_ltl.inflight.journal import NAME, read_journal
from pareto_ltl.inflight.telemetry import read_places
from pareto_ltl.inflight.watch import ELLIPSE, Event
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.counts import clopper_pearson
from pareto_ltl.support.errors import DataError
from pareto_ltl.world.projection import to_plane
from pareto_ltl.world.scene import Scene

SHARES = (0.5, 0.9, 0.99)
BINS = 10


def true_distances(events: Iterable[Event], times: FloatArray, x: FloatArray) -> FloatArray:
    """Distances of the truth ``x`` (n, 2) [m] at ``times`` (n,) [s] from each estimate, in its sd.

    Estimates outside of the times are left out.
    """
    found = []
    for event in events:
        if event["event"] != "status" or not times[0] <= event["time"] <= times[-1]:
            continue
        true = np.array([np.interp(event["time"], times, x[:, k]) for k in range(2)])
        c, s = math.cos(event["angle"]), math.sin(event["angle"])
        along = np.array([[c, s], [-s, c]]) @ (true - [event["x"], event["y"]])
        axes = np.maximum(np.array([event["major"], event["minor"]]) / ELLIPSE, 1e-3)
        found.append(float(np.hypot(*(along / axes))))
    return np.array(found)


def truth_summary(folder: Path, truth: Path, scene: Scene) -> dict[str, Any]:
    """How often the ellipses of 50, 90 and 99 % held the truth of a table ``time,lat,lon`` (or ``x,y``).

    Estimates of one flight are not independent: the interval of many flights is wider than it looks.

    Raises
    ------
    DataError
        If the table cannot be used, or no estimate has its time.
    """
    times, places = read_places(truth, scene.time_zero, on_earth=scene.crs is not None)
    x = places if scene.crs is None else to_plane(scene.crs, places[:, 1], places[:, 0])
    far = true_distances(read_journal(folder / NAME), times, x)
    if not len(far):
        raise DataError(f"{truth}: no estimate lies within its times, {times[0]:g} to {times[-1]:g} s")
    inside = {f"{100 * p:.0f}": int((far <= ellipse_scale(p)).sum()) for p in SHARES}
    return {"estimates": len(far), "inside": inside, "largest_sd": float(far.max())}


def fix_ranks(folders: Sequence[Path]) -> dict[str, Any]:
    """Ranks of the position fixes of watched flights, in ``BINS`` equal parts of [0, 1].

    Raises
    ------
    DataError
        If a journal cannot be read.
    """
    events = chain.from_iterable(read_journal(folder / NAME) for folder in folders)
    far = [event["distance"] for event in events if event["event"] == "fix"]
    ranks = 1.0 - np.exp(-0.5 * np.array(far, float) ** 2)
    counts = np.histogram(ranks, bins=BINS, range=(0.0, 1.0))[0].tolist()
    return {
        "fixes": len(far), "counts": counts,
        "intervals": [clopper_pearson(count, len(far)) for count in counts] if far else [],
    }  # fmt: skip
