"""Winds of a forecast ensemble: the mean of its members, and their deviations from it.

Members are runs of one model from perturbed initial states (GEFS), of several models, or of several cycles of
one model (a time-lagged ensemble). At each valid time with n members w_m on the same nodes::

    μ   = Σ_m w_m / n
    d_m = √(s (1 + 1/n) / (n - 1)) (w_m - μ),     Σ_m d_m d_m' = s (1 + 1/n) C

where C is the covariance of the members. The factor 1 + 1/n accounts for the error of the mean of n members,
if the truth is distributed as a further member. A member is the same at all times, so that its deviation
persists and moves with the weather of that member.

A covariance that is estimated from few members is uncertain. With n members it gets the share s = (n - 1) /
(n - 1 + ν), and the law of forecast errors the share 1 - s, with ν = ``wind.ensemble_prior``. This is the
mean of an inverse Wishart distribution whose prior is the parametric law (Gelman et al., Bayesian Data
Analysis, 3rd ed., section 3.6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pareto_ltl.settings import WindConfig
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import Readings, iso, wrap_longitude
from pareto_ltl.wind.snapshots import Snapshot, one_level, readings_of

FEWEST_MEMBERS = 2
NEAR_NODE = 1e-3  # [deg] closer nodes of two members count as the same node
LARGEST_GAP = 3.0  # [deg] a node is left out if another member has no node within this distance


def ensemble_readings(
    snapshots: Sequence[Snapshot], files: tuple[Path, ...], prior: float, notes: tuple[str, ...] = ()
) -> Readings:
    """Mean and deviations of the members at every valid time with at least two members.

    Parameters
    ----------
    files : tuple of Path
        The files of the source.
    prior : float
        ν, the weight of the law of forecast errors as a number of members; 0: only the members are used.
    notes : tuple of str
        Remarks to which those on the ensemble are added.

    Raises
    ------
    DataError
        If no valid time has two members, or levels differ.
    """
    one_level(snapshots)
    groups = _by_time(snapshots)
    times = sorted(time for time, group in groups.items() if len(group) >= FEWEST_MEMBERS)
    if not times:
        raise DataError(
            f"{files[0].parent}: no valid time has two members ({len(groups)} times, "
            f"{iso(min(groups))} .. {iso(max(groups))}, one field each); an ensemble needs forecasts "
            "of several members or cycles for the same times: add them, or use wind.source=grib"
        )
    names = sorted({name for time in times for name in groups[time]})
    fewest = min(len(groups[time]) for time in times)
    share = (fewest - 1) / (fewest - 1 + prior)
    found = [_mean_and_deviations(groups[time], names, share) for time in times]
    left_out = len(groups) - len(times)
    said = [f"{len(names)} members, at least {fewest} at each time"]
    said += [f"{left_out} times with a single member left out"] if left_out else []
    return readings_of(
        [mean for mean, _ in found],
        files,
        remarks=tuple(f"mean of {len(groups[time])} members" for time in times),
        notes=(*notes, *said),
        members=tuple(deviations for _, deviations in found),
        forecast_share=1.0 - share,
    )


def prior_weight(cfg: WindConfig) -> float:
    """ν of the settings; with ``wind.forecast_error=none``, only the members determine the error."""
    return 0.0 if cfg.forecast_error == "none" else cfg.ensemble_prior


def _by_time(snapshots: Sequence[Snapshot]) -> dict[float, dict[str, Snapshot]]:
    """The members of each valid time [s since 1970] by name (in the file, else the folder) and cycle."""
    groups: dict[float, dict[str, Snapshot]] = {}
    for snap in snapshots:
        name = f"{snap.member or snap.files[0].parent.name} of {iso(snap.cycle)}"
        members = groups.setdefault(snap.time, {})
        if name in members:
            both = " and ".join(file.name for file in (*members[name].files[:1], *snap.files[:1]))
            raise DataError(f"wind files {both} both hold the {name} at {iso(snap.time)}; keep one of them")
        members[name] = snap
    return groups


def _mean_and_deviations(
    group: dict[str, Snapshot], names: Sequence[str], share: float
) -> tuple[Snapshot, FloatArray]:
    """The mean wind of one time and the weighted deviations (N, 2, M) [m/s] from it.

    M is the number of members over all times; members without a field at this time have deviation 0.

    Eq. (M13) of docs/mathematics.md.
    """
    first = next(iter(group.values()))
    aligned = {name: _at_nodes(snap, first.points) for name, snap in group.items()}
    everywhere = np.all([np.isfinite(winds).all(axis=1) for winds in aligned.values()], axis=0)
    stack = np.stack([winds[everywhere] for winds in aligned.values()], axis=-1)
    mean, n = stack.mean(axis=-1), stack.shape[-1]
    weight = np.sqrt(share * (1.0 + 1.0 / n) / (n - 1))
    deviations = np.zeros((*mean.shape, len(names)))
    deviations[..., [names.index(name) for name in aligned]] = weight * (stack - mean[..., None])
    lead = min(snap.lead for snap in group.values())
    files = tuple(dict.fromkeys(file for snap in group.values() for file in snap.files))
    return replace(first, lead=lead, points=first.points[everywhere], winds=mean, files=files), deviations


def _at_nodes(snap: Snapshot, nodes: FloatArray) -> FloatArray:
    """Winds (N, 2) [m/s] of ``snap`` at ``nodes`` (N, 2) [deg], linear between its nodes; NaN outside."""
    if snap.points.shape == nodes.shape and np.abs(snap.points - nodes).max() < NEAR_NODE:
        return snap.winds
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import cKDTree

    middle = float(np.median(nodes[:, 0]))
    own, there = (np.column_stack([wrap_longitude(p[:, 0] - middle), p[:, 1]]) for p in (snap.points, nodes))
    found = np.asarray(LinearNDInterpolator(own, snap.winds)(there), float)
    far = cKDTree(own).query(there)[0] > LARGEST_GAP
    found[far] = np.nan
    return found
