"""Newer forecasts of a simulated true wind, as a later cycle of the same model would predict it.

Under the law of a field, the error of forecasts in slot k is ψ_k' θ_k with the variance e²(L_k). A cycle that
begins T later has the variance e²(L_k - T) there. With s = 1 - e²(L_k - T) / e²(L_k), the new field is

    μ_k + s ψ_k' θ_k + √(s (1 - s)) ψ_k' ξ_k,

where ξ persists as θ does: its error has the variance (1 - s) e²(L_k), is independent of the new field, and
its modes are √(1 - s) ψ_k.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pareto_ltl.kernels import data as kd
from pareto_ltl.support.arrays import Float32Array, FloatArray
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.wind.conditioned import lattice_values
from pareto_ltl.wind.records import FORECAST, WindField

HOUR = 3600.0


def require_cycles(field: WindField) -> None:
    """Raise ConfigError unless the field has errors of forecasts, which a later cycle reduces."""
    law, modes = field.error, field.modes
    known = bool(np.isfinite(field.leads).any())
    if law is None or modes is None or not known or not (modes.part == FORECAST).any():
        raise ConfigError(
            "replanning.forecasts: the wind of this run is not a forecast with known leads, so that a later "
            "cycle cannot improve it: take such a source, e.g. wind=noaa, or leave it null"
        )


def newer_forecast(
    field: WindField, modes: kd.Modes, theta: Float32Array, since: float, rng: np.random.Generator
) -> WindField:
    """The forecast that begins ``since`` [s after departure], for the flight with the coefficients ``theta``.

    ``theta`` (epochs, 2, P) are the true coefficients in the epochs of ``modes``.
    """
    found, law = field.modes, field.error
    assert found is not None
    assert law is not None
    own = found.part == FORECAST
    shares = revealed_shares(field, since)
    mean, latent, psi = field.mean.copy(), field.latent_var.copy(), found.psi.copy()
    nodes, shape = field.lattice.nodes(), mean.shape[1:3]
    xi = rng.standard_normal((2, int(own.sum())))
    for k, share in enumerate(shares.tolist()):
        if k:
            rho = law.persistence ** float((field.times[k] - field.times[k - 1]) / law.persistence_time)
            xi = rho * xi + math.sqrt(1.0 - rho * rho) * rng.standard_normal(xi.shape)
        steps = np.flatnonzero(modes.slot == k)
        if share <= 0.0 or not len(steps):
            continue
        known = theta[modes.epoch[steps[0]]][:, own].astype(float)
        observed = share * known + math.sqrt(share * (1.0 - share)) * xi
        for c in (0, 1):
            here = lattice_values(found, psi[k, :, :, c][..., own].astype(float), nodes)
            mean[k, ..., c] += (here @ observed[c]).reshape(shape)
            lost = share * (here**2).sum(axis=1).reshape(shape)
            latent[k, ..., c] = np.maximum(latent[k, ..., c] - lost, 0.0)
        psi[k][..., own] *= np.float32(math.sqrt(1.0 - share))
    leads = np.where(field.times >= since, np.maximum(field.leads - since, 0.0), field.leads)
    return replace(
        field, mean=mean, latent_var=latent, modes=replace(found, psi=psi), leads=leads, evidence=None,
        source=f"a forecast {since / HOUR:g} h newer than {field.source}",
    )  # fmt: skip


def revealed_shares(field: WindField, since: float) -> FloatArray:
    """s (K,): the share of the variance of forecast errors that a cycle ``since`` [s] later removes."""
    assert field.error is not None
    late = np.isfinite(field.leads) & (field.times >= since)
    before = field.error.forecast_variance(np.where(late, field.leads, 0.0))
    after = field.error.forecast_variance(np.where(late, np.maximum(field.leads - since, 0.0), 0.0))
    share = 1.0 - after / np.maximum(before, 1e-300)
    return np.asarray(np.where(late & (before > 0.0), np.clip(share, 0.0, 1.0), 0.0), float)
