"""Winds of many forecasts: there can be several cycles and members for one valid time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.readings import Readings, iso, lead_text


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The wind at one valid time from one cycle and one member of a model.

    Attributes
    ----------
    time : float
        Valid time [s since 1970-01-01 UTC].
    lead : float
        Valid time minus start of the forecast [s]; 0 for an analysis, NaN if it is not known.
    points : (n, 2) float
        Longitude (-180..180) and latitude [deg].
    winds : (n, 2) float
        Winds towards east and north [m/s].
    level : str
        Level of the wind: ``10m``, ``925hPa``, ...
    files : tuple of Path
        The files that contain it.
    member : str
        Name of the ensemble member; empty for a single forecast.
    """

    time: float
    lead: float
    points: FloatArray
    winds: FloatArray
    level: str
    files: tuple[Path, ...]
    member: str = ""

    @property
    def cycle(self) -> float:
        """Start of the forecast [s since 1970]; the valid time if the lead is not known."""
        return self.time if np.isnan(self.lead) else self.time - self.lead

    @property
    def remark(self) -> str:
        """``analysis`` or ``3 h forecast``; empty if the lead is not known."""
        return lead_text(self.lead)


class Snapshots(NamedTuple):
    """Every wind in ``files``, and ``notes`` of quality control, one line each."""

    winds: tuple[Snapshot, ...]
    files: tuple[Path, ...]
    notes: tuple[str, ...] = ()


def latest_readings(
    snapshots: Sequence[Snapshot], files: tuple[Path, ...], notes: tuple[str, ...] = ()
) -> Readings:
    """Readings with one wind for each valid time, from the newest cycle.

    Raises
    ------
    DataError
        If two snapshots have the same time and lead, or levels differ.
    """
    best: dict[float, Snapshot] = {}
    for snap in snapshots:
        rival = best.get(snap.time)
        if rival is not None and (rival.lead == snap.lead or np.isnan(rival.lead + snap.lead)):
            names = " and ".join(dict.fromkeys(file.name for file in (*rival.files, *snap.files)))
            raise DataError(
                f"wind files {names} both hold the wind at {iso(snap.time)} with the same lead; "
                "keep one member, or use wind.source=ensemble"
            )
        if rival is None or snap.lead < rival.lead:
            best[snap.time] = snap
    chosen = [best[time] for time in sorted(best)]
    levels = sorted({snap.level for snap in chosen})
    if len(levels) > 1:
        raise DataError(f"wind files hold several levels ({', '.join(levels)}); pick one with wind.level")
    return Readings(
        times=np.array([snap.time for snap in chosen]),
        points=tuple(snap.points for snap in chosen),
        winds=tuple(snap.winds for snap in chosen),
        geographic=True,
        files=files,
        remarks=tuple(snap.remark for snap in chosen),
        origins=tuple(snap.files for snap in chosen),
        leads=np.array([snap.lead for snap in chosen]),
        level=levels[0] if levels else "10m",
        notes=notes,
    )


def known_at(snapshots: Sequence[Snapshot], moment: float, delay: float) -> tuple[Snapshot, ...]:
    """The snapshots of cycles that began at least ``delay`` [s] before ``moment`` [s since 1970]."""
    return tuple(snap for snap in snapshots if snap.cycle <= moment - delay)
