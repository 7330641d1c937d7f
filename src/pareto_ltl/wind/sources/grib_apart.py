"""Decoding of GRIB files in a separate process, since ecCodes can end its process on a damaged message.

``python -m pareto_ltl.wind.sources.grib_apart TASK ANSWER`` gets the arguments of :func:`grib_snapshots` as
JSON.
It prints each file before it is opened, and writes one archive of arrays, which holds no code. If the process
ends without it, the caller raises a DataError on the file that was open.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import asdict, astuple
from pathlib import Path
from typing import Any

import numpy as np

from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.area import GeoBox
from pareto_ltl.wind.levels import parse_level
from pareto_ltl.wind.snapshots import Snapshot, Snapshots
from pareto_ltl.wind.sources.grib_files import grib_snapshots

ARRAYS = ("points", "winds")  # of a snapshot; the rest is written as JSON


def grib_snapshots_apart(
    files: tuple[Path, ...], max_speed: float, level: str = "10m", area: GeoBox | None = None
) -> Snapshots:
    """:func:`grib_snapshots` in another process.

    Raises
    ------
    DataError
        As :func:`grib_snapshots`, and if the process ends without an answer.
    """
    parse_level(level)
    box = None if area is None else astuple(area)
    task = {"files": [str(file) for file in files], "max_speed": max_speed, "level": level, "area": box}
    with tempfile.TemporaryDirectory(prefix="pareto_ltl_grib_") as folder:
        answer = Path(folder) / "answer.npz"
        command = [sys.executable, "-m", __name__, json.dumps(task), str(answer)]
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
        if not answer.is_file():
            at = done.stdout.splitlines()[-1:] or [str(files[0])]
            raise DataError(
                f"wind file {at[0]} is damaged: ecCodes, its decoder, ended with code {done.returncode}; "
                "download it again"
            )
        with np.load(answer, allow_pickle=False) as arrays:
            return _read_answer(dict(arrays))


def _read_answer(arrays: dict[str, Any]) -> Snapshots:
    header = json.loads(arrays["told"].item())
    if "error" in header:
        raise DataError(header["error"])
    rows = [
        row | {name: arrays[f"{name}_{row[name]}"] for name in ARRAYS} | {"files": _paths(row["files"])}
        for row in header["rows"]
    ]
    return Snapshots(tuple(Snapshot(**row) for row in rows), _paths(header["files"]), tuple(header["notes"]))


def _paths(names: list[str]) -> tuple[Path, ...]:
    return tuple(map(Path, names))


def _answer(task: dict[str, Any], answer: Path) -> None:
    """In the separate process: carry out ``task``; each array is written once."""
    area = None if task["area"] is None else GeoBox(*task["area"])
    arrays: dict[str, Any] = {}
    try:
        found = grib_snapshots(
            _paths(task["files"]),
            task["max_speed"],
            task["level"],
            area,
            lambda file: print(file, flush=True),
        )
    except (DataError, ConfigError) as error:
        header: dict[str, Any] = {"error": str(error)}
    else:
        rows = []
        for snap in found.winds:
            row = asdict(snap) | {name: id(getattr(snap, name)) for name in ARRAYS}
            rows.append(row | {"files": [str(file) for file in snap.files]})
            arrays |= {f"{name}_{row[name]}": getattr(snap, name) for name in ARRAYS}
        header = {"rows": rows, "files": [str(file) for file in found.files], "notes": found.notes}
    part = answer.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez(stream, told=np.array(json.dumps(header)), **arrays)
    part.rename(answer)


if __name__ == "__main__":
    _answer(json.loads(sys.argv[1]), Path(sys.argv[2]))
