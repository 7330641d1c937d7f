"""Do the errors of forecasts depend on the season? The packaged laws by season, with situations as trials.

    python benchmarks/law_by_season.py WINDS

WINDS as for ``packaged_laws.py``. For errors at 24 to 72 h of lead and displacements of 12 to 48 h: rms z of
each season under the law of the whole year, with 95 % intervals by a bootstrap over situations, and whether a
factor for the season would help: by turns one situation is left out, the factor is the rms z of the other
situations of its season, and the mean negative log likelihood of the left one (lognormal scale) with and
without the factor are compared.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from packaged_laws import SOURCES
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl_apps.wind_errors.law_check import CheckRow, check_rows
from pareto_ltl_apps.wind_errors.point_forecasts import Verified, verified
from pareto_ltl_apps.wind_errors.point_tables import read_point_table
from pareto_ltl_apps.wind_errors.scale_mixture import log_density
from wind_laws.law_of_parts import LawOfParts

SEASONS = ("Dec to Feb", "Mar to May", "Jun to Aug", "Sep to Nov")
DRAWS, SEED = 2000, 0


def season_of(found: Verified, situations: FloatArray) -> FloatArray:
    """The season (0 to 3) of each situation."""
    months = found.runs.astype("datetime64[s]").astype("datetime64[M]").astype(int) % 12 + 1
    first = {s: int(months[np.argmax(found.situation == s)]) for s in situations.tolist()}
    return np.array([first[s] % 12 // 3 for s in situations.tolist()])


def sums(row: CheckRow, situations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sum of z² and number of values of each situation."""
    at = np.searchsorted(situations, row.situation)
    square = np.bincount(at, row.z.ravel() ** 2, len(situations))
    return square, np.bincount(at, minlength=len(situations)).astype(float)


def lines(name: str, found: Verified, law: LawOfParts, kind: str, hours: tuple[float, ...]) -> list[str]:
    """One line a season, and the gain of a factor."""
    rows = [row.with_tail(law) for row in check_rows(found, law) if row.kind == kind and row.hours in hours]
    situations = np.unique(np.concatenate([row.situation for row in rows]))
    season = season_of(found, situations)
    square, count = (
        np.sum(each, axis=0) for each in zip(*(sums(row, situations) for row in rows), strict=True)
    )
    told, rng = [], np.random.default_rng(SEED)
    for k, text in enumerate(SEASONS):
        own = np.flatnonzero((season == k) & (count > 0))
        if not len(own):
            continue
        drawn = rng.choice(own, (DRAWS, len(own)))
        spread = np.sqrt(square[drawn].sum(axis=1) / count[drawn].sum(axis=1))
        low, high = np.quantile(spread, [0.025, 0.975])
        rms = np.sqrt(square[own].sum() / count[own].sum())
        told.append(f"{text} {rms:.2f} ({low:.2f} to {high:.2f}), n = {len(own)}")
    gains = np.array([gain(rows, situations, season, square, count, k) for k in np.flatnonzero(count)])
    drawn = rng.choice(gains, (DRAWS, len(gains))).mean(axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    told.append(f"gain of a factor {gains.mean():+.4f} ({low:+.4f} to {high:+.4f})")
    return [f"{name}, {kind} {hours[0]:g} to {hours[-1]:g} h: {'; '.join(told)}"]


def gain(
    rows: list[CheckRow], situations: FloatArray, season: FloatArray, square: FloatArray, count: FloatArray,
    left: int,
) -> float:  # fmt: skip
    """Log likelihood of a value of the situation ``left`` with the factor of its season, less without it."""
    others = (season == season[left]) & (np.arange(len(season)) != left)
    if not count[others].sum():
        return 0.0
    factor = float(np.sqrt(square[others].sum() / count[others].sum()))
    total, number = 0.0, 0
    for row in rows:
        z = row.z[row.situation == situations[left]].ravel()
        plain, scaled = log_density(z, np.array(row.tail)), log_density(z / factor, np.array(row.tail))
        total += float((scaled - np.log(factor) - plain).sum())
        number += len(z)
    return total / max(number, 1)


def main() -> None:
    """Print the lines of all tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    for name, (file, _) in SOURCES.items():
        found, law = verified(read_point_table(folder / file)), law_of_parts_named(name)
        print(*lines(name, found, law, "error", (24.0, 36.0, 48.0, 60.0, 72.0)), sep="\n", flush=True)
        print(*lines(name, found, law, "displacement", (12.0, 24.0, 48.0)), sep="\n", flush=True)


if __name__ == "__main__":
    main()
