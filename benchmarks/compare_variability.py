"""Held wind fields against later ones, with the change D(tau) of the law and scaled to the fields at hand.

    python benchmarks/compare_variability.py "FILES" [--globe]

FILES is a pattern of GRIB files of analyses and forecasts on one grid. At each analysis after the first of a
window, on many maps of 600 km, over the United States or ``--globe``, the fields up to then are read as a run
does, and the last is held for up to 24 h. Per map and lag, with z the change over its standard deviation:
rms z, mean |log rms z| (0 if every map is right), mean negative log likelihood of a value without its
constant. The factor is from earlier analyses only.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.times import HOUR, iso
from pareto_ltl.wind.named_laws import law_named
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.sources import read_readings
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

STATES = itertools.product(range(33, 48, 5), range(-118, -76, 7))
GLOBE = itertools.product((-50, -35, -20, 20, 35, 50, 62), range(-180, 180, 24))
LONGEST, GAP = 24 * HOUR, 12 * HOUR
BOUNDS = np.array([[-3e5, -3e5], [3e5, 3e5]])


def part(readings: Readings, first: int, end: int) -> Readings:
    """The times ``first`` to ``end`` - 1 only."""
    cut = {name: getattr(readings, name)[first:end] for name in ("times", "leads", "points", "winds")}
    return replace(readings, **cut)


def windows(times: FloatArray) -> Iterator[tuple[int, int]]:
    """First and last + 1 of the times between gaps."""
    edges = [0, *(np.flatnonzero(np.diff(times) > GAP) + 1), len(times)]
    return itertools.pairwise(edges)


def judged(cfg: WindConfig, readings: Readings, scene: Scene, now: int) -> Iterator[tuple[float, ...]]:
    """Factor, z² of the law, z² with the factor and log of the ratio of variances, at each later time."""
    departs = replace(scene, time_zero=iso(readings.times[now]))
    law = place_readings(cfg, part(readings, 0, now + 1), departs).error
    later = place_readings(replace(cfg, hold_last=False), readings, departs)
    plain = law_named("gfs")
    inside = (np.abs(later.points[0]) <= BOUNDS[1]).all(axis=1)
    for k in np.flatnonzero((later.times > 0) & (later.times <= LONGEST)):
        square = ((later.winds[k] - later.winds[0])[inside] ** 2).mean()
        own = plain.forecast_variance(later.leads[k])
        before, after = (each.change_variance(later.times[k]) + own for each in (plain, law))
        yield law.variability.factor, square / before, square / after, np.log(after / before)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files")
    parser.add_argument("--globe", action="store_true")
    asked = parser.parse_args()
    cfg = WindConfig(source="grib", path=asked.files, hold_last=True, max_gap=6.0)
    readings, centres = read_readings(cfg), list(GLOBE if asked.globe else STATES)
    for first, end in windows(readings.times):
        own, rows = part(readings, first, end), []
        for lat, lon in centres:
            scene = Scene(BOUNDS, np.zeros(2), {}, (), projection.local_plane(lat, lon), None)
            for now in np.flatnonzero(own.leads == 0)[1:-1]:
                rows += list(judged(cfg, own, scene, int(now)))
        factor, before, after, log = np.array(rows).T
        print(f"{iso(own.times[0])}, {len(centres)} maps, {len(rows)} pairs of map and lag, factor "
              f"{np.quantile(factor, 0.05):.2f} to {np.quantile(factor, 0.95):.2f}")  # fmt: skip
        for name, z2, scale in (("law", before, np.zeros(len(log))), ("scaled", after, log)):
            off, loss = np.abs(np.log(z2) / 2).mean(), 0.5 * (z2 + scale).mean()
            print(f"  {name:7s} rms z {np.sqrt(z2.mean()):.2f}  |log rms z| {off:.3f}  NLL {loss:.3f}")


if __name__ == "__main__":
    main()
