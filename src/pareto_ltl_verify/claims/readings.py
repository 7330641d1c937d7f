"""Claims about the readings of the wind: the wind files of the run are read once more, by a second reader."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.claims import Claim, Verdict, no_fault, within
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.geometry import in_plane, on_earth
from pareto_ltl_verify.readers.fields import Field, UnreadError, on_unit_sphere
from pareto_ltl_verify.sources import WindFiles
from pareto_ltl_verify.wind_fit import Fit
from pareto_ltl_verify.wind_tables import level_of

NAMES = ("wind: times of the readings agree with the files", "wind: readings agree with the files")
MOST_BYTES = 2**31  # of all files together
HALF_HOUR = 1800.0  # [s] reports of stations belong to the nearest full hour
EARTH = 6_371_000.0  # [m]
NEAR = 100.0  # [m] places that are closer are the same place
NORTH = 1e-4  # [deg] step of the difference that gives true north in the plane
LIMITS = {False: (1e-3, 1e-4), True: (0.05, 0.01)}  # by whether winds were turned: [m/s], share of the speed
DAMAGE = (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError, ArithmeticError, EOFError)


class Sources(NamedTuple):
    """The fields of the files of a run; ``zero`` is the departure [s since 1970].

    ``models``: originating centres and generating processes of GRIB files.
    """

    fields: list[Field]
    zero: float
    models: frozenset[str] = frozenset()


def models_of(result: Evidence) -> frozenset[str] | None:
    """Centre and process of each model in the GRIB files of a run; None if they are not read once more."""
    found = _read_again(result)
    return None if found is None else found.models


def unread_reason(result: Evidence) -> str | None:
    """Why the wind files of ``result`` are not read once more; None if they are, or there are none."""
    if result.wind.fit is None:
        return None
    try:
        _sources(result)
    except UnreadError as error:
        return str(error)
    return None


def times(result: Evidence) -> Verdict | None:
    """Each slot has a valid time of the files, none between them is left out, and leads are as stated."""
    found = _read_again(result)
    if found is None:
        return None
    wind, reports = result.wind, result.source_row.reports
    slots = found.zero + wind.times
    if reports:
        there = np.unique(np.round([field.time / 3600.0 for field in found.fields])) * 3600.0
    else:
        there = np.unique([field.time for field in found.fields])
    last = max(float(slots[-1]), found.zero)
    between = there[(there > slots[0] - 1.0) & (there < last + 1.0)]
    lost = {f"no field at {t:.0f} s": np.abs(there - found.zero - t).min(initial=np.inf) > 1.0
            for t in wind.times}  # fmt: skip
    skipped = {f"a field at {t - found.zero:.0f} s is left out": np.abs(slots - t).min() > 1.0
               for t in between}  # fmt: skip
    faults = [lost, {} if result.has_ensemble or reports else skipped]
    for slot, lead in zip(slots, wind.leads, strict=True):
        newest = np.array([f.lead for f in found.fields if abs(f.time - slot) < 1.0])
        if len(newest) and np.isfinite(newest).all() and not reports:
            faults.append({f"lead {lead:.0f} s is {newest.min():.0f}": abs(lead - newest.min()) > 1.0})
    return no_fault(f"{len(slots)} times", *faults)


def values(result: Evidence) -> Verdict | None:
    """Each reading stands at a node of the newest field of its time, and has its wind, turned into the plane.

    The mean of an ensemble is the mean of all fields of the time. A report of a station belongs to the hour.
    """
    found = _read_again(result)
    if found is None:
        return None
    fit, crs = result.wind.fit, result.scene["crs"]
    assert fit is not None
    worst, count = 0.0, 0
    for k, slot in enumerate(found.zero + result.wind.times):
        fields = _fields_of_slot(result, found.fields, float(slot))
        if not fields:
            return Verdict(f"slot {k}", "no field at its time in the files", False)
        gap, ratio = _compared(fit, k, fields, crs)
        if gap > NEAR:
            return Verdict(f"slot {k}", f"a reading stands {gap:.3g} m from all nodes", False)
        worst, count = max(worst, ratio), count + len(fit.points[k])
    return within(f"{count} readings", worst, 1.0, " tolerances")


def _compared(fit: Fit, k: int, fields: Sequence[Field], crs: str | None) -> tuple[float, float]:
    """Largest distance [m] of a reading of slot ``k`` to the nearest place, largest ratio to the tolerance.

    Of several places that are near, as stations may be, the one whose wind is most alike counts.
    """
    from scipy.spatial import cKDTree

    points, winds = fit.points[k], fit.winds[k]
    places = np.concatenate([field.places for field in fields])
    there = np.concatenate([field.winds for field in fields])
    if crs is None or fields[0].plane:
        near, target = places, points
    else:
        lonlat = on_earth(crs, points).T
        north = _north(crs, points, lonlat)
        near, target = (EARTH * on_unit_sphere(*p.T) for p in (places, lonlat))
        east = np.stack([north[:, 1], -north[:, 0]], axis=1)  # the plane is conformal
        winds = np.stack([(winds * east).sum(axis=1), (winds * north).sum(axis=1)], axis=1)
    tree = cKDTree(near)
    gaps = np.asarray(tree.query(target)[0], float)
    if gaps.max() > NEAR:
        return float(gaps.max()), np.inf
    least, share = LIMITS[any(field.turned for field in fields)]
    ratios = []
    for rows, wind in zip(tree.query_ball_point(target, NEAR), winds, strict=True):
        off = np.hypot(*(there[rows] - wind).T) / (least + share * np.hypot(*there[rows].T))
        ratios.append(float(off.min()))
    return float(gaps.max()), max(ratios)


def _north(crs: str, points: FloatArray, lonlat: FloatArray) -> FloatArray:
    """The direction (N, 2) of true north in the plane at ``points`` (N, 2) [m], by a difference."""
    step = np.where(lonlat[:, 1] > 0, -NORTH, NORTH)  # not beyond a pole
    ahead = in_plane(crs, np.column_stack([lonlat[:, 0], lonlat[:, 1] + step]))
    north = (ahead - points) * np.sign(step)[:, None]
    return np.asarray(north / np.hypot(*north.T)[:, None], float)


def _fields_of_slot(result: Evidence, fields: Iterable[Field], slot: float) -> list[Field]:
    """The fields whose winds the readings of a slot have."""
    if result.source_row.reports:
        return [field for field in fields if abs(field.time - slot) <= HALF_HOUR + 1.0]
    now = [field for field in fields if abs(field.time - slot) < 1.0]
    return sorted(now, key=lambda field: (np.isnan(field.lead), field.lead))[:1]


# --- the files ---------------------------------------------------------------------------------


def _read_again(result: Evidence) -> Sources | None:
    """The fields of the files; None if they are not read or the air is calm."""
    try:
        return None if result.wind.fit is None else _sources(result)
    except UnreadError:
        return None


def wind_files(result: Evidence) -> list[Path]:
    """The wind files of a run, unchanged; UnreadError if one is gone or was changed."""
    settings = result.settings
    others = [settings["scene"].get("file"), *(settings["scene"].get("zones") or ())]
    others += [settings["mission"].get("automaton"), settings["wind"]["forecast_error"]]
    others.append(settings["selection"].get("extra_paths"))
    known = {Path(str(name)).expanduser() for name in others if name}
    known |= {path / "front.npz" for path in known}
    named = [path for name in result.run["inputs"] if (path := Path(name)) not in known]
    if not named:
        raise UnreadError("run.json names no wind file")
    files = [result.moved_input(path) for path in named]
    for path, old in zip(files, named, strict=True):
        if not path.is_file():
            raise UnreadError(f"the wind file {path.name} is no longer where run.json says")
        if path == old and not result.is_input(path):
            raise UnreadError(f"the wind file {path.name} has changed since the run")
    if sum(path.stat().st_size for path in files) > MOST_BYTES:
        raise UnreadError("the wind files have more than 2 GiB")
    return files


def _sources(result: Evidence) -> Sources:
    """The fields of the files of a run; UnreadError if the second reader does not read them."""
    key = "second reading of the wind"
    if key not in result.remembered:
        try:
            result.remembered[key] = _fields(result)
        except UnreadError as error:
            result.remembered[key] = error
        except DAMAGE as error:
            reason = " ".join(str(error).split())[:80] or type(error).__name__
            result.remembered[key] = UnreadError(f"the second reader does not read the wind files ({reason})")
    found = result.remembered[key]
    if isinstance(found, UnreadError):
        raise found
    assert isinstance(found, Sources)
    return found


def _fields(result: Evidence) -> Sources:
    wind, zero = result.wind, result.scene["time_zero"]
    start = 0.0 if zero is None else datetime.fromisoformat(zero).timestamp()
    span = (start + float(wind.times[0]), start + max(float(wind.times[-1]), 0.0))
    if zero is None:  # the clock begins with the wind
        span = (-np.inf, np.inf)
    files = WindFiles(partial(wind_files, result), level_of(wind.level)[:2], span)
    fields, models = result.source_row.read(files)
    if not fields:
        raise UnreadError("the second reader finds no wind in the files")
    return Sources(fields, start if zero is not None else min(field.time for field in fields), models)


CLAIMS: tuple[Claim, ...] = (
    Claim(NAMES[0], ("wind.nc", "scene.json"), times),
    Claim(NAMES[1], ("wind.nc", "scene.json"), values),
)
