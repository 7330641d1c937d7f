"""Forecast models in NOAA's public archives: addresses of their files, and their times.

The addresses name the NOAA Open Data Dissemination buckets on S3,
https://registry.opendata.aws/noaa-gfs-bdp-pds/.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.readings import HOUR

OLDEST_CYCLE = 48  # [h] older cycles are not searched for
Ladder = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class NoaaModel:
    """A forecast model.

    Attributes
    ----------
    name : str
        The value of ``wind.model``.
    base : str
        Address of the archive.
    path : str
        Path of a file in it, with the fields ``{cycle}``, ``{step}`` [h] and ``{member}``.
    every : int
        Hours from one cycle to the next.
    steps : tuple of (last step [h], hours from one step to the next)
    long_cycles, long_steps : tuple
        Hours of the day of the cycles with longer forecasts, and their steps.
    area : GeoBox or None
        Area of a regional model; None for a global one.
    """

    name: str
    base: str
    path: str
    every: int
    steps: Ladder
    long_cycles: tuple[int, ...] = ()
    long_steps: Ladder = ()
    area: GeoBox | None = None

    def address(self, base: str | None, cycle: float, step: int, member: int = 0) -> str:
        """URL of the file of ``step`` [h] of the forecast that began at ``cycle`` [s since 1970]."""
        began = datetime.fromtimestamp(cycle, UTC)
        name = "c00" if member == 0 else f"p{member:02d}"
        return f"{(base or self.base).rstrip('/')}/{self.path.format(cycle=began, step=step, member=name)}"

    def cycles_before(self, moment: float) -> Iterator[float]:
        """Starts of forecasts at or before ``moment`` [s since 1970], the newest first."""
        newest = moment // (self.every * HOUR) * self.every * HOUR
        for back in range(0, OLDEST_CYCLE + 1, self.every):
            yield newest - back * HOUR

    def is_cycle(self, moment: float) -> bool:
        """Whether a forecast begins at ``moment`` [s since 1970]."""
        return moment % (self.every * HOUR) == 0

    def steps_between(self, cycle: float, first: float, last: float) -> tuple[int, ...]:
        """Steps [h] from the last at or before ``first`` to the first at or after ``last`` [s since 1970].

        Empty if the forecast that began at ``cycle`` does not cover both times.
        """
        hour_of_day = int(cycle % (24 * HOUR) / HOUR)
        ladder = self.long_steps if hour_of_day in self.long_cycles else self.steps
        steps = [0]
        for end, gap in ladder:
            steps += range(steps[-1] + gap, end + 1, gap)
        times = [cycle + step * HOUR for step in steps]
        if first < times[0] or last > times[-1]:
            return ()
        begin = max(k for k, time in enumerate(times) if time <= first)
        end = min(k for k, time in enumerate(times) if time >= last)
        return tuple(steps[begin : end + 1])


MODELS = {
    model.name: model
    for model in (
        NoaaModel(
            "gfs",
            "https://noaa-gfs-bdp-pds.s3.amazonaws.com",
            "gfs.{cycle:%Y%m%d}/{cycle:%H}/atmos/gfs.t{cycle:%H}z.pgrb2.0p25.f{step:03d}",
            every=6,
            steps=((120, 1), (384, 3)),
        ),
        NoaaModel(
            "hrrr",
            "https://noaa-hrrr-bdp-pds.s3.amazonaws.com",
            "hrrr.{cycle:%Y%m%d}/conus/hrrr.t{cycle:%H}z.wrfsfcf{step:02d}.grib2",
            every=1,
            steps=((18, 1),),
            long_cycles=(0, 6, 12, 18),
            long_steps=((48, 1),),
            area=GeoBox(-134.1, 21.1, 73.2, 52.7),
        ),
        NoaaModel(
            "gefs",
            "https://noaa-gefs-pds.s3.amazonaws.com",
            "gefs.{cycle:%Y%m%d}/{cycle:%H}/atmos/pgrb2sp25/ge{member}.t{cycle:%H}z.pgrb2s.0p25.f{step:03d}",
            every=6,
            steps=((240, 3),),
        ),
    )
}
