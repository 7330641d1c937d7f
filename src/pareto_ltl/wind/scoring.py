"""Scores of the predictions of readings that a fit did not use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import BoolArray, FloatArray, IntArray
from pareto_ltl.wind.records import WindObservations

if TYPE_CHECKING:
    from pareto_ltl.wind.gp import WindPosterior

# 90 % of a normal variable lie within ± this many standard deviations
NORMAL_QUANTILE_95 = 1.6448536269514722
LEAST_SCORED = 4  # smallest number of places for the score, and for the fit


def held_out(cfg: WindConfig, seen: WindObservations, bounds: FloatArray | None) -> list[BoolArray] | None:
    """Masks of the readings that are held out for the score; None if there are too few readings.

    They are those at a random share ``cfg.holdout`` of the places on the map or, if these are few, of all
    places.
    """
    places = np.unique(np.concatenate(seen.points), axis=0)
    near = places
    if bounds is not None:
        inside = places[((places >= bounds[0]) & (places <= bounds[1])).all(axis=1)]
        near = inside if len(inside) >= LEAST_SCORED / cfg.holdout else places
    count = max(1, round(cfg.holdout * len(near)))
    out = near[np.random.default_rng(0).permutation(len(near))[:count]]
    masks = [np.isin(p[:, 0] + 1j * p[:, 1], out[:, 0] + 1j * out[:, 1]) for p in seen.points]
    if count < LEAST_SCORED or any((~mask).sum() < LEAST_SCORED for mask in masks):
        return None
    return masks


def same_places(points: Sequence[FloatArray]) -> list[IntArray]:
    """Indices of times, in groups with the same places."""
    groups: dict[tuple[tuple[int, ...], bytes], list[int]] = {}
    for k, places in enumerate(points):
        groups.setdefault((places.shape, np.ascontiguousarray(places).tobytes()), []).append(k)
    return [np.array(slots, np.int64) for slots in groups.values()]


def score_of(fit: WindPosterior, seen: WindObservations, out: Sequence[BoolArray]) -> dict[str, float]:
    """Scores of the predictions of the readings ``out`` (a mask for each time) by a fit without them.

    ``gp_z_sd``: root mean square of z-scores; ``gp_coverage_90``: share within 90 % intervals; ``gp_nlpd``:
    mean negative log predictive density.
    """
    z: list[FloatArray] = []
    log_sd: list[FloatArray] = []
    for slots in same_places(seen.points):
        places = seen.points[slots[0]][out[slots[0]]]
        if not len(places):
            continue
        mean, var = fit.only(slots).at(places)
        for i, k in enumerate(slots.tolist()):
            sd = np.sqrt(var[i] + fit.gust_var[k])
            z.append(((seen.winds[k][out[k]] - mean[i]) / sd).ravel())
            log_sd.append(np.log(sd).ravel())
    scores = np.concatenate(z)
    return {
        "gp_z_sd": float(np.sqrt(np.mean(scores**2))),
        "gp_coverage_90": float(np.mean(np.abs(scores) <= NORMAL_QUANTILE_95)),
        "gp_nlpd": float(np.mean(0.5 * scores**2 + np.concatenate(log_sd)) + 0.5 * np.log(2 * np.pi)),
    }
