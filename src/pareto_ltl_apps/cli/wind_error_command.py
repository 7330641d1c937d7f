"""``pareto-ltl wind-error DIR``: errors of past forecasts, as a law to plan with and a figure."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from careful_io.messages import shown_value
from careful_io.times import HOUR
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.cli.output import Answer
from pareto_ltl_apps.cli.wind_table_command import check_table, estimate_from_table

if TYPE_CHECKING:
    from pareto_ltl.extend import GeoBox, Snapshot
    from pareto_ltl_apps.wind_errors.error_estimate import ErrorEstimate, ErrorTable
    from pareto_ltl_apps.wind_errors.matched_fields import Interval, Resampling
    from wind_laws.forecast_error import ForecastError

EVERYWHERE = "all"
LONGEST_NAME = 200  # as the schema has it


def wind_error(options: Namespace) -> Answer:
    """Estimate and write a law of errors, or compare a table with one."""
    if options.check is not None or options.law is not None:
        return check_table(options)
    if options.folder is None:
        raise ConfigError("the following arguments are required: DIR; see pareto-ltl wind-error --help")
    if options.folder.is_file():
        return estimate_from_table(options)
    area = outline_of(options.area)
    files = _files_in(options.folder)
    check_out(options.out, options.folder)
    for file in options.stations:
        if not file.is_file():
            raise ConfigError(f"--stations {file}: there is no such file; name tables of METAR reports")
    import numpy as np

    from careful_io.files import write_json
    from pareto_ltl.extend import GeoBox, WindConfig, first_law
    from pareto_ltl_apps.view.wind_error import draw_wind_error
    from pareto_ltl_apps.wind_errors.error_estimate import error_document, estimate_errors, estimated_law
    from pareto_ltl_apps.wind_errors.full_winds import full_winds
    from pareto_ltl_apps.wind_errors.matched_fields import Resampling

    box = None if area is None else GeoBox.around(np.array(area, float))
    snapshots = full_winds(files, WindConfig(level=options.level), box).winds
    draws = Resampling(options.seed, options.block)
    estimate = estimate_errors(snapshots, area, draws, HOUR * options.max_lag)
    usual = first_law()
    law = estimated_law(estimate, options.name or options.folder.resolve().name[:LONGEST_NAME], usual)
    reported = _told_by_stations(snapshots, options.stations, box, draws)
    document = error_document(estimate, law, usual.name, (*files, *options.stations), reported)
    write_json(options.out, document)
    drawn = draw_wind_error(options.out.parent, options.out.stem, estimate, law, usual)
    written = (options.out, *drawn)
    lines = [
        *estimate_lines(estimate, law, usual),
        f"analysis error: {analysis_text(reported)}",
        f"wrote {', '.join(map(str, written))}",
    ]
    return Answer({**document, "written": written}, lines, written)


def outline_of(text: str | None) -> list[list[float]] | None:
    """Corners of ``--area``; None for all nodes; the contiguous United States if it is not given.

    Raises
    ------
    ConfigError
        If it is not at least three corners ``longitude,latitude`` of a simple outline.
    """
    from pareto_ltl_apps.formats.settings import check_outline
    from pareto_ltl_apps.studies.settings import ForecastTestConfig

    if text is None:
        return [list(corner) for corner in ForecastTestConfig().area]
    if text == EVERYWHERE:
        return None
    with suppress(ValueError):
        corners = [[float(number) for number in corner.split(",")] for corner in text.split()]
        if len(corners) >= 3 and all(len(corner) == 2 for corner in corners):
            check_outline("--area", corners)
            return corners
    raise ConfigError(
        f"--area {shown_value(text)}: expected at least three corners longitude,latitude with spaces between "
        f"them, for example --area '-100,30 -90,30 -95,40', or {EVERYWHERE}"
    )


def check_out(out: Path, read: Path) -> None:
    """ConfigError if the law cannot be written to ``out``, or would be written into the folder ``read``."""
    if out.suffix != ".json":
        raise ConfigError(f"--out {out}: the law is written as JSON; name it .json")
    if out.parent.resolve() == read.resolve():
        raise ConfigError(f"--out {out}: this is the folder that is read; write into another one")
    if not out.parent.is_dir():
        raise ConfigError(f"--out {out}: there is no folder {out.parent}; make it, or name another file")


def _files_in(folder: Path) -> tuple[Path, ...]:
    from pareto_ltl.support.file_formats import is_data_file

    if not folder.is_dir():
        raise ConfigError(f"{folder}: there is no such folder; name one with GRIB files of past forecasts")
    files = tuple(sorted(file for file in folder.iterdir() if file.is_file() and is_data_file(file)))
    if not files:
        raise DataError(f"{folder}: the folder holds no GRIB file; name one with past forecasts and analyses")
    return files


def _told_by_stations(
    snapshots: Sequence[Snapshot], files: Sequence[Path], box: GeoBox | None, draws: Resampling
) -> dict[str, float] | str:
    """The error of analyses from station reports, or why it is not known."""
    if not files:
        return "not estimated: no station reports were given (--stations)"
    from pareto_ltl.extend import WindConfig
    from pareto_ltl_apps.formats.station_files import read_station_files
    from pareto_ltl_apps.wind_errors.matched_fields import analysis_error

    return analysis_error(snapshots, read_station_files(tuple(files), WindConfig().max_speed, box), draws)


# --- what is printed -------------------------------------------------------------------------


def estimate_lines(estimate: ErrorEstimate, law: ForecastError, usual: ForecastError) -> Iterator[str]:
    """Lines of text: the tables with the packaged law, the scalars, and what the data do not determine."""
    from pareto_ltl_apps.wind_errors.error_estimate import unknown_parts

    other = usual.for_winds(estimate.level, estimate.spread)
    yield (
        f"{estimate.cycles} cycles, {estimate.nodes} nodes, winds at {estimate.level} that spread by "
        f"{estimate.spread:.2f} m/s; sd of one component, 95 % intervals"
    )
    if estimate.forecast is not None:
        at = other.forecast_variance(estimate.forecast.at) ** 0.5
        yield from _table_lines("lead", estimate.forecast, at.tolist(), usual.name)
    at = other.change_variance(estimate.change.at) ** 0.5
    yield from _table_lines("change", estimate.change, at.tolist(), usual.name)
    lengths = (
        ("length of the error", estimate.forecast_length.length, law.forecast_length),
        ("length of the change", estimate.change_length.length, law.change_length),
    )
    for name, found, used in lengths:
        yield f"{name:<22}{used / 1e3:.0f} km {_interval(found, 1e-3, 0)}"
    found = estimate.persistence.value
    step = law.persistence_time / HOUR
    yield f"{'persistence':<22}{law.persistence:.2f} over {step:g} h {_interval(found, 1.0, 2)}"
    for what, why in unknown_parts(estimate).items():
        yield f"note: {what}: {why}; taken from {usual.name}"
    for note in estimate.notes:
        yield f"note: {note}"


def analysis_text(reported: Mapping[str, float] | str) -> str:
    """The error of analyses in words."""
    if isinstance(reported, str):
        return reported
    return (
        f"{reported['sd']:.2f} m/s (95 %: {reported['sd_low']:.2f} to {reported['sd_high']:.2f}) from "
        f"{reported['reports']:,} reports at {reported['times']} times; noise of a station "
        f"{reported['station_noise']:.2f} m/s"
    )


def _table_lines(what: str, table: ErrorTable, usual: Sequence[float], name: str) -> Iterator[str]:
    yield f"{what:<8}{'m/s':>6}  {'95 % interval':<15}{name:>6}{'pairs':>7}  from"
    for at, sd, other, pairs, way in zip(table.at, table.sd, usual, table.pairs, table.ways, strict=True):
        ends = f"{sd.low:.2f} to {sd.high:.2f}"
        yield f"{f'{at / HOUR:g} h':<8}{sd.value:>6.2f}  {ends:<15}{other:>6.2f}{pairs:>7}  {way}"


def _interval(found: Interval | None, unit: float, digits: int) -> str:
    if found is None:
        return "(not from these data)"
    return f"(95 %: {found.low * unit:.{digits}f} to {found.high * unit:.{digits}f})"
