"""The packaged law of currents, from one sequence of hourly surface currents of an ocean model.

    python benchmarks/packaged_currents.py FILE [--write]

FILE is ``norkyst_currents_2015-11-16.npz``: ``u_int16``, ``v_int16`` (hour, Y, X), ``scale``, ``missing``, X
and Y [m]; where it comes from stands in ``ORIGIN``.

*Held currents*: D(τ) is the mean square change in a time τ, with its tide: it is not monotone. From 30 h on,
it is the mean from 30 to 48 h.

*Forecasts*: no table of forecasts of currents with leads is at hand. Tidal lines come first: at each node a
mean, M2 and a day cycle are fitted to the 43 h up to an hour t; ahead of t the current is these lines and the
difference that remains at t. The error of that after a time L stands for the error of a forecast of lead L:
an ocean model that knows only the tide would have it. The variance does not fall with the lead. Its
two parts differ in length (fitted to the correlations over distance); their memory is the one whose
displacements after 6, 12 and 24 h are closest to the measured ones; the tails are from the kurtosis.

The sequence is one situation: n = 1, and no rate below 1/2 can be claimed.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from careful_io.files import write_json
from careful_io.times import HOUR
from packaged_laws import rounded
from pareto_ltl.support.arrays import FloatArray
from wind_laws.documents import PARTS_FOLDER
from wind_laws.error_law import LOCAL, SLOW, LawPart, TailScale
from wind_laws.law_of_parts import OWN, LawOfParts

LINES = (12.4206, 23.9345)  # periods of M2 and K1 [h]
FITTED = 43  # hours to which the lines are fitted, almost two days
LEADS = np.array([0, 1, 3, 6, 9, 12, 18, 24])  # [h]
LAGS = np.array([1, 3, 6, 9, 12, 15, 18, 21, 24, 30, 36, 42, 48])  # [h]
SETTLED = 30  # [h] from here on the change does not grow: the mean of its later lags
SPANS = (6, 12, 24)  # of displacements [h]
DISTANCES = 1e3 * np.array([1.0, 4, 8, 12, 20, 30, 50, 80, 120, 200])  # edges [m]
NODES, SEED = 1200, 0  # drawn for correlations over distance
ORIGIN = (
    "NorKyst-800 of MET Norway (CC BY), hourly surface currents of 67 h from 16 November 2015 off western "
    "Norway, every third node (sdist of opendrift 1.14.12): one situation. Held currents: their mean square "
    "change. Forecasts: the error of M2 and a day cycle, fitted to 43 h, with the last difference held, "
    "which stands for a model that knows only the tide; no forecasts of currents with leads are in "
    "it, and no error that lasts"
)


class Currents(NamedTuple):
    """Currents (T, N, 2) [m/s] at hours, at nodes (N, 2) [m]."""

    values: FloatArray
    nodes: FloatArray


def read(file: Path) -> Currents:
    """The currents at the nodes that have one at every hour."""
    with np.load(file, allow_pickle=False) as data:
        u, v = (data[name] for name in ("u_int16", "v_int16"))
        wet = ((u != data["missing"]) & (v != data["missing"])).all(axis=0)
        rows, columns = np.nonzero(wet)
        values = float(data["scale"]) * np.stack([u[:, wet], v[:, wet]], axis=-1).astype(float)
        return Currents(values, np.stack([data["X"][columns], data["Y"][rows]], axis=1).astype(float))


def lines_at(hours: FloatArray) -> FloatArray:
    """A mean, and cosine and sine of each line, (T, 1 + 2 lines)."""
    angles = 2 * np.pi * hours[:, None] / np.array(LINES)
    return np.concatenate([np.ones((len(hours), 1)), np.cos(angles), np.sin(angles)], axis=1)


def errors(values: FloatArray) -> list[FloatArray]:
    """Errors (leads, N, 2) [m/s] from each hour with ``FITTED`` hours before it on, as far as hours go."""
    hours, found = np.arange(len(values), dtype=float), []
    for now in range(FITTED - 1, len(values) - 1):
        past, ahead = hours[now - FITTED + 1 : now + 1], hours[now : now + LEADS[-1] + 1]
        flat = values.reshape(len(values), -1)
        weights = np.linalg.lstsq(lines_at(past), flat[now - FITTED + 1 : now + 1], rcond=None)[0]
        lines = lines_at(ahead) @ weights
        error = flat[now : now + len(ahead)] - lines - (flat[now] - lines[0])
        found.append(error.reshape(len(ahead), *values.shape[1:]))
    return found


def mean_square(found: list[FloatArray], lead: int) -> float:
    """Mean square error [m²/s²] after ``lead`` hours."""
    return float(np.mean([(each[lead] ** 2).mean() for each in found if len(each) > lead]))


def matern(r: FloatArray) -> FloatArray:
    """Matern-3/2 at distances in lengths."""
    return np.asarray((1 + np.sqrt(3) * r) * np.exp(-np.sqrt(3) * r), float)


def over_distance(fields: FloatArray, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean distance [m] and correlation of ``fields`` (F, N, 2) in each range of ``DISTANCES``."""
    some = np.random.default_rng(SEED).choice(len(nodes), NODES, replace=False)
    apart = np.hypot(*(nodes[some][:, None] - nodes[some]).transpose(2, 0, 1))
    drawn = fields[:, some].transpose(0, 2, 1).reshape(-1, NODES)
    products = drawn.T @ drawn / len(drawn)
    scale = float(np.mean(np.diag(products)))
    inside = [(apart >= low) & (apart < high) for low, high in pairwise(DISTANCES)]
    distance, kept = ([float(np.mean(a[w])) for w in inside] for a in (apart, products / scale))
    return np.array(distance), np.array(kept)


def two_lengths(distance: FloatArray, kept: FloatArray) -> tuple[float, float, float]:
    """Share and length of the wide part, and length of the local one, by least squares over a grid."""

    def misfit(w: float, wide: float, near: float) -> float:
        return float(((w * matern(distance / wide) + (1 - w) * matern(distance / near) - kept) ** 2).sum())

    tried = [
        (misfit(w, wide, near), w, wide, near)
        for w in np.linspace(0.1, 0.9, 41)
        for wide in 1e3 * np.geomspace(40, 400, 31)
        for near in 1e3 * np.geomspace(2, 40, 31)
    ]  # fmt: skip
    _, share, wide, near = min(tried)
    return float(share), float(wide), float(near)


def displacement_variances(found: list[FloatArray]) -> FloatArray:
    """Variance [m²] of the integral of the error over each of ``SPANS``."""
    return np.array(
        [
            np.mean(
                [(np.trapezoid(e[: span + 1], dx=HOUR, axis=0) ** 2).mean() for e in found if len(e) > span]
            )
            for span in SPANS
        ]
    )


def of_law(sd: FloatArray, memory: float) -> FloatArray:
    """The same of errors with ``sd`` (leads,) [m/s] whose correlation falls to 1/e in ``memory`` [h]."""
    hours = np.arange(SPANS[-1] + 1.0)
    at = np.sqrt(np.interp(hours, LEADS, sd**2))
    cov = np.outer(at, at) * np.exp(-np.abs(hours[:, None] - hours) / memory)
    weights = [np.where(hours <= span, HOUR, 0.0) for span in SPANS]
    for w, span in zip(weights, SPANS, strict=True):
        w[[0, span]] /= 2
    return np.array([w @ cov @ w for w in weights])


def law_of(currents: Currents) -> LawOfParts:
    """The law ``currents``."""
    values = currents.values
    found = errors(values)
    squares = np.maximum.accumulate([0.0, *(mean_square(found, int(lead)) for lead in LEADS[1:])])
    measured = displacement_variances(found)
    memories = np.geomspace(1.0, 48.0, 400)
    misfit = [np.abs(np.log(of_law(np.sqrt(squares), m) / measured)).mean() for m in memories]
    memory = float(memories[int(np.argmin(misfit))])
    late = np.concatenate([each[12:24:3] for each in found if len(each) > 12])
    share, wide, near = two_lengths(*over_distance(late, currents.nodes))
    kurtosis = float((late**4).mean() / (late**2).mean() ** 2)
    spread = float(np.sqrt(np.log(max(kurtosis, 3.0) / 3.0) / 4.0))
    change = np.array([np.sqrt(((values[lag:] - values[:-lag]) ** 2).mean()) for lag in LAGS])
    change[LAGS >= SETTLED] = np.sqrt(np.mean(change[LAGS >= SETTLED] ** 2))
    distance, kept = over_distance(values[12:] - values[:-12], currents.nodes)
    lengths = 1e3 * np.geomspace(5, 200, 200)
    length = float(
        lengths[int(np.argmin([((matern(distance / each) - kept) ** 2).sum() for each in lengths]))]
    )
    leads, moment = HOUR * LEADS.astype(float), np.full(len(LEADS), spread)
    parts = tuple(
        LawPart(name, leads, np.sqrt(part * squares), np.full(len(leads), HOUR * memory), at)
        for name, part, at in ((SLOW, share, wide), (LOCAL, 1 - share, near))
    )
    return LawOfParts(
        "currents", "0m depth", float(np.sqrt(np.mean(values.var(axis=1)))), parts,
        TailScale(0.0, leads, moment, HOUR * memory), 1, OWN, ORIGIN, HOUR * LAGS.astype(float), change,
        length,
    )  # fmt: skip


def main() -> None:
    """Estimate the law; print it, or write it into the package."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    currents = read(options.file)
    law = law_of(currents)
    document = rounded(law.document())
    if options.write:
        write_json(PARTS_FOLDER / "currents.json", document)
    for key, value in document.items():
        print(key, value)
    found = np.sqrt(displacement_variances(errors(currents.values))) / 1e3
    print("displacements after", SPANS, "h [km]: measured", np.round(found, 2))
    sd, memory = np.sqrt(law.variance(HOUR * LEADS.astype(float))), law.parts[0].memory[0] / HOUR
    print("of the law", np.round(np.sqrt(of_law(sd, memory)) / 1e3, 2))


if __name__ == "__main__":
    main()
