"""What a results directory is after anything that stopped a run."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np


def check_whole(place: Path, *ends: str) -> None:
    """Every file that has its final name can be read to its end, and the run does not claim too much.

    ``ends`` are further ways in which it may have ended.
    """
    for path in place.rglob("*"):
        if path.name.startswith(".") or not path.is_file():
            continue
        if path.suffix == ".json":
            assert isinstance(json.loads(path.read_text()), dict), path
        if path.suffix == ".npz":
            with np.load(path) as archive:
                assert all(archive[name].size >= 0 for name in archive.files), path
        if path.suffix == ".csv":
            rows = list(csv.reader(path.read_text().splitlines()))
            assert len({len(row) for row in rows}) == 1, path
        if path.suffix == ".png":
            assert path.read_bytes().endswith(b"IEND\xaeB`\x82"), path
    for record in place.rglob("run.json"):
        status = json.loads(record.read_text())["status"]
        assert status in ("running", "ok", *ends)
        assert not (status == "running" and (record.parent / "metrics.json").exists())
