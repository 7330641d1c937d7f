"""A fit as a task and a table, as somebody uses it who has readings in a plane and nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from careful_io.archives import read_npz
from careful_io.files import write_npz
from wind_laws.documents import packaged_law
from wind_laws.lattice import mode_lattice, wind_lattice
from wind_laws.records import FORECAST_PARTS, SPACE, TIME, PlacedReadings, UncertainWind, readings_until
from wind_laws.tables import FitOptions, WindTable, WindTask, tabulate_wind

BOUNDS = np.array([[-1e5, -1e5], [1e5, 1e5]])


@pytest.fixture(scope="module")
def readings() -> PlacedReadings:
    rng = np.random.default_rng(3)
    places = tuple(rng.uniform(-2e5, 2e5, (30, 2)) for _ in range(2))
    winds = tuple(np.column_stack([5.0 + p[:, 0] / 1e5, -p[:, 1] / 1e5]) for p in places)
    return PlacedReadings(
        np.array([0.0, 10_800.0]), places, winds, "made up", np.array([3600.0, 14_400.0]),
        until=14_400.0, error=packaged_law("gfs"),
    )  # fmt: skip


def task_of(readings: PlacedReadings, **changed: object) -> WindTask:
    options = FitOptions(modes_max=16)._replace(**changed)
    return WindTask.of(options, readings, BOUNDS, wind_lattice(BOUNDS, 2e4, 5e4), mode_lattice(BOUNDS, 5e4))


@pytest.fixture(scope="module")
def table(readings: PlacedReadings) -> WindTable:
    return tabulate_wind(task_of(readings))


def test_a_fit_has_the_winds_and_all_parts_of_their_error(readings: PlacedReadings, table: WindTable) -> None:
    wind = table.wind(task_of(readings), readings)
    assert isinstance(wind, UncertainWind)
    assert wind.at([[5e4, -5e4]], 5400.0)[0] == pytest.approx([5.5, 0.5], abs=0.3)
    assert wind.known_until == 14_400.0
    assert readings.error is not None
    forecast = readings.error.forecast_variance(readings.leads)
    assert (wind.latent_var >= forecast[:, None, None, None] - 1e-9).all()
    assert wind.time_variance(np.array([0.0, 5400.0, 10_800.0]))[[0, 2]] == pytest.approx([0.0, 0.0])
    assert wind.modes is not None
    assert set(wind.modes.part.tolist()) <= {-1, SPACE, TIME, *FORECAST_PARTS.values()}
    assert table.wind(task_of(readings), readings, rho=0.25).modes.rho == 0.25  # type: ignore[union-attr]


def test_a_table_comes_back_from_its_archive_and_fits_its_task_alone(
    readings: PlacedReadings, table: WindTable, tmp_path: Path
) -> None:
    task = task_of(readings)
    table.write(tmp_path / "table.npz")
    again = WindTable.read(tmp_path / "table.npz", task)
    for name, found in table._asdict().items():
        np.testing.assert_array_equal(again._asdict()[name], found)
    with pytest.raises(ValueError, match="must have shape"):
        WindTable.read(tmp_path / "table.npz", task._replace(lattice=task.mode_lattice))
    arrays = read_npz(tmp_path / "table.npz")
    write_npz(tmp_path / "table.npz", {name: found for name, found in arrays.items() if name != "rho"})
    with pytest.raises(ValueError, match="rho"):
        WindTable.read(tmp_path / "table.npz", task)


def test_tasks_that_differ_have_other_fingerprints(readings: PlacedReadings) -> None:
    task = task_of(readings)
    renamed = replace(readings, source="the same from elsewhere")
    assert task_of(renamed).fingerprint("1") == task.fingerprint("1") != task.fingerprint("2")
    later = replace(readings, leads=readings.leads + 3600.0)
    others = (task_of(later), task_of(readings, kernel="rbf"), task_of(readings, holdout=0.3))
    assert len({each.fingerprint("1") for each in (task, *others)}) == 4


def test_readings_after_the_horizon_are_left_out_with_the_reason(readings: PlacedReadings) -> None:
    first = readings_until(readings, 0.0, "the flight ends there")
    assert (len(first.times), first.until, first.ends) == (1, 0.0, "the flight ends there")
    assert readings_until(readings, 3600.0) is readings


def test_the_lattices_cover_their_bounds() -> None:
    fine, coarse = wind_lattice(BOUNDS, 2e4, 5e4), mode_lattice(BOUNDS, 5e4)
    assert fine.nodes().min(axis=0) == pytest.approx([-1.5e5, -1.5e5])
    assert fine.nodes().max(axis=0) == pytest.approx([1.5e5, 1.5e5])
    assert coarse.nodes().min(axis=0) == pytest.approx([-1.2e5, -1.2e5])
    assert coarse.spacing == 2e4  # a tenth of the bounds: modes need some cells
