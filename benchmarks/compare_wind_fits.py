"""Errors of wind fits at nodes that were not used in the fit: the comparison behind the default settings.

    python benchmarks/compare_wind_fits.py DIR [--readings 120] [--seeds 4]

DIR holds GRIB2 files of the 10 m wind on one grid, e.g. GFS analyses. Of the nodes inside the contiguous
United States ``--readings`` are fitted, chosen by farthest-point sampling from a random first one, and the
others judged: mean negative log predictive density of a value (NLPD), root mean square error, share within
90 % intervals, standard deviation of z-scores. ``--seeds`` repeats it with other first nodes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
import yaml

from flight_quantities import frames
from flight_quantities.sphere import on_sphere
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.observations import project_readings
from pareto_ltl.wind.records import WindObservations
from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart
from pareto_ltl_apps.formats.snapshots import latest_readings
from wind_laws import gp
from wind_laws.places import farthest_points

AREA = Path(__file__).parents[1] / "conf" / "ingest" / "conus.yaml"
KERNELS = ("matern32", "matern12", "rbf")


def fields(folder: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places on the unit sphere (N, 3), positions in a plane (N, 2) [m], winds (K, N, 2) [m/s]."""
    files = tuple(sorted(file for file in folder.iterdir() if file.is_file()))
    readings = latest_readings(*grib_snapshots_apart(files, 75.0))
    outline = shapely.Polygon(yaml.safe_load(AREA.read_text())["area"])
    inside = shapely.contains_xy(outline, readings.points[0])
    lonlat = readings.points[0][inside]
    crs = frames.local_plane(*lonlat.mean(axis=0)[::-1])
    winds = np.stack([w[inside] for w in readings.winds], axis=-1)  # (N, 2, K)
    places, turned = project_readings(crs, np.zeros(2), lonlat, winds)
    return on_sphere(lonlat), places, np.moveaxis(turned, 2, 0)


def fits(
    cfg: WindConfig, places: FloatArray, winds: FloatArray
) -> Iterator[tuple[str, list[gp.WindPosterior]]]:
    """Posteriors of all times together and of each time alone, with and without the variance factor."""
    count = len(winds)
    together = [
        gp.fit_posterior(cfg, WindObservations(np.arange(count) * 1.0, (places,) * count, tuple(winds), ""))
    ]
    alone = [gp.fit_posterior(cfg, WindObservations(np.zeros(1), (places,), (w,), "")) for w in winds]
    for name, found in (("each time alone", alone), ("common to all times", together)):
        yield name, [replace(fit, squares=np.ones_like(fit.squares)) for fit in found]
    yield "common, with variance factor", together


def judged(found: list[gp.WindPosterior], places: FloatArray, truth: FloatArray) -> FloatArray:
    """NLPD, root mean square error, coverage of 90 % intervals, standard deviation of z."""
    predicted = [fit.at(places) for fit in found]
    mean = np.concatenate([m for m, _ in predicted])
    sd = np.sqrt(
        np.concatenate([v + fit.gust_var[:, None] for (_, v), fit in zip(predicted, found, strict=True)])
    )
    z = (truth - mean) / sd
    nlpd = (0.5 * z**2 + np.log(sd) + 0.5 * np.log(2 * np.pi)).mean()
    return np.array([nlpd, np.sqrt(((truth - mean) ** 2).mean()), (np.abs(z) <= 1.6449).mean(), z.std()])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--readings", type=int, default=120)
    parser.add_argument("--seeds", type=int, default=4)
    asked = parser.parse_args()
    sphere, places, winds = fields(asked.folder)
    rows: dict[tuple[str, str], list[FloatArray]] = {}
    for seed in range(asked.seeds):
        first = int(np.random.default_rng(seed).integers(len(places)))
        kept = farthest_points(sphere, asked.readings, first)
        out = np.setdiff1d(np.arange(len(places)), kept)
        for kernel in KERNELS:
            for name, found in fits(WindConfig(kernel=kernel), places[kept], winds[:, kept]):
                rows.setdefault((kernel, name), []).append(judged(found, places[out], winds[:, out]))
    print(f"{asked.readings} of {len(places)} nodes fitted, {len(winds)} times, {asked.seeds} selections\n")
    print("| kernel | hyperparameters | NLPD | rms error [m/s] | within 90 % | sd of z |")
    print("|---|---|---|---|---|---|")
    for (kernel, name), found in rows.items():
        nlpd, rms, covered, sd = np.mean(found, axis=0)
        print(f"| {kernel} | {name} | {nlpd:.3f} | {rms:.3f} | {covered:.3f} | {sd:.3f} |")


if __name__ == "__main__":
    main()
