"""How well a fit predicts readings that it did not use."""

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
LEAST_SCORED = 4  # places that the score needs beside those of the fit


def held_out(cfg: WindConfig, seen: WindObservations, bounds: FloatArray | None) -> list[BoolArray] | None:
    """Masks of the readings that the score keeps out; None where too few would be left.

    They are a random share ``cfg.holdout`` of the places in the map; of all places, where it holds few.
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
    """Indices of times, grouped by equal places."""
    groups: dict[tuple[tuple[int, ...], bytes], list[int]] = {}
    for k, places in enumerate(points):
        groups.setdefault((places.shape, np.ascontiguousarray(places).tobytes()), []).append(k)
    return [np.array(slots, np.int64) for slots in groups.values()]


def score_of(fit: WindPosterior, seen: WindObservations, out: Sequence[BoolArray]) -> dict[str, float]:
    """How the readings ``out`` (masks by time) are predicted by a fit that did not use them."""
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


__all__ = ["held_out", "same_places", "score_of"]
