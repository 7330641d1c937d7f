"""Forecasts at points whose errors follow a known law of parts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from careful_io.times import HOUR
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.wind_errors.point_forecasts import PointForecasts
from wind_laws.error_law import GROWING, LASTING, SLOW, LawPart, TailScale
from wind_laws.law_of_parts import OBSERVED, LawOfParts

ROOT = Path(__file__).parents[1]
WINDS = ROOT.parent / "shared" / "data" / "winds"
needs_winds = pytest.mark.skipif(
    not WINDS.is_dir(), reason="the tables of winds are not beside this checkout"
)
LEADS = HOUR * np.array([0.0, 48.0])


def made_law(spread: float = 0.4, truth: str = OBSERVED) -> LawOfParts:
    """A law with a growing and a slow part, and a lasting one of 0.3 m/s."""
    growing = LawPart(GROWING, LEADS, np.array([0.0, 1.4]), HOUR * np.array([4.0, 4.0]), 150e3)
    slow = LawPart(SLOW, LEADS, np.array([0.2, 0.8]), HOUR * np.array([20.0, 20.0]), 300e3)
    lasting = LawPart(LASTING, LEADS[:1], np.array([0.3]), np.array([np.inf]), 1e6)
    scale = TailScale(spread, np.zeros(1), np.zeros(1), HOUR)
    return LawOfParts(
        "made", "10m", 3.0, (lasting, growing, slow), scale, 200, truth, "made", HOUR * np.array([6.0]),
        np.array([2.0]), 4e5,
    )  # fmt: skip


def made_forecasts(law: LawOfParts, seed: int, runs: int = 400, places: int = 3) -> PointForecasts:
    """Forecasts of runs 24 h apart to 48 h, with observations; the errors are drawn from ``law``."""
    rng = np.random.default_rng(seed)
    leads = HOUR * np.arange(0.0, 49.0, 3.0)
    starts = 24 * HOUR * np.arange(runs, dtype=float)
    root = np.linalg.cholesky(law.covariance(leads) + 1e-9 * np.eye(len(leads)))
    s = law.scale.flight
    scale = np.exp(s * rng.standard_normal((runs, places, 1, 1)) - s**2)
    errors = scale * np.einsum("ij,rpjc->rpic", root, rng.standard_normal((runs, places, len(leads), 2)))
    times = np.arange(0.0, starts[-1] + leads[-1] + 1.0, 3 * HOUR)
    wind = 3.0 * rng.standard_normal((len(times), places, 2))
    index = np.round((starts[:, None] + leads) / (3 * HOUR)).astype(int)
    winds = wind[index].transpose(0, 2, 1, 3) + errors
    return PointForecasts("made.npz", starts, leads, winds, None, times, wind)


def martingale_forecasts(c: float, seed: int, runs: int = 300) -> PointForecasts:
    """Runs 6 h apart of one model whose forecasts are conditional expectations: e² = c² L / 6 h."""
    rng = np.random.default_rng(seed)
    leads = HOUR * np.arange(0.0, 49.0, 6.0)
    starts = 6 * HOUR * np.arange(runs, dtype=float)
    steps = c * rng.standard_normal(
        (runs + len(leads), len(leads) + 1, 2)
    )  # news at each time, by time ahead
    winds = np.zeros((runs, 1, len(leads), 2))
    valid = rng.standard_normal((runs + len(leads), 2))
    for r in range(runs):
        for k in range(len(leads)):  # what is not known yet at the start of run r
            unknown = sum((steps[r + k, ahead] for ahead in range(k)), np.zeros(2))
            winds[r, 0, k] = valid[r + k] - unknown
    nothing: FloatArray = np.empty((0, 1, 2))
    return PointForecasts("own.npz", starts, leads, winds, None, np.empty(0), nothing)


def without_observations(table: PointForecasts) -> PointForecasts:
    """``table``, verified by newer runs."""
    return replace(table, observed_times=np.empty(0), observed=table.observed[:0])
