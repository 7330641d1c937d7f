"""GRIB files decoded in a process of their own, since ecCodes can end its process on a damaged message.

``python -m pareto_ltl.wind.sources.grib_apart FOLDER`` reads ``task.json`` there and writes ``answer.json``
and ``arrays.npz``; the caller sees a process that died as one line about a damaged file.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_json
from pareto_ltl.support.reading import read_json
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.sources.grib_files import read_grib_files

TASK, ANSWER, ARRAYS = "task.json", "answer.json", "arrays.npz"


def read_grib_apart(files: tuple[Path, ...], max_speed: float) -> Readings:
    """:func:`read_grib_files` in another process.

    Raises
    ------
    DataError
        As there, and if the process ends without an answer.
    """
    with tempfile.TemporaryDirectory(prefix="pareto_ltl_grib_") as folder:
        place = Path(folder)
        write_json(place / TASK, {"files": list(map(str, files)), "max_speed": max_speed})
        command = [sys.executable, "-m", __name__, folder]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        if not (place / ANSWER).is_file():
            at = done.stdout.splitlines()[-1:] or [str(files[0])]
            raise DataError(
                f"wind file {at[0]} is damaged: ecCodes, its decoder, ended with code {done.returncode}; "
                "download it again"
            )
        return _readings_of(place, files)


def _readings_of(place: Path, files: tuple[Path, ...]) -> Readings:
    told = read_json(place / ANSWER)
    if "error" in told:
        raise DataError(told["error"])
    with np.load(place / ARRAYS, allow_pickle=False) as arrays:
        slots = range(len(told["remarks"]))
        return Readings(
            times=arrays["times"],
            points=tuple(arrays[f"points_{k}"] for k in slots),
            winds=tuple(arrays[f"winds_{k}"] for k in slots),
            geographic=True,
            files=files,
            remarks=tuple(told["remarks"]),
            origins=tuple(tuple(files[at] for at in owners) for owners in told["origins"]),
            leads=arrays["leads"],
        )


def _answer(place: Path) -> None:
    """Do the task in ``place``."""
    task = read_json(place / TASK)
    files = tuple(map(Path, task["files"]))
    try:
        content = _content(place, read_grib_files(files, task["max_speed"], tell=_tell), files)
    except DataError as error:
        content = {"error": str(error)}
    write_json(place / ANSWER, content)


def _tell(file: Path) -> None:
    print(file, flush=True)


def _content(place: Path, readings: Readings, files: tuple[Path, ...]) -> dict[str, Any]:
    arrays = {"times": readings.times, "leads": readings.leads}
    for k, (points, winds) in enumerate(zip(readings.points, readings.winds, strict=True)):
        arrays |= {f"points_{k}": points, f"winds_{k}": winds}
    np.savez(place / ARRAYS, **arrays)  # type: ignore[arg-type, unused-ignore]
    origins = [[files.index(file) for file in owners] for owners in readings.origins]
    return {"remarks": readings.remarks, "origins": origins}


if __name__ == "__main__":
    _answer(Path(sys.argv[1]))
