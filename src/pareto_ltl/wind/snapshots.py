"""The wind of one forecast at one valid time, and readings of such winds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.air import NodeAir
from pareto_ltl.wind.readings import Readings, lead_text


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
    air : NodeAir or None
        The air that the files have beside the wind.
    """

    time: float
    lead: float
    points: FloatArray
    winds: FloatArray
    level: str
    files: tuple[Path, ...]
    member: str = ""
    air: NodeAir | None = None

    @property
    def cycle(self) -> float:
        """Start of the forecast [s since 1970]; the valid time if the lead is not known."""
        return self.time if np.isnan(self.lead) else self.time - self.lead


def readings_of(
    fields: Sequence[Snapshot], files: tuple[Path, ...], geographic: bool = True, **more: Any
) -> Readings:
    """The readings of ``fields``, whose times increase; ``more`` are further attributes of the readings."""
    usual = {"remarks": tuple(lead_text(snap.lead) for snap in fields), "level": one_level(fields)}
    airs = tuple(snap.air for snap in fields)
    return Readings(
        times=np.array([snap.time for snap in fields]),
        points=tuple(snap.points for snap in fields),
        winds=tuple(snap.winds for snap in fields),
        geographic=geographic,
        files=files,
        origins=tuple(snap.files for snap in fields),
        leads=np.array([snap.lead for snap in fields]),
        airs=airs if any(air is not None for air in airs) else (),
        **usual | more,
    )


def one_level(snapshots: Sequence[Snapshot]) -> str:
    """The level of all ``snapshots``; a DataError if they have several."""
    levels = sorted({snap.level for snap in snapshots})
    if len(levels) > 1:
        raise DataError(f"wind files hold several levels ({', '.join(levels)}); pick one with wind.level")
    return levels[0] if levels else "10m"
