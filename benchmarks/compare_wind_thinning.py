"""Accuracy of a wind fit against its number of readings: winds near a map are predicted from others.

    python benchmarks/compare_wind_thinning.py SOURCE FILE [--level 10m]

SOURCE is ``grib``, ``netcdf`` or ``stations``. Of the readings near the map of phi1, at the time that has
most of them, a share ``WITHHELD`` of those in the map is withheld; of the others 75, 150, ... are chosen and
fitted: spread evenly, and as a run does (``wind.max_points``), those on and beside the map first. For each
number, over ``SPLITS`` such choices: mean negative log
predictive density of a value (NLPD), root mean square error, share within 90 % intervals, CPU seconds.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray, IntArray
from pareto_ltl.wind.observations import FIT_RADIUS, project_readings
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.wind.sources import read_readings
from wind_laws.gp import fit_posterior
from wind_laws.places import thinned

BOUNDS = np.array([[-5e5, -5e5], [5e5, 5e5]])
COUNTS = (75, 150, 300, 600, 1000, 2000, 5000)
WITHHELD, SPLITS = 0.25, 6


def near_map(cfg: WindConfig) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) [m] and winds (n, 2) [m/s] around the map at the time with the most of them."""
    readings, crs = read_readings(cfg), frames.local_plane(37.0, -92.0)
    found = []
    for points, winds in zip(readings.points, readings.winds, strict=True):
        places, turned = project_readings(crs, np.zeros(2), points, winds[:, :, None])
        gap = np.linalg.norm(np.maximum(0.0, np.maximum(BOUNDS[0] - places, places - BOUNDS[1])), axis=1)
        found.append((places[gap <= FIT_RADIUS], turned[gap <= FIT_RADIUS, :, 0]))
    return max(found, key=lambda pair: len(pair[0]))


def judged(places: FloatArray, winds: FloatArray, own: IntArray, out: IntArray) -> FloatArray:
    """NLPD, rms error, coverage and CPU seconds of a fit to ``own`` readings, at the withheld ``out``."""
    begin = time.process_time()
    seen = WindObservations(np.zeros(1), (places[own],), (winds[own],), "")
    fit = fit_posterior(WindConfig(), seen, BOUNDS)
    spent = time.process_time() - begin
    mean, var = fit.at(places[out])
    sd, off = np.sqrt(var[0] + fit.gust_var[0]), winds[out] - mean[0]
    z = off / sd
    nlpd = (0.5 * z**2 + np.log(sd) + 0.5 * np.log(2 * np.pi)).mean()
    return np.array([nlpd, np.sqrt((off**2).mean()), np.mean(np.abs(z) <= 1.6449), spent])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source")
    parser.add_argument("file")
    parser.add_argument("--level", default="10m")
    asked = parser.parse_args()
    places, winds = near_map(WindConfig(source=asked.source, path=asked.file, level=asked.level))
    inside = np.flatnonzero(((places >= BOUNDS[0]) & (places <= BOUNDS[1])).all(axis=1))
    print(f"{len(places)} readings near the map, {len(inside)} in it, {WITHHELD:.0%} of these kept out")
    off = np.linalg.norm(np.maximum(0.0, np.maximum(BOUNDS[0] - places, places - BOUNDS[1])), axis=1)
    ways = {"evenly": np.ones(len(places), bool), "map first": off <= WindConfig().padding}
    rows: dict[tuple[int, str], list[FloatArray]] = {}
    for seed in range(SPLITS):
        out = np.random.default_rng(seed).choice(inside, round(WITHHELD * len(inside)), replace=False)
        kept = np.setdiff1d(np.arange(len(places)), out)
        for count in {min(c, len(kept)) for c in COUNTS}:
            for way, beside in ways.items():
                own = kept[thinned(places[kept], beside[kept], np.zeros(2), count)]
                rows.setdefault((count, way), []).append(judged(places, winds, own, out))
    for (count, way), found in sorted(rows.items()):
        nlpd, rms, covered, spent = np.mean(found, axis=0)
        print(f"{count:5d} {way:9s}  NLPD {nlpd:.3f}  rms {rms:.2f} m/s  90 % {covered:.3f}  {spent:.1f} s")


if __name__ == "__main__":
    main()
