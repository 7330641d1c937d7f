"""The error of analyses, estimated from station reports of the same times.

The difference d = report - analysis at a station has two parts: the error of the analysis at the scales of
its grid, which near stations have in common, and the noise of the station (instrument, surroundings, gusts)::

    e²(0) = mean of d_i d_j over pairs of stations nearer than NEAR
    station noise² = mean of d_i² - e²(0)

Both are for one component, as means over the two. If near stations have a common error for another reason,
for example a valley, it is counted as error of the analysis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.matched_fields import EARTH_RADIUS, Resampling
from pareto_ltl.wind.readings import Readings, iso, on_sphere
from pareto_ltl.wind.snapshots import Snapshot

NEAR = 60_000.0  # [m], half the spacing of a one-degree grid
FEWEST_TIMES = 5
FEWEST_PAIRS = 20  # of near stations, at each time
SAME_TIME = 1.0  # [s]


def analysis_error(
    snapshots: Sequence[Snapshot], stations: Readings, draws: Resampling
) -> dict[str, float] | str:
    """The error of the analyses among ``snapshots``, as it is written to a file; if unknown, a text why.

    ``sd``, ``sd_low``, ``sd_high``: e(0) of one component and its interval [m/s]; ``station_noise``: standard
    deviation of the noise of a station [m/s]; ``times``, ``reports``, ``pairs``: numbers of times, of reports
    and of pairs of near stations that were used.
    """
    analyses = sorted((snap for snap in snapshots if snap.lead == 0), key=lambda snap: snap.time)
    rows = []
    for snap in analyses:
        k = int(np.argmin(np.abs(stations.times - snap.time)))
        if abs(stations.times[k] - snap.time) <= SAME_TIME:
            rows.append((snap.time, *_moments(snap, stations.points[k], stations.winds[k])))
    if not rows:
        return (
            f"the data do not suffice: station reports ({_period(stations.times)}) and analyses "
            f"({_period(np.array([snap.time for snap in analyses]))}) have no time in common"
        )
    table = np.array([row for row in rows if row[4] >= FEWEST_PAIRS])
    if len(table) < FEWEST_TIMES:
        return (
            f"the data do not suffice: {len(table)} times have {FEWEST_PAIRS} pairs of stations within "
            f"{NEAR / 1e3:g} km in the area, expected at least {FEWEST_TIMES}"
        )
    times, square, product, reports, pairs = table.T
    error = draws.estimate(times, product, ratio=False).root
    noise = float(np.sqrt(max(square.mean() - product.mean(), 0.0)))
    sd = {"sd": error.value, "sd_low": error.low, "sd_high": error.high}
    counts = {"times": len(table), "reports": int(reports.sum()), "pairs": int(pairs.sum())}
    return sd | {"station_noise": noise} | counts


def _moments(snap: Snapshot, places: FloatArray, winds: FloatArray) -> tuple[float, float, int, int]:
    """Mean square of the differences [m²/s²], mean product of near ones [m²/s²], and the number of each."""
    from scipy.interpolate import LinearNDInterpolator

    here = np.asarray(LinearNDInterpolator(snap.points, snap.winds)(places), float)
    inside = np.isfinite(here).all(axis=1)
    difference = winds[inside] - here[inside]
    sphere = on_sphere(places[inside])
    near = sphere @ sphere.T >= np.cos(NEAR / EARTH_RADIUS)
    first, second = np.nonzero(np.triu(near, 1))
    if not len(first):
        return 0.0, 0.0, len(difference), 0
    products = (difference[first] * difference[second]).sum(axis=1) / 2
    square = (difference**2).sum(axis=1) / 2
    return float(square.mean()), float(products.mean()), len(difference), len(first)


def _period(times: FloatArray) -> str:
    return f"{iso(float(times.min()))} to {iso(float(times.max()))}"
