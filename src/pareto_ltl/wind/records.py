"""Records of wind in the plane of a map: readings, and the field that planning uses, with the air there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from pareto_ltl.support.display import Displayed
from pareto_ltl.wind.air import MapAir
from wind_laws.records import PlacedReadings, UncertainWind


@dataclass(frozen=True, slots=True)
class WindObservations(PlacedReadings):
    """Wind readings in the plane of the scene; times count from its ``time_zero``.

    Attributes
    ----------
    air : MapAir or None
        The air of the map; None if the source does not have it.
    """

    air: MapAir | None = None


@dataclass(frozen=True, slots=True, repr=False)
class WindField(Displayed, UncertainWind):
    """Posterior wind on a regular lattice, linear in time between its slots.

    Attributes
    ----------
    air : MapAir or None
        The air of the map; None if the source of the readings does not have it.
    """

    air: MapAir | None = None

    @classmethod
    def of(cls, wind: UncertainWind, air: MapAir | None) -> Self:
        """``wind`` over a map with the air ``air``."""
        return cls(**{each.name: getattr(wind, each.name) for each in fields(wind)}, air=air)

    def later(self, moment: float) -> Self:
        """The field from the last slot at or before ``moment`` [s] on, with times that count from ``moment``.

        Its evidence is dropped: the fit also used the slots before.
        """
        air = None if self.air is None else replace(self.air, times=self.air.times - moment)
        return replace(UncertainWind.later(self, moment), air=air)

    def facts(self) -> Mapping[str, str]:
        """Slots, lattice, mean speed and source."""
        k, east, north = self.mean.shape[:3]
        return {
            "slots": f"{k} over {float(self.times[-1] - self.times[0]) / 3600:.1f} h",
            "lattice": f"{east} x {north} nodes, {self.spacing / 1e3:g} km apart",
            "mean speed": f"{float(np.linalg.norm(self.mean, axis=-1).mean()):.1f} m/s",
            "source": self.source or "unknown",
        }
