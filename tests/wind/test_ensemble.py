"""Ensembles: mean and covariance of members, shrinkage to the law of forecast errors, time-lagged cycles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5netcdf
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flight_quantities import frames
from noaa import NOAA, needs_noaa
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind import field, sources
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.snapshots import Snapshot
from pareto_ltl.world.scene import Scene
from pareto_ltl_apps.formats.snapshots import ensemble_readings
from wind_files import REGULAR, U10, V10, grib_message
from wind_laws.records import ENSEMBLE

START = 1539043200.0  # 2018-10-09T00:00:00Z
LON, LAT = (a.ravel() for a in np.meshgrid(np.arange(-100.0, -83.0), np.arange(30.0, 45.0)))
NODES = np.stack([LON, LAT], axis=-1)
SCENE = Scene(
    np.array([[-4e5, -4e5], [4e5, 4e5]]), np.zeros(2), {}, (), frames.local_plane(37.0, -92.0),
    "2018-10-09T00:00:00Z",
)  # fmt: skip
FILES = (Path("members/one"),)


def snapshot(winds, hours=0.0, member="", lead=0.0, points=NODES):
    return Snapshot(START + 3600 * hours, lead, points, winds, "10m", FILES, member)


def members(count, hours=(0.0, 3.0, 6.0), seed=0, length=4.0, sd=2.0):
    """Members whose deviations are drawn from a squared-exponential law in degrees, the same at all times."""
    rng = np.random.default_rng(seed)
    apart = np.linalg.norm(NODES[:, None] - NODES[None], axis=2)
    root = np.linalg.cholesky(sd**2 * np.exp(-0.5 * (apart / length) ** 2) + 1e-6 * np.eye(len(NODES)))
    found = []
    for m in range(count):
        own = root @ rng.standard_normal((len(NODES), 2))
        found += [snapshot(5.0 + own, h, f"member {m}", 3600.0 * (6 + h)) for h in hours]
    return found


def read(snapshots, prior=10.0):
    return ensemble_readings(snapshots, FILES, WindConfig(ensemble_prior=prior))


def test_deviations_have_the_covariance_of_the_members():
    snaps = members(6)
    found = read(snaps, prior=0.0)
    stack = np.stack([snap.winds for snap in snaps if snap.time == START])  # (6, N, 2)
    np.testing.assert_allclose(found.winds[0], stack.mean(axis=0))
    flat = found.members[0].reshape(-1, 6)
    expected = np.cov(stack.reshape(6, -1).T) * (1 + 1 / 6)
    np.testing.assert_allclose(flat @ flat.T, expected, atol=1e-9)
    assert found.forecast_share == 0.0
    np.testing.assert_array_equal(found.leads, 3600.0 * np.array([6, 9, 12]))


@given(st.integers(2, 31), st.floats(0.5, 50))
def test_few_members_leave_most_to_the_law_of_forecast_errors(count, prior):
    """The shares add up to one; the members' share grows with their number."""
    rng = np.random.default_rng(count)
    snaps = [snapshot(rng.standard_normal((len(NODES), 2)), member=str(m)) for m in range(count)]
    found = read(snaps, prior)
    share = (count - 1) / (count - 1 + prior)
    assert found.forecast_share == pytest.approx(1 - share)
    spread = np.stack([snap.winds for snap in snaps]).var(axis=0, ddof=1)
    np.testing.assert_allclose(
        (found.members[0] ** 2).sum(axis=-1), share * (1 + 1 / count) * spread, atol=1e-9
    )


@pytest.mark.statistical
def test_the_field_of_many_members_has_their_law():
    """From members to modes: variance and correlation at nodes of the map within sampling error."""
    cfg = WindConfig(source="csv", path="x", forecast_error="none", cache=False, modes_max=64)
    seen = place_readings(cfg, read(members(40), prior=0.0), SCENE)
    wind = field.fit_wind_field(cfg, replace(seen, error=None), SCENE)
    found = wind.modes
    assert found is not None
    own = found.part == ENSEMBLE
    assert own.sum() >= 4
    psi = found.psi[0, 2:-2, 2:-2, 0][..., own].astype(float)
    # 40 members of sd 2 m/s: the sd over the map is known within about 2 / sqrt(2 * 39 * 4 patches)
    assert np.sqrt((psi**2).sum(axis=-1).mean()) == pytest.approx(2.0, rel=0.35)
    np.testing.assert_allclose(found.psi[0][..., own], found.psi[1][..., own], atol=1e-3)  # it lasts
    assert np.sqrt(wind.latent_var.mean()) == pytest.approx(2.0, rel=0.35)


def test_a_member_that_is_missing_at_one_time_deviates_by_nothing_there():
    snaps = [s for s in members(4) if not (s.member == "member 2" and s.time > START)]
    found = read(snaps, prior=0.0)
    assert (found.members[0] != 0).any(axis=(0, 1)).sum() == 4
    assert (found.members[1] != 0).any(axis=(0, 1)).sum() == 3
    three = np.stack([s.winds for s in snaps if s.time == START + 10800])
    np.testing.assert_allclose(
        (found.members[1] ** 2).sum(axis=-1), (1 + 1 / 3) * three.var(axis=0, ddof=1), atol=1e-9
    )


def test_models_with_other_grids_are_read_at_the_nodes_of_the_first():
    """A plane of wind is read exactly; nodes that the other model does not cover are left out."""
    fine = np.stack(np.meshgrid(np.arange(-99.75, -85.0, 0.5), np.arange(31.0, 44.0, 0.5)), -1).reshape(-1, 2)
    plane = snapshot(np.stack([LON, LAT], axis=-1), member="coarse")
    other = snapshot(fine, member="fine", points=fine)
    found = read([plane, other])
    np.testing.assert_allclose(found.winds[0], found.points[0], atol=1e-9)
    np.testing.assert_allclose(found.members[0], 0.0, atol=1e-9)
    assert 0 < len(found.points[0]) < len(NODES)


def test_time_lagged_cycles_of_one_model_are_members():
    rng = np.random.default_rng(1)
    snaps = [
        snapshot(rng.standard_normal((len(NODES), 2)), hours=hours, lead=3600.0 * (hours - cycle))
        for cycle in (-12, -6, 0)
        for hours in (0.0, 3.0, 6.0)
    ]
    found = read(snaps)
    assert found.members[0].shape[-1] == 3
    np.testing.assert_array_equal(found.leads, 3600.0 * np.array([0, 3, 6]))


def test_times_with_one_member_are_left_out_and_counted():
    snaps = [*members(3), snapshot(np.zeros((len(NODES), 2)), hours=9.0)]
    found = read(snaps)
    assert len(found.times) == 3
    assert "1 times with a single member left out" in " ".join(found.notes)


@pytest.mark.parametrize(
    ("snapshots", "message"),
    [
        (members(1), r"no valid time has two members \(3 times, .*one field each\).*wind.source=grib"),
        ([*members(2), members(1)[0]], r"both hold the member 0 of 2018-10-08T18:00:00Z at 2018-10-09T00"),
        ([*members(1), replace(members(1)[0], level="80m")], r"several levels \(10m, 80m\).*wind.level"),
    ],
)
def test_what_is_no_ensemble_is_refused_in_one_line(snapshots, message):
    with pytest.raises(DataError, match=message) as caught:
        read(snapshots)
    assert "\n" not in str(caught.value)


@needs_noaa
def test_lagged_analyses_of_the_shared_cycles_say_how_far_the_wind_will_change():
    """Each analysis carried forward by 6 and 12 h stands for a forecast: with the newest three at each time
    the members' spread and the law of 24 h changes bracket what the next analysis shows."""
    from pareto_ltl_apps.formats.grib_files import grib_snapshots_apart

    cycles = tuple(sorted((NOAA / "gfs_1p00_10m").iterdir()))
    analyses = sorted(
        (s for s in grib_snapshots_apart(cycles, 75.0).winds if s.lead == 0.0), key=lambda s: s.time
    )[:7]
    inside = (np.abs(analyses[0].points - [-95.0, 39.0]) < [15.0, 8.0]).all(axis=1)
    z = []
    for k in range(2, 6):
        lagged = [
            replace(
                analyses[k - back], time=analyses[k].time, lead=6 * 3600.0 * back,
                points=analyses[k - back].points[inside], winds=analyses[k - back].winds[inside],
            )
            for back in (0, 1, 2)
        ]  # fmt: skip
        found = ensemble_readings(lagged, FILES, WindConfig(ensemble_prior=0.0))
        sd = np.sqrt((found.members[0] ** 2).sum(axis=-1))
        z.append((analyses[k + 1].winds[inside] - found.winds[0]) / np.maximum(sd, 0.3))
    spread = np.sqrt(np.mean(np.square(z)))
    assert 0.8 < spread < 4.0  # three lagged members know the size, and too small a one: shrinkage is needed


@needs_noaa
def test_a_folder_for_each_member_is_an_ensemble(tmp_path):
    """Two copies of one analysis under two names: their mean is the analysis, their spread is 0."""
    import shutil

    files = sorted((NOAA / "gfs_1p00_10m").glob("*20181009??"))[:2]
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        for file in files:
            shutil.copy(file, tmp_path / name)
    found = sources.read_readings(WindConfig(source="ensemble", path=str(tmp_path)))
    single = sources.read_readings(WindConfig(source="grib", path=str(tmp_path / "one")))
    assert found.members[0].shape[-1] == 4  # two members, each of two cycles
    assert not any(deviations.any() for deviations in found.members)
    np.testing.assert_allclose(found.winds[1], single.winds[1])


def message(eccodes, short, member):
    """A wind of 3 m/s on a grid of 16 x 31 nodes, the first 50 of them without a value."""
    handle = eccodes.codes_grib_new_from_samples("regular_ll_sfc_grib2")
    for key, value in {
        "productDefinitionTemplateNumber": 1, "perturbationNumber": member, "dataDate": 20181009,
        "shortName": short, "typeOfLevel": "heightAboveGround", "level": 10, "bitmapPresent": 1,
    }.items():  # fmt: skip
        eccodes.codes_set(handle, key, value)
    values = np.full(eccodes.codes_get(handle, "numberOfDataPoints"), 3.0)
    values[:50] = eccodes.codes_get(handle, "missingValue", float)
    eccodes.codes_set_values(handle, values)
    raw = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return raw


def test_notes_on_the_members_in_grib_files_are_kept(tmp_path):
    pytest.importorskip("pyproj")  # before ecCodes
    eccodes = pytest.importorskip("eccodes", reason="the extra `grib` is not installed")
    for member in (1, 2):
        raw = b"".join(message(eccodes, short, member) for short in ("10u", "10v"))
        (tmp_path / f"gefs.{member}").write_bytes(raw)
    found = sources.read_readings(WindConfig(source="ensemble", path=str(tmp_path)))
    assert found.notes[0] == "100 of 992 values at 10m are missing in the file and left out"
    for member in (1, 2):
        folder = tmp_path / f"member{member}"
        folder.mkdir()
        (tmp_path / f"gefs.{member}").rename(folder / "gefs")
    found = sources.read_readings(WindConfig(source="ensemble", path=str(tmp_path)))
    note = "50 of 496 values at 10m are missing in the file and left out"
    assert found.notes[:2] == (f"member1: {note}", f"member2: {note}")


def test_notes_on_the_members_in_netcdf_files_are_kept(tmp_path):
    u = np.ones((2, 1, 15, 17))
    u[0, 0, 2, 3] = np.nan
    with h5netcdf.File(tmp_path / "members.nc", "w") as file:
        file.dimensions = {"member": 2, "time": 1, "lat": 15, "lon": 17}
        file.create_variable("time", ("time",), data=np.zeros(1)).attrs["units"] = "hours since 2018-10-09"
        for name, values, units in (
            ("lat", np.arange(30.0, 45.0), "degrees_north"),
            ("lon", np.arange(-100.0, -83.0), "degrees_east"),
        ):
            file.create_variable(name, (name,), data=values).attrs["units"] = units
        for name in ("u10", "v10"):
            file.create_variable(name, ("member", "time", "lat", "lon"), data=u).attrs["units"] = "m s-1"
    found = sources.read_readings(WindConfig(source="ensemble", path=str(tmp_path)))
    assert found.notes[0] == "1 of 510 values at 10m are missing in the file and left out"


@pytest.mark.parametrize(("members", "source"), [([3], "grib"), ([3, 4], "ensemble")])
def test_one_member_alone_is_a_forecast(tmp_path: Path, members: list[int], source: str) -> None:
    messages = [
        grib_message(
            np.full((7, 7), 4.0), what, hour, **REGULAR,
            productDefinitionTemplateNumber=1, perturbationNumber=member, numberOfForecastsInEnsemble=20,
        )
        for member in members for hour in (0.0, 3.0) for what in (U10, V10)
    ]  # fmt: skip
    (tmp_path / "winds.grib2").write_bytes(b"".join(messages))
    assert sources.source_of_path(tmp_path / "winds.grib2") == source
