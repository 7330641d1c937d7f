"""Settings of the wind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from careful_io.messages import shown_text, wrong_value
from declared_settings import CheckedSettings, check_time, setting
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import FORMATS, WIND_SOURCES

if TYPE_CHECKING:
    from pareto_ltl.wind.readings import Readings

SELECTED, STATED = "selected", "stated"


@dataclass(frozen=True, slots=True)
class WindSource:
    """One value of ``wind.source``.

    Attributes
    ----------
    read : callable
        Returns :class:`Readings` for the settings of the wind and the wanted part, as
        :meth:`Readings.of_arrays` or :func:`read_wind` makes them; raises a DataError if a file is not
        valid.
    files : callable
        The files that ``read`` opens, for the records of a run; raises a DataError if there are none.
    forecast_error : str
        The value of ``wind.forecast_error=auto``, if the readings do not state their model: ``none`` for
        a wind that has no forecast's errors, such as one from a formula.
    modelled : bool
        The readings are fields of a weather model, whose age and analyses count; not observations. The
        packaged sample has analyses of one day only.
    reads_path : bool
        Whether a source of this package reads ``wind.path``.
    level : str
        ``selected``: the wind at ``wind.level`` is read from files that state levels. ``stated``: tables do
        not state their level, ``wind.level`` does.
    current : bool
        The readings are currents of the sea.
    live : bool
        It downloads a forecast.
    """

    read: Callable[[WindConfig, Any], Readings]
    files: Callable[[WindConfig, Any], tuple[Path, ...]]
    forecast_error: str = "gfs"
    modelled: bool = True
    reads_path: bool = False
    level: str = SELECTED
    current: bool = False
    live: bool = False


class WindFormats(NamedTuple):
    """The readers of files of others: the object ``winds`` of the entry points ``pareto_ltl.formats``.

    Attributes
    ----------
    sources : mapping of str to WindSource
        The values of ``wind.source``.
    source_of_path : callable
        The value of ``wind.source`` for a file, a folder or a pattern; DataError if there is none.
    """

    sources: Mapping[str, WindSource]
    source_of_path: Callable[[str | Path], str]


@lru_cache
def wind_formats() -> WindFormats:
    """The installed readers of wind files."""
    found: WindFormats = FORMATS.required("winds")
    return found


def wind_sources() -> Mapping[str, WindSource]:
    """The values of ``wind.source``, without the sources of other packages."""
    return wind_formats().sources


LAW_WORDS = ("auto", "none", "gfs", "icon_eu", "ecmwf_class", "hourly_fine", "currents", "gfs_one_part")
NOAA_MODELS = ("gfs", "hrrr", "gefs")
GP_KERNELS = ("matern12", "matern32", "rbf")


@dataclass
class WindConfig(CheckedSettings, section="wind"):
    """Wind readings, the Gaussian process that is fitted to them, and the modes of its error."""

    acts: ClassVar = {"base_url": "download from {}"}
    source: str = setting("sample", "where readings come from", kinds=wind_sources, group=WIND_SOURCES)
    path: str | None = setting(None, "file, folder or pattern, for the sources that read files")
    kernel: str = setting("matern12", "kernel of the Gaussian process", choices=GP_KERNELS)
    noise_min: float = setting(
        0.3, "lower bound of the white-noise standard deviation", "(0, 100]", unit="m/s"
    )
    spacing: float = setting(25_000.0, "spacing of the wind lattice", "(0, 1e7]", unit="m")
    padding: float = setting(150_000.0, "how far the lattice extends beyond the scene", "[0, 1e7]", unit="m")
    ball: float = setting(2.0, "radius of the maximum-trace ball, in standard deviations", "[0, 100]")
    level: str = setting(
        "auto",
        "height of the wind, e.g. 10m, 80m or 925hPa, or depth of the current; auto: robot.level if it is "
        "set, else 10m (0m for currents). Tables do not state their height: set it; auto: 10m",
    )
    forecast_error: str = setting(
        "auto",
        "law of forecast errors: none, gfs, icon_eu, ecmwf_class, hourly_fine (HRRR, NBM), currents, "
        "gfs_one_part (the law of versions before 1.0) or a file of `pareto-ltl wind-error`; auto: the law "
        "of the model of the forecast where it is known, else gfs; currents for currents of the sea; none "
        "for the packaged sample and stations",
    )
    ensemble_prior: float = setting(
        10.0,
        "weight of the law of forecast errors relative to an ensemble, as a number of members",
        "[0, 1e6]",
    )
    max_gap: float = setting(
        6.0, "longest allowed gap between two fields, and longest time for hold_last", "(0, 1e5]", unit="h"
    )
    hold_last: bool = setting(False, "use the last wind field for later times, at most max_gap long")
    max_speed: float = setting(75.0, "readings above this are refused", "(0, 1000]", unit="m/s")
    holdout: float = setting(0.2, "share of the readings held out to score the fit", "(0, 1)")
    max_points: int = setting(
        600,
        "largest number of readings at each time that the fit uses: all on and beside the map (within "
        "wind.padding), of those farther away a subset spread evenly",
        "[5, 10_000]",
    )
    energy: float = setting(
        0.99, "share of the posterior variance in the coherent modes; the rest is white", "(0, 1)"
    )
    modes_max: int = setting(64, "largest number of modes of a component", "[1, 10_000]")
    modes_spacing: float = setting(50_000.0, "spacing of the lattice of the modes", "(0, 1e7]", unit="m")
    rho: float | None = setting(
        None,
        "correlation of wind errors from one time slot to the next; null: fitted",
        "[0, 1]",
        remark="0: a new field at every wind time, 1: one frozen field",
    )
    gust_time: float = setting(
        1800.0,
        "time constant of the white part with law=coherent, twice the integral of its correlation: over a "
        "time T it displaces a flight with the standard deviation noise x sqrt(gust_time T)",
        "(0, 1e9]",
        unit="s",
    )
    cache: bool = setting(True, "keep fits between runs")
    model: str = setting("gfs", "model that source=noaa fetches", choices=NOAA_MODELS)
    cycle: str = setting(
        "newest", "start of the forecast that is downloaded: newest, or a time, ISO 8601 UTC"
    )
    hours: float = setting(
        36.0, "duration after departure for which a forecast is downloaded", "(0, 384]", unit="h"
    )
    members: int = setting(
        1,
        "members that are downloaded of an ensemble (model=gefs, sources aigefs, ifs, aifs); 1: the control "
        "forecast only",
        "[1, 51]",
    )
    gefs_members: int = setting(1, "former name of wind.members", "[1, 31]")
    base_url: str | None = setting(
        None, "address from which forecasts are downloaded instead of the usual one, with the same folders"
    )
    offline: bool = setting(False, "of downloaded forecasts, use only files that were fetched before")
    retries: int = setting(4, "number of retries after a failure of a download", "[0, 20]")

    def check_combinations(self) -> None:
        """Refuse a source without its file, a cycle that is not a time and an address that is not HTTP(S)."""
        kind = wind_sources().get(self.source)
        if kind is not None and kind.reads_path and not self.path:
            raise ConfigError(f"wind.path is missing: wind.source={self.source} needs a file to read")
        if kind is not None and not kind.reads_path and self.path:
            raise ConfigError(
                f"wind.path={shown_text(self.path)} is not read by wind.source={self.source}: leave out "
                f"wind={self.source}, and the source follows from the file, or leave out wind.path"
            )
        if self.model != NOAA_MODELS[0] and self.source in wind_sources() and self.source != "noaa":
            raise ConfigError(f"wind.model={self.model} is of wind=noaa, and wind.source is {self.source}")
        if self.cycle != "newest":
            check_time("wind.cycle", self.cycle)
        if self.base_url is not None and not self.base_url.startswith(("https://", "http://")):
            raise wrong_value("wind.base_url", "begin with https:// (or http://)", self.base_url)

    @property
    def reads_path(self) -> bool:
        """Whether the source, one of this package, reads ``wind.path``."""
        kind = wind_sources().get(self.source)
        return kind is not None and kind.reads_path

    def instead_of(self, before: WindConfig) -> WindConfig:
        """These settings; where a table that states no level replaces files, without their level."""
        kind = wind_sources().get(self.source)
        if self.source == before.source or kind is None or kind.level != STATED:
            return self
        return replace(self, level=usual_level(self.source, before.level))


def usual_level(source: str, flown: str | None) -> str:
    """The value of ``wind.level=auto``; ``flown`` is ``robot.level``.

    A table for a robot in the water has the current at its depth. The height of the winds in other tables is
    not known from the height of the robot: it is 10 m unless ``wind.level`` states it.
    """
    kind = wind_sources().get(source)
    level = SELECTED if kind is None else kind.level
    if flown and (level == SELECTED or (level == STATED and "depth" in flown)):
        return flown
    return "0m" if kind is not None and kind.current else "10m"
