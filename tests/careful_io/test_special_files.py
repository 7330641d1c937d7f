"""Pipes and devices in place of files are refused at once: reading them may never end."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from careful_io.archives import read_npz
from careful_io.fingerprints import file_fingerprint
from careful_io.reading import read_bounded, refuse_special
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.file_formats import first_bytes
from pareto_ltl.wind.sources import data_files
from pareto_ltl.world.scene_files import scene_from_dict, sketch_file
from pareto_ltl_apps.flight.telemetry import read_log

READERS: dict[str, Callable[[Path], Any]] = {
    "text": read_bounded, "arrays": read_npz, "fingerprint": file_fingerprint, "wind": first_bytes,
    "table": lambda path: data_files(WindConfig(source="csv", path=str(path))),
    "map": sketch_file, "telemetry": lambda path: list(read_log(path, None, on_earth=True)),
}  # fmt: skip


@pytest.mark.parametrize("reader", READERS)
def test_a_pipe_is_refused(reader: str, tmp_path: Path) -> None:
    for suffix in ("geojson", "kmz", "kml"):
        path = tmp_path / f"map.{suffix}"
        os.mkfifo(path)
        with pytest.raises(DataError, match="is a pipe, a socket or a device"):
            READERS[reader](path)


def test_devices_are_refused_and_missing_files_are_left_to_their_reader(tmp_path: Path) -> None:
    for device in ("/dev/zero", "/dev/null"):
        with pytest.raises(DataError, match="copy its content into a file"):
            refuse_special(Path(device))
    refuse_special(tmp_path / "missing")
    refuse_special(tmp_path)


def test_an_empty_departure_is_refused() -> None:
    scene = {"bounds": [[0, 0], [1, 1]], "start": [0, 0], "regions": {}, "obstacles": []}
    assert scene_from_dict(scene | {"time_zero": None}).time_zero is None
    with pytest.raises(DataError, match="time_zero is ''; expected an ISO 8601 time"):
        scene_from_dict(scene | {"time_zero": ""})
