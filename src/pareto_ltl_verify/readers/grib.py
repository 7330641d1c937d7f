"""Winds and currents of GRIB files, decoded with ecCodes in a separate process, which damaged files can end.

``python -m pareto_ltl_verify.readers.grib TASK ANSWER`` decodes the messages that the JSON text ``TASK``
names and writes them to the archive ``ANSWER``.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from careful_io.archives import read_npz
from pareto_ltl_verify.arrays import FloatArray
from pareto_ltl_verify.readers.fields import FROM, SPEED, TOWARDS, Component, U, UnreadError, V, axis_angle

PARAMETERS = {  # of editions 2 (discipline, category, number) and 1 (table of the WMO), of winds
    (0, 2, 2): U, (0, 2, 3): V, (0, 2, 1): SPEED, (0, 2, 0): FROM, 33: U, 34: V, 32: SPEED, 31: FROM,
}  # fmt: skip
CURRENT_PARAMETERS = {
    (10, 1, 2): U, (10, 1, 3): V, (10, 1, 1): SPEED, (10, 1, 0): TOWARDS, 49: U, 50: V, 48: SPEED,
    47: TOWARDS,
}  # fmt: skip
LEVELS = {
    "heightAboveGround": ("height", 1.0), "isobaricInhPa": ("pressure", 100.0),
    "isobaricInPa": ("pressure", 1.0), "depthBelowSea": ("depth", 1.0), "oceanSurface": ("depth", 0.0),
    "surface": ("depth", 0.0), "meanSea": ("depth", 0.0),
}  # fmt: skip
STRAIGHT = ("regular_ll", "regular_gg", "reduced_ll", "reduced_gg", "mercator")  # axes are east and north
MEANS = (0, 1, 6)  # code table 4.7
LONGEST = 600.0  # [s] of the separate process


def grib_components(
    files: Sequence[Path], level: tuple[str, float], times: Sequence[float]
) -> tuple[list[Component], frozenset[str]]:
    """The components at ``level`` (kind, value) from the first to the last of ``times`` [s since 1970].

    Also the models of all components: originating centre and generating process. UnreadError if they are not
    read.
    """
    from importlib.util import find_spec

    if find_spec("eccodes") is None:
        raise UnreadError("ecCodes, which reads GRIB, is not installed")
    task = json.dumps([[str(file) for file in files], level, [min(times), max(times)]])
    with tempfile.TemporaryDirectory(prefix="pareto_ltl_verify_") as folder:
        answer = Path(folder) / "answer.npz"
        command = [sys.executable, "-m", __name__, task, str(answer)]
        try:
            subprocess.run(command, capture_output=True, check=False, timeout=LONGEST)
        except subprocess.TimeoutExpired:
            raise UnreadError(f"ecCodes takes longer than {LONGEST:g} s to decode the files") from None
        if not answer.is_file():
            raise UnreadError("ecCodes cannot decode the files")
        arrays = read_npz(answer)
    reported = json.loads(arrays["told"].item())
    if isinstance(reported, str):
        raise UnreadError(reported)
    components = [
        Component(kind, time, lead, member, arrays[places], arrays[values], arrays.get(turn))
        for kind, time, lead, member, places, values, turn in reported
    ]
    return components, frozenset(arrays["models"].tolist())


# --- in the separate process -------------------------------------------------------------------


def _answer(task: str, answer: Path) -> None:
    names, (kind, value), (first, last) = json.loads(task)
    arrays: dict[str, Any] = {}
    grids: dict[str, tuple[str, str]] = {}
    reported: Any = []
    models: set[str] = set()
    try:
        for name in names:
            for get, values_of in _messages(Path(name)):
                if (part := _component(get, kind)) is not None:
                    models.add(f"{get('centre')} {get('generatingProcessIdentifier', int)}")
                part = part if _wanted(get, kind, value) else None
                time = None if part is None else _moment(get, "validity")
                if part is None or time is None or not first - 1.0 <= time <= last + 1.0:
                    continue
                grid = str(get("md5GridSection"))
                if grid not in grids:
                    grids[grid] = f"places_{len(grids)}", f"turn_{len(grids)}"
                    places, turn = _grid(get, values_of)
                    arrays |= {grids[grid][0]: places} | ({} if turn is None else {grids[grid][1]: turn})
                arrays[f"values_{len(reported)}"] = _values(get, values_of)
                start = _moment(get, "data")
                lead = float("nan") if start is None else time - start
                reported.append((part, time, lead, _member(get), grids[grid][0], f"values_{len(reported)}",
                             grids[grid][1] if part in (U, V) else ""))  # fmt: skip
    except UnreadError as error:
        reported = str(error)
    partial = answer.with_suffix(".part")
    with partial.open("wb") as stream:
        np.savez(stream, told=np.array(json.dumps(reported)), models=np.array(sorted(models), str), **arrays)
    partial.rename(answer)


def _messages(path: Path) -> Iterator[tuple[Any, Any]]:
    """For each message a function of its keys, None for those that it lacks, and one of its arrays."""
    import eccodes

    eccodes.codes_grib_multi_support_on()  # u and v in one message, as in nests of NAM
    with path.open("rb") as stream:
        while (handle := eccodes.codes_grib_new_from_file(stream)) is not None:

            def get(key: str, kind: Any = None, handle: Any = handle) -> Any:
                try:
                    return eccodes.codes_get(handle, key, kind)
                except eccodes.CodesInternalError:
                    return None

            def array(key: str, handle: Any = handle) -> FloatArray:
                return np.asarray(eccodes.codes_get_array(handle, key), float)

            yield get, array
            eccodes.codes_release(handle)


def _component(get: Any, kind: str) -> str | None:
    """The component that a message holds; None if it is something else."""
    table = CURRENT_PARAMETERS if kind == "depth" else PARAMETERS
    if get("edition", int) == 2:
        key: Any = tuple(get(name, int) for name in ("discipline", "parameterCategory", "parameterNumber"))
        return table.get(key)
    if (get("table2Version", int) or 0) <= 3:
        return table.get(get("indicatorOfParameter", int))
    named = re.fullmatch(r"\d*([uv])", str(get("shortName"))) if kind != "depth" else None
    return None if named is None else named[1]


def _wanted(get: Any, kind: str, value: float) -> bool:
    """Whether a message is at the level and holds values of an instant."""
    there, factor = LEVELS.get(str(get("typeOfLevel")), ("", 1.0))
    height = (get("level", float) or 0.0) * factor
    if there != kind or abs(height - value) > 1e-3 * max(value, 1.0):
        return False
    derived = get("derivedForecast", int)
    other = get("percentileValue") is not None or get("probabilityType") is not None
    return get("stepType") == "instant" and not other and (derived is None or derived in MEANS)


def _moment(get: Any, name: str) -> float | None:
    """Seconds since 1970 of the keys ``nameDate`` and ``nameTime``."""
    date, clock = get(f"{name}Date", int), get(f"{name}Time", int)
    if date is None or clock is None:
        return None
    try:
        day = datetime.strptime(f"{date:08d}", "%Y%m%d").replace(tzinfo=UTC)
    except ValueError:
        return None
    return float(day.timestamp() + 3600.0 * (clock // 100) + 60.0 * (clock % 100))


def _member(get: Any) -> str:
    if get("derivedForecast", int) is not None:
        return "mean"
    number = get("perturbationNumber", int)
    return "" if number is None else f"{number:02d}"


def _values(get: Any, array: Any) -> FloatArray:
    found: FloatArray = array("values")
    if get("bitmapPresent", int):
        found[found == get("missingValue", float)] = np.nan
    return found


def _grid(get: Any, array: Any) -> tuple[FloatArray, FloatArray | None]:
    """Places (N, 2) [deg] of a grid, and the angle of its rows if components follow them."""
    lon, lat = array("longitudes"), array("latitudes")
    places, kind = np.stack([lon, lat], axis=1), str(get("gridType"))
    if not get("uvRelativeToGrid", int) or kind in STRAIGHT:
        return places, None
    rows, columns = get("Nj", int) or get("Ny", int), get("Ni", int) or get("Nx", int)
    plain = not get("jPointsAreConsecutive", int) and not get("alternativeRowScanning", int)
    if not plain or not rows or not columns or rows * columns != len(lon):
        raise UnreadError(f"the grid of type {kind} has rows in an order that is not read")
    angle = axis_angle(lon.reshape(rows, columns), lat.reshape(rows, columns)).ravel()
    return places, angle + np.pi if get("iScansNegatively", int) else angle


if __name__ == "__main__":
    _answer(sys.argv[1], Path(sys.argv[2]))
