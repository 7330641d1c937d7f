"""The navigation log of a plan: time, heading, airspeed and wind of each leg, and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pareto_ltl.extend import FlownAir, PlannedPath, Problem, evaluate
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.exports.ellipses import axes_of, circle_radius

SHARE = 0.95  # of the positions that lie within the radius
LEG_COLUMNS = {  # names in files of the numbers of a leg
    "heading_true_deg": "heading", "airspeed_tas_m_s": "airspeed", "airspeed_cas_m_s": "calibrated",
    "duration_s": "duration",
    "wind_m_s": "wind_speed", "wind_from_deg": "wind_from", "wind_sd_m_s": "wind_sd",
    "track_true_deg": "track", "ground_speed_m_s": "ground_speed", "distance_m": "distance",
}  # fmt: skip
SPREAD_COLUMNS = {  # and of the spread of the positions at a step
    "radius_95_m": "radius", "ellipse_major_m": "major", "ellipse_minor_m": "minor",
    "ellipse_azimuth_deg": "azimuth",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class NavigationLog:
    """A plan of T legs. Directions are true, clockwise from north [deg]; places are WGS 84 [deg].

    Attributes
    ----------
    law : str
        Wind law of the standard deviations of positions and winds.
    t : (T+1,) float
        [s since departure]
    x : (T+1, 2) float
        Expected positions in the plane [m].
    utc : tuple of T + 1 str, or None
        ISO 8601; None where the map names no departure.
    lat, lon : (T+1,) float
        Expected positions.
    heading : (T,) float
        Heading halfway along the leg, to be held along it; NaN at zero airspeed.
    airspeed : (T,) float
        True airspeed, or the speed through the water [m/s].
    calibrated : (T,) float
        Calibrated airspeed [m/s], which instruments show and autopilots hold; NaN in the water.
    track, distance : (T,) float
        Direction at the leg's start and length [m] of the expected track over ground.
    wind : (T, 2) float
        Expected wind towards east and north [m/s].
    wind_from : (T,) float
        Direction that the expected wind blows from.
    wind_sd, wind_speed_sd, wind_from_sd : (T,) float
        Standard deviations: root mean square of both components [m/s], along the expected wind [m/s], and of
        its direction [deg].
    major, minor : (T+1,) float
        Standard deviations of the position along the axes of its ellipse [m].
    azimuth : (T+1,) float
        Direction of the major axis, in [0, 180).
    radius : (T+1,) float
        Radius of the circle around the expected position that holds 95 % of the positions at that time [m].
    fixes : tuple of int
        Steps at which the plan counts on a position fix.
    late : float
        Time that all turns take [s].
    swing : float
        Largest distance of the expected flight from the straight lines between the planned positions [m].
    """

    law: str
    t: FloatArray
    x: FloatArray
    utc: tuple[str, ...] | None
    lat: FloatArray
    lon: FloatArray
    heading: FloatArray
    airspeed: FloatArray
    calibrated: FloatArray
    track: FloatArray
    distance: FloatArray
    wind: FloatArray
    wind_from: FloatArray
    wind_sd: FloatArray
    wind_speed_sd: FloatArray
    wind_from_sd: FloatArray
    major: FloatArray
    minor: FloatArray
    azimuth: FloatArray
    radius: FloatArray
    fixes: tuple[int, ...]
    late: float = 0.0
    swing: float = 0.0

    @property
    def legs(self) -> int:
        """The number of legs T."""
        return len(self.airspeed)

    def time_utc(self, k: int) -> str | None:
        """Time of step ``k`` in UTC; None where the map names no departure."""
        return None if self.utc is None else self.utc[k]

    def leg(self, k: int) -> dict[str, float]:
        """The numbers of leg ``k`` by their names in files."""
        return {name: getattr(self, attribute)[k] for name, attribute in LEG_COLUMNS.items()}

    def spread(self, k: int) -> dict[str, float]:
        """The spread of the position at step ``k`` by its names in files."""
        return {name: getattr(self, attribute)[k] for name, attribute in SPREAD_COLUMNS.items()}

    @property
    def duration(self) -> FloatArray:
        """Duration of each leg (T,) [s]."""
        return np.diff(self.t)

    @property
    def ground_speed(self) -> FloatArray:
        """Expected ground speed of each leg (T,) [m/s]."""
        return self.distance / self.duration

    @property
    def wind_speed(self) -> FloatArray:
        """Speed of the expected wind of each leg (T,) [m/s]."""
        return np.asarray(np.hypot(self.wind[:, 0], self.wind[:, 1]), float)


def navigation_log(problem: Problem, path: PlannedPath, air: FlownAir | None = None) -> NavigationLog:
    """The log of ``path`` on a map with a place on Earth, flown in ``air``; None: in the water.

    The expected wind of a leg is the plan's: with it, x' = A x + dt B u + dt w leads from one expected
    position to the next. For an aircraft that banks, headings, times and durations come from
    :mod:`pareto_ltl.planning.turns`: legs last longer by the time that their turn takes. Raises ValueError
    for a map without a place on Earth.
    """
    from pyproj import Geod

    scene = problem.scene
    if scene.crs is None:
        raise ValueError("a navigation log needs a map with a place on Earth")
    grid_wind, variance = expected_winds(problem, path)
    legs = problem.turns.ordered(path.t, path.x, path.u, grid_wind)
    lon, lat = scene.frame.to_geographic(legs.x)
    track, _, distance = Geod(ellps="WGS84").inv(lon[:-1], lat[:-1], lon[1:], lat[1:])
    middle = 0.5 * (legs.x[:-1] + legs.x[1:])
    turn = scene.frame.convergence(lon, lat)  # of the plane against north, to be added to directions
    bearing = np.arctan2(grid_wind[:, 0], grid_wind[:, 1]) + turn[:-1]
    speed = np.hypot(grid_wind[:, 0], grid_wind[:, 1])
    along, across = _spreads(grid_wind, speed, variance)
    major, minor, axis = axes_of(path.cov)
    airspeed = np.hypot(legs.u[:, 0], legs.u[:, 1])
    return NavigationLog(
        law=problem.fidelity.law,
        t=legs.t,
        x=legs.x,
        utc=scene.frame.utc(legs.t),
        lat=lat,
        lon=lon,
        heading=scene.frame.heading(middle, legs.u),
        airspeed=airspeed,
        calibrated=np.full(len(airspeed), np.nan) if air is None else air.calibrated(airspeed),
        track=np.asarray(track, float) % 360.0,
        distance=np.asarray(distance, float),
        wind=np.column_stack([speed * np.sin(bearing), speed * np.cos(bearing)]),
        wind_from=(np.rad2deg(bearing) + 180.0) % 360.0,
        wind_sd=np.sqrt(variance.mean(axis=1)),
        wind_speed_sd=along,
        wind_from_sd=np.rad2deg(np.arctan2(across, speed)),
        major=major,
        minor=minor,
        azimuth=np.rad2deg(axis + turn) % 180.0,
        radius=circle_radius(major, minor, SHARE),
        fixes=path.fixes,
        late=legs.late,
        swing=legs.swing,
    )


def expected_winds(problem: Problem, path: PlannedPath) -> tuple[FloatArray, FloatArray]:
    """Mean and variance (T, 2) of the wind along each leg in the plane [m/s, m²/s²], under the plan's law.

    With the mean, the controls lead from one expected position to the next. It includes what the robot's
    heading errors take from its speed in the mean, 0.02 % of the speed at 1 degree.
    """
    flight, motion = evaluate(problem, x=path.x), problem.motion
    wind = (path.x[1:] - path.x[:-1] @ motion.a.T) / motion.dt - path.u @ motion.b.T
    variance = (flight.psi.astype(float) ** 2).sum(axis=-1) + flight.white
    return wind, np.maximum(variance, 0.0)


def _spreads(wind: FloatArray, speed: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Standard deviations (T,) of independent components along and across ``wind`` (T, 2)."""
    toward = np.where(speed[:, None] > 0.0, wind / np.maximum(speed, 1e-300)[:, None], [1.0, 0.0])
    return (
        np.sqrt((toward**2 * variance).sum(axis=1)),
        np.sqrt((toward[:, ::-1] ** 2 * variance).sum(axis=1)),
    )
