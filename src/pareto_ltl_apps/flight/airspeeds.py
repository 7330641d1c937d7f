"""True and calibrated airspeeds in flight; inside the planner all airspeeds are true.

``VFR_HUD`` of a vehicle with an airspeed sensor, ``ARSP`` of ArduPilot's logs, and the airspeeds that
autopilots take by ``GUIDED_CHANGE_SPEED`` and ``DO_CHANGE_SPEED`` are calibrated. The air is the standard
atmosphere at the pressure which the vehicle measures, or at the height of the plan where it sends none.
``SCALED_PRESSURE.temperature`` is of the sensor, 10 to 30 K above the air in a closed case (1.7 to 5 % of
airspeed), so it is not used; air 10 K from the standard changes a true airspeed by 1.8 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from flight_quantities.atmosphere import (
    FREEZING,
    Air,
    calibrated_airspeed,
    standard_air,
    standard_height,
    true_airspeed,
)
from pareto_ltl import Settings
from pareto_ltl.extend import FlownAir

ALIKE = 0.1  # [K] between temperatures that are one
OLD = 60.0  # [s] after which a pressure is not of this height any longer


def airspeeds_of(settings: Settings, planned: FlownAir | None = None) -> Airspeeds:
    """The airspeeds of a flight of the plan, whose air is ``planned``, which plans of earlier versions lack.

    If its temperature is not the one of the standard atmosphere, it also counts for measured pressures.
    Without ``scene.ground`` a height above ground is taken as one above the sea: 300 m of ground change an
    airspeed by 1.5 %.
    """
    air = planned or settings.flight_air(settings.flight_height)
    if air is None:
        return Airspeeds(measures=False, celsius=settings.robot.air_temperature)
    celsius = settings.robot.air_temperature
    standard = standard_air(standard_height(air.pressure)).temperature
    if celsius is None and abs(air.temperature - standard) > ALIKE:
        celsius = air.temperature - FREEZING
    return Airspeeds(air.density_ratio, celsius=celsius)


@dataclass(slots=True)
class Airspeeds:
    """Turns airspeeds into each other, with the air that the vehicle measures.

    Attributes
    ----------
    planned : float
        Density ratio ρ / ρ0 without a measured pressure; 1 in water, where there is one speed.
    measures : bool
        Whether pressures count: not in water.
    celsius : float or None
        Temperature of the air [deg C]; None: of the standard atmosphere.
    """

    planned: float = 1.0
    measures: bool = True
    celsius: float | None = None
    measured: float = math.nan
    time: float = -math.inf  # of the pressure [s after departure]

    def take_pressure(self, pressure: float, time: float) -> None:
        """Take a static ``pressure`` [Pa]; one that no height of the standard atmosphere has is left out."""
        try:
            air = standard_air(standard_height(pressure))
        except ValueError:
            return
        if self.celsius is not None:
            air = Air(pressure, self.celsius + FREEZING)
        self.measured, self.time = air.density_ratio, time

    def density_ratio(self, time: float) -> float:
        """ρ / ρ0 at ``time`` [s after departure]."""
        return self.measured if self.measures and time <= self.time + OLD else self.planned

    def true(self, calibrated: float, time: float) -> float:
        """True airspeed of a calibrated one [m/s]."""
        return true_airspeed(calibrated, self.density_ratio(time))

    def calibrated(self, true: float, time: float) -> float:
        """Calibrated airspeed of a true one [m/s]."""
        return calibrated_airspeed(true, self.density_ratio(time))
