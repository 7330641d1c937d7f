"""Wind readings as read from files: the record that all sources return, and its checks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from careful_io.faults import Faults
from careful_io.times import iso, seconds
from flight_quantities.levels import DEPTH, Level
from flight_quantities.sphere import wrap_longitude
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.display import Displayed
from pareto_ltl.wind.air import NodeAir
from wind_laws.places import node_rows


@dataclass(frozen=True, slots=True, repr=False)
class Readings(Displayed):
    """Wind readings at positions and times, not yet projected into the plane of a scene.

    Attributes
    ----------
    times : (K,) float
        Increasing [s since 1970-01-01 UTC].
    points : tuple of (n_k, 2) float
        Longitude (-180..180) and latitude [deg], or x and y of a plane [m].
    winds : tuple of (n_k, 2) float
        Towards east and north (earth-relative), or towards x and y [m/s].
    geographic : bool
        True for longitude and latitude, False for x and y.
    files : tuple of Path
        The files of the source.
    remarks : tuple of K str
        Description of each time, e.g. ``3 h forecast``.
    origins : tuple of K tuples of Path
        The files that hold each time.
    leads : (K,) float
        Valid time minus start of the forecast [s]: 0 for analyses and observations, NaN if the source does
        not state it.
    level : str
        Height of the wind: ``10m``, ``80m``, ``925hPa``; ``0m`` down to ``1000m depth`` for currents.
    notes : tuple of str
        Remarks on the source, one line each, e.g. on data that quality control left out.
    members : tuple of K (n_k, 2, M) float
        Deviations of the members of an ensemble from ``winds`` [m/s], whose sum of squares is the variance;
        empty without an ensemble.
    forecast_share : float
        Share of the variance of the law of forecast errors that is used in addition to the members.
    airs : tuple of K NodeAir or None
        The air that the files have beside the wind; empty if they have none.
    law : str
        The packaged law of forecast errors that fits their model; empty if the files do not state it.
    """

    times: FloatArray
    points: tuple[FloatArray, ...]
    winds: tuple[FloatArray, ...]
    geographic: bool
    files: tuple[Path, ...]
    remarks: tuple[str, ...]
    origins: tuple[tuple[Path, ...], ...]
    leads: FloatArray
    level: str = "10m"
    notes: tuple[str, ...] = ()
    members: tuple[FloatArray, ...] = ()
    forecast_share: float = 1.0
    airs: tuple[NodeAir | None, ...] = ()
    law: str = ""

    def facts(self) -> Mapping[str, str]:
        """Numbers of times and of readings, the times, the level, and the number of files."""
        known = len(self.times) > 0
        return {
            "times": f"{len(self.times):,}",
            "readings": f"{sum(map(len, self.points)):,}",
            **({"from": iso(self.times[0]), "to": iso(self.times[-1])} if known else {}),
            "level": self.level,
            "files": f"{len(self.files):,}",
        }

    @classmethod
    def of_arrays(
        cls,
        times: Sequence[str],
        points: FloatArray,
        winds: FloatArray,
        *,
        geographic: bool = True,
        level: str = "10m",
        leads: FloatArray | None = None,
    ) -> Readings:
        """Readings at the same places at all times, for :func:`pareto_ltl.plan`.

        Parameters
        ----------
        times : sequence of K str
            Increasing, ISO 8601; UTC if they have no offset.
        points : (N, 2) float
            Longitude and latitude [deg], or x and y of a plane [m].
        winds : (K, N, 2) float
            Towards east and north, or towards x and y [m/s].
        geographic : bool
            False for x and y in the plane of the map, as in ``scene.json``: metres from ``scene.centre``, the
            middle of the bounds, where the map has one; else from the origin of its coordinates.
        level : str
            Height of the wind, or depth of the current, as in ``wind.level``.
        leads : (K,) float, optional
            Valid time minus start of the forecast [s]; without it, the leads are not known.

        Raises
        ------
        ValueError
            If the shapes do not fit, or the times are not ISO 8601 or do not increase.
        """
        try:
            clock = np.array([seconds(text) for text in times])
        except ValueError as error:
            raise ValueError(
                f"expected times such as 2026-01-01T06:00Z, got {list(times)}: {error}"
            ) from None
        places, speeds = np.array(points, float), np.array(winds, float)
        ages = np.full(len(clock), np.nan) if leads is None else np.array(leads, float)
        if places.ndim != 2 or speeds.shape != (len(clock), *places.shape) or places.shape[1] != 2:
            raise ValueError(
                f"expected points (N, 2) and winds (K, N, 2), got {places.shape}, {speeds.shape}"
            )
        if ages.shape != clock.shape or (np.diff(clock) <= 0).any():
            raise ValueError(f"expected increasing times (K,), each with one lead, got {list(times)}")
        if geographic:
            places[:, 0] = wrap_longitude(places[:, 0])
        return cls(
            times=clock,
            points=(places,) * len(clock),
            winds=tuple(speeds),
            geographic=geographic,
            files=(),
            remarks=tuple(map(lead_text, ages.tolist())),
            origins=((),) * len(clock),
            leads=ages,
            level=level,
        )

    @property
    def name(self) -> str:
        """Name of the first file, for messages."""
        return self.files[0].name if self.files else "the wind source"

    @property
    def first_time(self) -> str | None:
        """The first time, ISO 8601 UTC; None if there are no readings."""
        return iso(float(self.times[0])) if len(self.times) else None

    def at_stated_level(self, level: Level) -> Readings:
        """The readings of a table that states no level, with the one that ``wind.level`` states."""
        if level.text == self.level:
            return self
        what = "current" if level.kind == DEPTH else "wind"
        note = f"taken as the {what} {level.phrase}, as wind.level states; the table does not state its level"
        airs = tuple(air and air._replace(level=level.text, pressure_level=level.text) for air in self.airs)
        return replace(self, level=level.text, notes=(*self.notes, note), airs=airs)

    def at_nodes(self, k: int, nodes: FloatArray) -> FloatArray:
        """Winds (N, 2) [m/s] at time index ``k`` and ``nodes`` (N, 2) [deg], which are nodes of that time."""
        return self.winds[k][node_rows(self.points[k], nodes)]

    def check(self, max_speed: float) -> None:
        """Check every time as :func:`check_readings` does; one DataError names all faults."""
        faults = Faults("the wind")
        for time, points, winds in zip(self.times, self.points, self.winds, strict=True):
            where = f"wind readings of {iso(float(time))}"
            with faults.noted():
                check_readings(points, winds, self.geographic, max_speed, where, range(len(points)))
        faults.refuse()


def lead_text(lead: float) -> str:
    """``analysis`` or ``3 h forecast`` for a lead [s]; empty if the lead is NaN."""
    if np.isnan(lead):
        return ""
    return "analysis" if lead == 0 else f"{lead / 3600:g} h forecast"


CALM = Readings(np.empty(0), (), (), geographic=False, files=(), remarks=(), origins=(), leads=np.empty(0))


def check_readings(
    points: FloatArray,
    winds: FloatArray,
    geographic: bool,
    max_speed: float,
    where: str,
    rows: Sequence[int] | None = None,
) -> None:
    """Raise a DataError for implausible readings; messages begin with ``where`` and, of a table, the row.

    Without ``rows``, one message for each kind of fault states how many readings have it.
    """
    faults = Faults(where)
    (lon, lat), speed = points.T, np.hypot(winds[:, 0], winds[:, 1])
    finite = np.isfinite(points).all(axis=1) & np.isfinite(winds).all(axis=1)
    checks = (
        (~finite, "expected finite numbers, got NaN or infinity; drop the reading"),
        (
            geographic & ((np.abs(lat) > 90) | (lon < -180) | (lon > 360)),
            "latitude {lat:g}, longitude {lon:g} is not on Earth; expected -90..90 and -180..360 [deg]",
        ),
        (
            speed > max_speed,
            "wind speed {speed:.1f} m/s is not plausible; "
            f"drop it, or raise wind.max_speed (now {max_speed:g} m/s)",
        ),
    )
    for bad, fault in checks:
        there = np.flatnonzero(bad).tolist()
        for i in there if rows is not None else there[:1]:
            row = "" if rows is None else f", row {rows[i]}"
            text = fault.format(lat=lat[i], lon=lon[i], speed=speed[i])
            several = f" ({len(there)} such readings)" if rows is None and len(there) > 1 else ""
            faults.add(f"{where}{row}: {text}{several}")
    faults.refuse()
