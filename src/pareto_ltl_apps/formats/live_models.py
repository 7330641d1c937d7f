"""Forecasts that are downloaded: where the files of each model are, when they begin, which steps they hold.

Addresses and steps: NOAA Open Data Dissemination (https://registry.opendata.aws/collab/noaa/), the products
of NCEP (https://www.nco.ncep.noaa.gov/pmb/products/), ECMWF open data since cycle 50r1 of May 2026
(https://www.ecmwf.int/en/forecasts/datasets/open-data), where the control forecast of the ensemble is the
deterministic one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NamedTuple

from careful_io.times import HOUR
from flight_quantities.levels import HEIGHT, Level
from pareto_ltl.extend import GeoBox
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.formats.quantities import CURRENTS, WINDS, Quantity, level_gap, wanted_level

OLDEST_CYCLE = 48  # [h] older cycles are not searched for
Ladder = tuple[tuple[int, int], ...]
NOMADS = "https://nomads.ncep.noaa.gov/pub/data/nccf/com"
NOMADS_HINT = "NOMADS keeps only the last days"
NOMADS_PAUSE = 0.6  # [s] between requests; the server blocks addresses above 120 requests a minute
ECMWF = "https://data.ecmwf.int/forecasts"
ECMWF_HINT = (
    "data.ecmwf.int keeps only the last days, "
    "wind.base_url=https://ecmwf-forecasts.s3.eu-central-1.amazonaws.com more"
)
STAMP = "{cycle:%Y%m%d}/{cycle:%H}z"
AIFS_ENSEMBLE = STAMP + "/aifs-ens/0p25/enfo/{cycle:%Y%m%d%H%M%S}-{step}h-enfo"
CONUS_NBM = GeoBox(-138.4, 19.2, 79.4, 57.1)  # a Lambert grid of 2345 x 1597 nodes
RTOFS_REGIONS = {
    "west_atl": GeoBox(-100.0, 10.0, 45.92, 44.72),
    "west_conus": GeoBox(-150.0, 10.0, 49.92, 59.92),
    "honolulu": GeoBox(180.0, 0.0, 49.92, 39.92),
    "guam": GeoBox(130.0, 0.0, 49.92, 29.92),
    "samoa": GeoBox(170.0, -30.0, 44.72, -0.08),
    "bering": GeoBox(155.0, 40.0, 55.92, 67.12),
    "arctic": GeoBox(160.0, 60.0, 75.92, 79.92),
    "alaska": GeoBox(140.0, 40.0, 104.7, 84.7),
    "trop_paci_lowres": GeoBox(130.0, -40.0, 119.0, 39.0),
}  # the finest first


class Download(NamedTuple):
    """A file on a server, and the ``members`` that are taken from it; () if it has one forecast only."""

    url: str
    members: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class LiveModel:
    """A forecast model.

    Attributes
    ----------
    name : str
        The value of ``wind.source``, or of ``wind.model`` for ``wind.source=noaa``.
    base : str
        Address of the archive.
    path : str
        Path of a file in it, with the fields ``{cycle}``, ``{step}`` [h], ``{member}`` (0 is the control
        forecast), ``{run}`` (``c00``, ``p01``, ...), ``{levels}`` (``sfc`` or ``pres``) and ``{region}``.
    steps : tuple of (last step [h], hours from one step to the next)
    every : int
        Hours from one cycle to the next.
    first_step : int
        [h]
    long_cycles, long_steps : tuple
        Hours of the day of the cycles with longer forecasts, and their steps.
    files : tuple of int
        The last steps of files that hold several steps, which name them; else empty.
    inventory : str
        End of the address of an inventory: ``.idx`` follows the address of the file, ``.index`` replaces
        its end. Empty if there are none; then the whole file is downloaded.
    area : GeoBox or None
        Area of a regional model; None for a global one.
    regions : dict
        Areas of the files, if a file covers a part of the area.
    members : int
        Number of forecasts of the ensemble with the control forecast; 1 if there is no ensemble.
    control, others : str
        Paths of the control forecast and of all other members, if one file has these.
    quantity : Quantity
        Winds or currents.
    hint : str
        What to know if a forecast is not there.
    pause : float
        Time between two requests [s].
    law : str
        The packaged law of forecast errors that fits the model; empty: the source has one.
    """

    name: str
    base: str
    path: str
    steps: Ladder
    every: int = 6
    first_step: int = 0
    long_cycles: tuple[int, ...] = ()
    long_steps: Ladder = ()
    files: tuple[int, ...] = ()
    inventory: str = ".idx"
    area: GeoBox | None = None
    regions: dict[str, GeoBox] | None = None
    members: int = 1
    control: str = ""
    others: str = ""
    quantity: Quantity = WINDS
    hint: str = ""
    pause: float = 0.0
    law: str = ""

    def downloads(
        self, base: str | None, cycle: float, step: int, level: Level, members: int, region: str
    ) -> tuple[Download, ...]:
        """The files with ``members`` forecasts of ``step`` [h] that began at ``cycle`` [s since 1970]."""
        named = next((name for name in self.files if name >= step), step)
        values = {
            "cycle": datetime.fromtimestamp(cycle, UTC),
            "step": named,
            "levels": "sfc" if level.kind == HEIGHT else "pres",
            "region": region,
        }

        def address(path: str, member: int = 0) -> str:
            run = f"p{member:02d}" if member else "c00"
            return f"{(base or self.base).rstrip('/')}/{path.format(**values, member=member, run=run)}"

        if members == 1 or not self.others:
            return tuple(Download(address(self.path, member), ()) for member in range(members))
        control = Download(address(self.control or self.path), ())
        return control, Download(address(self.others), tuple(range(1, members)))

    def inventory_of(self, url: str) -> str:
        """Address of the inventory of the file at ``url``."""
        return (
            url.removesuffix(".grib2") + self.inventory
            if self.inventory == ".index"
            else url + self.inventory
        )

    def cycles_before(self, moment: float) -> Iterator[float]:
        """Starts of forecasts at or before ``moment`` [s since 1970], the newest first."""
        newest = moment // (self.every * HOUR) * self.every * HOUR
        for back in range(0, OLDEST_CYCLE + 1, self.every):
            yield newest - back * HOUR

    def steps_between(self, cycle: float, first: float, last: float) -> tuple[int, ...]:
        """Steps [h] from the last at or before ``first`` to the first at or after ``last`` [s since 1970].

        Empty if the forecast that began at ``cycle`` does not cover both times.
        """
        hour_of_day = int(cycle % (24 * HOUR) / HOUR)
        ladder = self.long_steps if hour_of_day in self.long_cycles else self.steps
        steps = [self.first_step]
        for end, gap in ladder:
            steps += range(steps[-1] + gap, end + 1, gap)
        times = [cycle + step * HOUR for step in steps]
        if first < times[0] or last > times[-1]:
            return ()
        begin = max(k for k, time in enumerate(times) if time <= first)
        end = min(k for k, time in enumerate(times) if time >= last)
        return tuple(steps[begin : end + 1])

    def region_of(self, here: GeoBox | None, level: str) -> str:
        """The region of the files for a map in the middle of ``here``; empty if files cover the whole area.

        ConfigError if the model does not cover the map, or ``level`` is not the surface of regional currents.
        """
        middle = None if here is None else here.middle
        if self.regions is None:
            if self.area is not None and here is not None and not self.area.contains(here.middle).all():
                raise ConfigError(
                    f"{self.name} covers {self.area.text}; the scene needs {here.text}: use wind=noaa "
                    "wind.model=gfs"
                )
            return ""
        if level_gap(wanted_level(self.quantity, "0m"), wanted_level(self.quantity, level), True) is None:
            raise ConfigError(
                f"wind={self.name} has the current at the surface only, and wind.level is {level}: set "
                "wind.level=0m, or download a file with depths (rtofs_glo_3dz_f006_6hrly_hvr_US_east.nc) and "
                "set wind=currents wind.path=FILE"
            )
        found = [
            name for name, box in self.regions.items() if middle is not None and box.contains(middle).all()
        ]
        if not found:
            raise ConfigError(
                f"wind={self.name} has the regions {', '.join(self.regions)}; "
                + ("none contains the map" if here else "a map with places on Earth chooses one")
                + ": for other seas, set wind=currents wind.path=FILE with a file of an ocean model"
            )
        return found[0]


MODELS = {
    model.name: model
    for model in (
        LiveModel(
            "gfs",
            "https://noaa-gfs-bdp-pds.s3.amazonaws.com",
            "gfs.{cycle:%Y%m%d}/{cycle:%H}/atmos/gfs.t{cycle:%H}z.pgrb2.0p25.f{step:03d}",
            steps=((120, 1), (384, 3)),
        ),
        LiveModel(
            "hrrr",
            "https://noaa-hrrr-bdp-pds.s3.amazonaws.com",
            "hrrr.{cycle:%Y%m%d}/conus/hrrr.t{cycle:%H}z.wrfsfcf{step:02d}.grib2",
            every=1,
            steps=((18, 1),),
            long_cycles=(0, 6, 12, 18),
            long_steps=((48, 1),),
            area=GeoBox(-134.1, 21.1, 73.2, 52.7),
            law="hourly_fine",
        ),
        LiveModel(
            "gefs",
            "https://noaa-gefs-pds.s3.amazonaws.com",
            "gefs.{cycle:%Y%m%d}/{cycle:%H}/atmos/pgrb2sp25/ge{run}.t{cycle:%H}z.pgrb2s.0p25.f{step:03d}",
            steps=((240, 3),),
            members=31,
        ),
        LiveModel(
            "nbm",
            "https://noaa-nbm-grib2-pds.s3.amazonaws.com",
            "blend.{cycle:%Y%m%d}/{cycle:%H}/core/blend.t{cycle:%H}z.core.f{step:03d}.co.grib2",
            every=1,
            first_step=1,
            steps=((36, 1), (192, 3), (264, 6)),
            area=CONUS_NBM,
            law="hourly_fine",
        ),
        LiveModel(
            "aigfs",
            f"{NOMADS}/aigfs/prod",
            "aigfs.{cycle:%Y%m%d}/{cycle:%H}/model/atmos/grib2/aigfs.t{cycle:%H}z.{levels}.f{step:03d}.grib2",
            steps=((384, 6),),
            hint=NOMADS_HINT,
            pause=NOMADS_PAUSE,
        ),
        LiveModel(
            "aigefs",
            f"{NOMADS}/aigefs/prod",
            "aigefs.{cycle:%Y%m%d}/{cycle:%H}/mem{member:03d}/model/atmos/grib2/"
            "aigefs.t{cycle:%H}z.{levels}.f{step:03d}.grib2",
            steps=((384, 6),),
            members=31,
            hint=NOMADS_HINT,
            pause=NOMADS_PAUSE,
        ),
        LiveModel(
            "rtofs",
            f"{NOMADS}/rtofs/prod",
            "rtofs.{cycle:%Y%m%d}/rtofs_glo.t00z.f{step:03d}_{region}_std.grb2",
            every=24,
            first_step=1,
            steps=((72, 1), (144, 3)),
            files=(24, 48, 72, 144),
            inventory="",
            regions=RTOFS_REGIONS,
            quantity=CURRENTS,
            hint=NOMADS_HINT,
            pause=NOMADS_PAUSE,
        ),
        LiveModel(
            "ifs",
            ECMWF,
            STAMP + "/ifs/0p25/oper/{cycle:%Y%m%d%H%M%S}-{step}h-oper-fc.grib2",
            steps=((144, 3),),
            long_cycles=(0, 12),
            long_steps=((144, 3), (360, 6)),
            inventory=".index",
            members=51,
            others=STAMP + "/ifs/0p25/enfo/{cycle:%Y%m%d%H%M%S}-{step}h-enfo-ef.grib2",
            hint=ECMWF_HINT,
            law="ecmwf_class",
        ),
        LiveModel(
            "aifs",
            ECMWF,
            STAMP + "/aifs-single/0p25/oper/{cycle:%Y%m%d%H%M%S}-{step}h-oper-fc.grib2",
            steps=((360, 6),),
            inventory=".index",
            members=51,
            control=f"{AIFS_ENSEMBLE}-cf.grib2",
            others=f"{AIFS_ENSEMBLE}-pf.grib2",
            hint=ECMWF_HINT,
            law="ecmwf_class",
        ),
    )
}
