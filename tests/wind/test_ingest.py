"""A table of readings that is thinned: nodes that all times have, in the interval and the area."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from careful_io.times import iso, seconds
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.wind.readings import Readings
from pareto_ltl.wind.snapshots import Snapshot, readings_of
from pareto_ltl_apps.formats.settings import IngestConfig
from pareto_ltl_apps.formats.wind_table import write_wind_table

BEGIN, HOUR = seconds("2018-10-09T06:00:00Z"), 3600.0
EAST, NORTH = (axis.ravel() for axis in np.meshgrid(np.arange(5.0), 50.0 + np.arange(4.0)))
NODES = np.column_stack([EAST, NORTH])  # the last time has all but the last node


def readings(folder: Path, geographic: bool = True) -> Readings:
    file = folder / "source.csv"
    file.write_text("the source")
    fields = []
    for k in range(4):
        points = NODES[: len(NODES) - (k == 3)]
        winds = np.column_stack([points[:, 0] + k, points[:, 1] - 50.0])
        fields.append(Snapshot(BEGIN + k * HOUR, 0.0, points, winds, "10m", (file,)))
    return readings_of(fields, (file,), geographic=geographic)


def written(out: Path, **changes: object) -> tuple[list[str], dict[str, object]]:
    cfg = IngestConfig(**{"points": 100, **changes})  # type: ignore[arg-type]
    table = write_wind_table(WindConfig(), readings(out.parent), cfg, out)
    return table.read_text().splitlines(), json.loads(out.with_suffix(".json").read_text())


def test_all_times_have_the_nodes_that_they_share(tmp_path: Path) -> None:
    lines, origin = written(tmp_path / "out.csv")
    titles, rows = lines[0].split(","), [line.split(",") for line in lines[1:]]
    assert len(rows) == 4 * (len(NODES) - 1)
    assert origin["points"] == len(NODES) - 1
    assert list(origin["times"]) == [iso(BEGIN + k * HOUR) for k in range(4)]  # type: ignore[call-overload]
    assert list(origin["files"]) == ["source.csv"]  # type: ignore[call-overload]
    columns = {name: [row[titles.index(name)] for row in rows] for name in ("lat", "lon", "u", "v")}
    for k, row in enumerate(rows):
        lat, lon = float(columns["lat"][k]), float(columns["lon"][k])
        assert float(columns["u"][k]) == pytest.approx(lon + k // (len(NODES) - 1))
        assert float(columns["v"][k]) == pytest.approx(lat - 50.0)
        assert row[titles.index("time")] == iso(BEGIN + k // (len(NODES) - 1) * HOUR)
    first = [float(lat) for lat in columns["lat"][: len(NODES) - 1]]
    assert first == sorted(first, reverse=True)  # from north to south


def test_the_interval_has_its_ends_and_the_area_its_nodes(tmp_path: Path) -> None:
    lines, origin = written(
        tmp_path / "out.csv", first=iso(BEGIN + HOUR), last=iso(BEGIN + 2 * HOUR), points=3,
        area=[[0.5, 50.5], [3.5, 50.5], [3.5, 53.5], [0.5, 53.5]],
    )  # fmt: skip
    assert len(lines) == 1 + 2 * 3
    assert origin["points"] == 3
    assert len(origin["times"]) == 2  # type: ignore[arg-type]
    titles = lines[0].split(",")
    for line in lines[1:]:
        lat, lon = (float(line.split(",")[titles.index(name)]) for name in ("lat", "lon"))
        assert 0.5 <= lon <= 3.5
        assert 50.5 <= lat <= 53.5


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    cfg, found, out = WindConfig(), readings(tmp_path), tmp_path / "out.csv"
    with pytest.raises(DataError, match="has x,y columns"):
        write_wind_table(cfg, readings(tmp_path, geographic=False), IngestConfig(), out)
    with pytest.raises(DataError, match="holds no readings"):
        write_wind_table(cfg, readings_of([], ()), IngestConfig(), out)
    with pytest.raises(DataError, match="no wind time between"):
        write_wind_table(cfg, found, IngestConfig(first="2019-01-01T00:00:00Z"), out)
    with pytest.raises(ConfigError, match="would overwrite"):
        write_wind_table(cfg, found, IngestConfig(), tmp_path / "source.csv")
    with pytest.raises(ConfigError, match="there is no folder"):
        write_wind_table(cfg, found, IngestConfig(), tmp_path / "none" / "out.csv")
    few = IngestConfig(area=[[0.5, 50.5], [1.5, 50.5], [1.5, 52.5], [0.5, 52.5]])
    with pytest.raises(DataError, match=r"^2 wind nodes lie in ingest.area"):
        write_wind_table(cfg, found, few, out)
    assert not out.exists()
