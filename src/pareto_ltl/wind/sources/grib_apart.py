"""Decoding of GRIB files in a separate process, since ecCodes can end its process on a damaged message.

``python -m pareto_ltl.wind.sources.grib_apart FOLDER`` reads ``task.json`` there and writes ``answer.json``
and ``arrays.npz``. If the process ends without an answer, the caller raises a DataError on a damaged file.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.files import write_json
from pareto_ltl.support.reading import read_json
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.levels import parse_level
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.snapshots import Snapshot, latest_readings
from pareto_ltl.wind.sources.grib_files import grib_snapshots

TASK, ANSWER, ARRAYS = "task.json", "answer.json", "arrays.npz"


def read_grib_apart(
    files: tuple[Path, ...], max_speed: float, level: str = "10m", area: GeoBox | None = None
) -> Readings:
    """:func:`read_grib_files` in another process; of several forecasts for one time, the latest.

    Raises
    ------
    DataError
        As :func:`read_grib_files`, and if the process ends without an answer.
    """
    snapshots, notes = read_grib_with_notes(files, max_speed, level, area)
    return latest_readings(snapshots, files, notes)


def read_grib_snapshots(
    files: tuple[Path, ...], max_speed: float, level: str = "10m", area: GeoBox | None = None
) -> tuple[Snapshot, ...]:
    """Every valid time of every cycle and member in ``files``; the errors are those of `read_grib_apart`."""
    return read_grib_with_notes(files, max_speed, level, area)[0]


def read_grib_with_notes(
    files: tuple[Path, ...], max_speed: float, level: str, area: GeoBox | None
) -> tuple[tuple[Snapshot, ...], tuple[str, ...]]:
    """As :func:`read_grib_snapshots`, with notes of quality control."""
    parse_level(level)
    with tempfile.TemporaryDirectory(prefix="pareto_ltl_grib_") as folder:
        place = Path(folder)
        box = None if area is None else astuple(area)
        write_json(
            place / TASK,
            {"files": list(map(str, files)), "max_speed": max_speed, "level": level, "area": box},
        )
        command = [sys.executable, "-m", __name__, folder]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        if not (place / ANSWER).is_file():
            at = done.stdout.splitlines()[-1:] or [str(files[0])]
            raise DataError(
                f"wind file {at[0]} is damaged: ecCodes, its decoder, ended with code {done.returncode}; "
                "download it again"
            )
        return _answer_of(place, files)


def _answer_of(place: Path, files: tuple[Path, ...]) -> tuple[tuple[Snapshot, ...], tuple[str, ...]]:
    told = read_json(place / ANSWER)
    if "error" in told:
        raise DataError(told["error"])
    with np.load(place / ARRAYS, allow_pickle=False) as arrays:
        grids = {name: arrays[name] for name in arrays.files if name.startswith("grid_")}
        snapshots = tuple(
            Snapshot(
                time=float(time),
                lead=float(lead),
                points=grids[f"grid_{row['grid']}"],
                winds=arrays[f"winds_{k}"],
                level=row["level"],
                files=tuple(files[at] for at in row["files"]),
                member=row["member"],
            )
            for k, (time, lead, row) in enumerate(
                zip(arrays["times"], arrays["leads"], told["rows"], strict=True)
            )
        )
    return snapshots, tuple(told["notes"])


def _answer(place: Path) -> None:
    """In the separate process: carry out the task in the folder ``place``."""
    task = read_json(place / TASK)
    files = tuple(map(Path, task["files"]))
    area = None if task["area"] is None else GeoBox(*task["area"])
    try:
        snapshots, _, notes = grib_snapshots(files, task["max_speed"], task["level"], area, _tell)
        content = {"rows": _write_snapshots(place, snapshots, files), "notes": notes}
    except (DataError, ConfigError) as error:
        content = {"error": str(error)}
    write_json(place / ANSWER, content)


def _tell(file: Path) -> None:
    print(file, flush=True)


def _write_snapshots(
    place: Path, snapshots: tuple[Snapshot, ...], files: tuple[Path, ...]
) -> list[dict[str, Any]]:
    """Write the arrays, each grid once; return the other data of each snapshot."""
    arrays: dict[str, FloatArray] = {
        "times": np.array([snap.time for snap in snapshots]),
        "leads": np.array([snap.lead for snap in snapshots]),
    }
    grids: dict[int, int] = {}
    rows = []
    for k, snap in enumerate(snapshots):
        grid = grids.setdefault(id(snap.points), len(grids))
        arrays |= {f"grid_{grid}": snap.points, f"winds_{k}": snap.winds}
        owners = [files.index(file) for file in snap.files]
        rows.append({"grid": grid, "level": snap.level, "files": owners, "member": snap.member})
    np.savez(place / ARRAYS, **arrays)  # type: ignore[arg-type, unused-ignore]
    return rows


if __name__ == "__main__":
    _answer(Path(sys.argv[1]))
