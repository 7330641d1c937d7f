"""Winds that are known at nodes and times only: the errors of a fitted field between them."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from wind_laws.lattice import lattice_values
from wind_laws.records import SPACE, TIME, UncertainWind

Real = TypeVar("Real", bound=UncertainWind)


def with_interpolation_errors(real: Real, believed: UncertainWind) -> Real:
    """``real`` with the errors of interpolation in space and time of ``believed``.

    Parameters
    ----------
    real : UncertainWind
        Expected winds without uncertainty but gusts.
    believed : UncertainWind
        A field fitted to readings, on a lattice of the same map; of its slots the nearest in time count.
    """
    modes, law = believed.modes, believed.error
    if modes is None or law is None:
        return real
    slot = np.abs(believed.times - real.times[:, None]).argmin(axis=1)
    kept = np.isin(modes.part, (SPACE, TIME))
    psi = np.where(kept, modes.psi, np.float32(0.0))[slot]
    spatial = believed.latent_var - law.forecast_variance(believed.leads)[:, None, None, None]
    nodes = real.lattice.nodes()
    variance = np.stack([lattice_values(believed, spatial[k], nodes) for k in slot]).reshape(real.mean.shape)
    return replace(
        real,
        latent_var=np.maximum(variance, 0.0),
        modes=replace(
            modes, psi=psi, part=np.where(kept, modes.part, -1), energy=modes.energy[slot],
            length=modes.length[slot],
        ),
        leads=np.zeros(len(slot)),
        error=law.shared(0.0),
        gust_time=believed.gust_time,
    )  # fmt: skip
