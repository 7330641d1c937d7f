"""Promises of a finished forecast test against what came: diagrams without bins, and two tests compared.

They are read from ``forecast_test.csv`` of one or two results directories. Diagrams and tests come from
forecast verification: isotonic reliability (Dimitriadis, Gneiting and Jordan 2021,
doi:10.1073/pnas.2016191118), Murphy diagrams of elementary scores (Ehm et al. 2016, doi:10.1111/rssb.12154)
and the test of Diebold and Mariano with the variance of Hering and Genton (2011,
doi:10.1198/TECH.2011.10136). The last two are computed by the package ``scores`` (extra ``scores``).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from careful_io.messages import shown_value
from careful_io.reading import Advice, read_text
from pareto_ltl import Settings
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.studies import calibration
from pareto_ltl_apps.view.records import Compared, PromiseDiagrams

if TYPE_CHECKING:
    import xarray

TABLE = "forecast_test.csv"
MISSION = ("mission", "formula", "departure", "latitude", "longitude")  # columns that name a mission
COLUMNS = (*MISSION, "kind", "fidelity", "situation", "failure")
THETAS = (np.arange(200) + 0.5) / 200  # thresholds of Murphy diagrams, between the ends
LEAST = 10  # missions of a comparison: fewer say nothing about their correlation
DRAWS = 500  # of a consistency band
ADVICE = Advice("give the results directory of a forecast test", "make the forecast test again")


@dataclass(frozen=True, slots=True)
class Promises:
    """What the chosen plans of a forecast test promised and what came of them, in order of departure.

    Attributes
    ----------
    name : str
        In tables and figures.
    fidelity : str
        The preset of planning; promises are rates under its wind law.
    missions : (N,) tuple of tuple of str
        The columns ``MISSION`` of each plan.
    situations : (N,) tuple of str
        The period of fields in which each mission departs.
    promised, realised : (N,) float
        Promised failure rate, and share of the flights that failed in the later fields.
    """

    name: str
    fidelity: str
    missions: tuple[tuple[str, ...], ...]
    situations: tuple[str, ...]
    promised: FloatArray
    realised: FloatArray

    @property
    def departures(self) -> tuple[str, ...]:
        """The departure of each mission."""
        return tuple(mission[MISSION.index("departure")] for mission in self.missions)

    def brier(self) -> FloatArray:
        """The Brier score of each promise, (N,)."""
        return calibration.brier_scores(self.promised, self.realised)

    def only(self, rows: Sequence[int]) -> Promises:
        """The plans in ``rows``."""
        kept = np.array(rows, int)
        return replace(
            self, missions=tuple(self.missions[k] for k in rows), promised=self.promised[kept],
            situations=tuple(self.situations[k] for k in rows), realised=self.realised[kept],
        )  # fmt: skip


# --- reading ---------------------------------------------------------------------------------


def read_promises(directory: Path, fidelity: str | None = None, name: str | None = None) -> Promises:
    """The chosen plans of the forecast test in ``directory``, planned with ``fidelity`` (the first if None).

    Raises
    ------
    DataError
        If the directory holds no such plans, or its table is damaged.
    """
    path = directory / TABLE
    chosen = [
        row
        for row in _rows(path)
        if row["kind"] == calibration.CHOSEN and row["fidelity"] in Settings.PRESETS
    ]
    there = list(dict.fromkeys(row["fidelity"] for row in chosen))
    wanted = fidelity or next(iter(there), "full")
    if wanted not in there:
        held = f"plans of {', '.join(there)}" if there else "none"
        raise DataError(f"{path}: has no chosen plans with fidelity {shown_value(wanted)}; it has {held}")
    column = f"simulated_{Settings.preset(wanted).law}"
    mine = sorted((row for row in chosen if row["fidelity"] == wanted), key=lambda row: row["departure"])
    pairs = [(_rate(path, row, column), _rate(path, row, "failure")) for row in mine]
    return Promises(
        name or directory.resolve().name,
        wanted,
        tuple(tuple(row[key] for key in MISSION) for row in mine),
        tuple(row["situation"] for row in mine),
        *(np.array(values, float) for values in zip(*pairs, strict=True)),
    )


def _rows(path: Path) -> list[dict[str, str]]:
    """The rows of the table, each with all of ``COLUMNS``."""
    try:
        rows = list(csv.DictReader(read_text(path, ADVICE).splitlines()))
    except csv.Error as error:
        raise DataError(f"{path}: is no table ({error}); {ADVICE.damaged}") from None
    for column in COLUMNS:
        if any(row.get(column) is None for row in rows):
            raise DataError(f"{path}: has no column {column}, or not in every row; {ADVICE.damaged}")
    return rows


def _rate(path: Path, row: Mapping[str, Any], column: str) -> float:
    try:
        value = float(row.get(column) or "")
    except (TypeError, ValueError):
        value = math.nan
    if not 0.0 <= value <= 1.0:
        raise DataError(f"{path}: column {column} must hold rates from 0 to 1; {ADVICE.damaged}")
    return value


def references(promises: Promises) -> tuple[Promises, Promises]:
    """The same missions with simple promises: their mean rate, the best constant, and persistence.

    The mean is known only afterwards; its Brier score is the part *uncertainty*.
    """
    f = promises.realised
    return (
        replace(promises, name="best constant", promised=np.full(len(f), f.mean())),
        replace(promises, name="persistence", promised=calibration.persistence(f, promises.departures)),
    )


# --- diagrams --------------------------------------------------------------------------------


def diagrams(promises: Promises, others: Sequence[Promises], difference: Compared) -> PromiseDiagrams:
    """What the figure shows: ``others`` beside the promises, and one comparison."""
    order = np.argsort(promises.promised, kind="stable")
    p, f = promises.promised[order], promises.realised[order]
    low, high = consistency_band(p)
    curves = {each.name: murphy_curve(each) for each in (promises, *others)}
    rates = calibration.isotonic_rates(p, f)
    parts = score_parts(promises)
    return PromiseDiagrams(promises.fidelity, p, f, rates, low, high, parts, THETAS, curves, difference)


def score_parts(promises: Promises) -> dict[str, float]:
    """The Brier score and its parts, by name."""
    parts = calibration.brier_parts(promises.promised, promises.realised)
    return {"Brier score": float(promises.brier().mean()), **parts}


def consistency_band(
    promised: FloatArray, seed: int = 0, level: float = 0.9
) -> tuple[FloatArray, FloatArray]:
    """Ends (N,) between which the isotonic rates of exact promises lie with probability ``level``.

    Outcomes are drawn ``DRAWS`` times with the promised chances, one for each mission, independently.
    """
    rng = np.random.default_rng(seed)
    fits = [
        calibration.isotonic_rates(promised, (rng.random(len(promised)) < promised).astype(float))
        for _ in range(DRAWS)
    ]
    low, high = np.quantile(fits, [(1 - level) / 2, (1 + level) / 2], axis=0)
    return low, high


def murphy_curve(promises: Promises) -> FloatArray:
    """Mean elementary score (T,) at ``THETAS``; its integral over the thresholds is the Brier score."""
    return np.asarray(elementary_scores(promises).mean(axis=1), float)


def elementary_scores(promises: Promises) -> FloatArray:
    """Elementary scores (T, N) at ``THETAS``, expected over the flights of each plan.

    With the score S(p, y) of an outcome y they are 4 (f S(p, 1) + (1 - f) S(p, 0)).
    """
    import xarray as xr
    from scores.probability import murphy_score

    p, f = promises.promised, promises.realised

    def score(outcome: float) -> FloatArray:
        found: xarray.Dataset = murphy_score(
            xr.DataArray(p, dims="mission"), xr.DataArray(np.full(len(p), outcome), dims="mission"),
            thetas=THETAS.tolist(), functional="expectile", alpha=0.5, preserve_dims="all",
        )  # fmt: skip
        return np.asarray(found["total"].transpose("theta", "mission").values, float)

    return np.asarray(4.0 * (f * score(1.0) + (1 - f) * score(0.0)), float)


# --- two tests -------------------------------------------------------------------------------


def compared(promises: Promises, others: Promises) -> Compared:
    """Compare the scores of both over the missions for which both have a plan.

    Raises
    ------
    DataError
        If these are fewer than ``LEAST``.
    """
    places = {mission: k for k, mission in enumerate(others.missions)}
    both = [k for k, mission in enumerate(promises.missions) if mission in places]
    if len(both) < LEAST:
        raise DataError(
            f"{promises.name} and {others.name} have plans for {len(both)} common missions, which is too few "
            f"to compare them (at least {LEAST}); use the same forecast_test settings and seed"
        )
    mine, theirs = promises.only(both), others.only([places[promises.missions[k]] for k in both])
    differences = elementary_scores(mine) - elementary_scores(theirs)
    scores = mine.brier() - theirs.brier()
    mean, low, high, p_value = diebold_mariano(np.vstack([scores, differences]))
    number, *ends = calibration.mean_interval(scores, mine.situations)
    return Compared(
        others.name, len(both), number, float(theirs.brier().mean()), float(mean[0]), float(low[0]),
        float(high[0]), float(p_value[0]), ends[0], ends[1], mean[1:], low[1:], high[1:],
    )  # fmt: skip


def diebold_mariano(differences: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Mean, 95 % interval and two-sided p value, each (S,), of series of differences (S, N) of scores.

    The variance comes from an exponential model of the autocovariances, fitted to lags of up to half of the
    series, so that missions that depart close together are not counted as independent. NaN for a series of
    zeros.
    """
    import xarray as xr
    from scores.stats.statistical_tests import diebold_mariano as test

    series = xr.DataArray(
        differences, dims=("series", "mission"),
        coords={"series": np.arange(len(differences)), "h": ("series", np.ones(len(differences), int))},
    )  # fmt: skip
    found = test(
        series, "series", "h", method="HG", confidence_level=calibration.LEVEL,
        statistic_distribution="t",
    )  # fmt: skip
    above = np.asarray(found["confidence_gt_0"].values, float)
    mean, low, high = (np.asarray(found[name].values, float) for name in ("mean", "ci_lower", "ci_upper"))
    return mean, low, high, 2.0 * np.minimum(above, 1.0 - above)
