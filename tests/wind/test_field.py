"""The lattice, its memory between runs, and its file."""

from __future__ import annotations

import ast
import logging
import os
import subprocess
import sys
import textwrap
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from careful_io.archives import read_npz
from careful_io.files import write_npz
from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.resources import PACKAGE
from pareto_ltl.wind import field, sources
from pareto_ltl.wind.field import _warn_once
from pareto_ltl.wind.netcdf import read_netcdf, write_netcdf
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.records import WindField, WindObservations
from pareto_ltl.world.scene import Scene
from wind_laws import gp as regression
from wind_laws import tables
from wind_laws.lattice import wind_lattice
from wind_laws.records import readings_until

CONUS = Scene(
    np.array([[-5e5, -5e5], [5e5, 5e5]]),
    np.zeros(2),
    {},
    (),
    frames.local_plane(37.0, -92.0),
    "2018-10-09T00:00:00Z",
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PARETO_LTL_CACHE", str(tmp_path / "cache"))
    _warn_once.cache_clear()
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def sample():
    return place_readings(WindConfig(), sources.read_readings(WindConfig()), CONUS)


@pytest.fixture(scope="module")
def few(sample):
    """Two times are enough to test memory and files."""
    return WindObservations(sample.times[:2], sample.points[:2], sample.winds[:2], sample.source)


@pytest.fixture
def fits(monkeypatch):
    """Counts calls of the fit."""
    calls = []
    honest = regression.fit_posterior
    monkeypatch.setattr(regression, "fit_posterior", lambda *args: calls.append(args) or honest(*args))
    return calls


def corners(wind):
    nodes = np.array(wind.mean.shape[1:3]) - 1
    return wind.origin, wind.origin + wind.spacing * nodes


# --- the lattice


@pytest.mark.parametrize(("width", "height"), [(1e6, 1e6), (3e5, 1e6), (2e4, 1e4), (40.0, 100.0), (3e7, 1e7)])
def test_the_lattice_covers_the_scene_and_resolves_it(width, height):
    scene = Scene(np.array([[10.0, 20.0], [10.0 + width, 20.0 + height]]), np.zeros(2), {})
    cfg = WindConfig()
    origin, spacing, shape = wind_lattice(scene.bounds, cfg.spacing, cfg.padding)
    end = origin + spacing * (np.array(shape) - 1)
    padding = min(cfg.padding, max(width, height))
    assert (origin <= scene.bounds[0] - padding * (1 - 1e-9)).all()
    assert (end >= scene.bounds[1] + padding * (1 - 1e-9)).all()
    assert (end - scene.bounds[1] <= padding + spacing).all()
    assert spacing <= max(width, height) / 20
    assert max(shape) <= 502


def test_the_packaged_missions_get_25_km():
    origin, spacing, shape = wind_lattice(CONUS.bounds, WindConfig().spacing, WindConfig().padding)
    np.testing.assert_array_equal(origin, [-650e3, -650e3])
    assert (spacing, shape) == (25e3, (53, 53))


def test_nodes_hold_the_posterior_and_the_space_between_is_close(sample):
    cfg = WindConfig(cache=False)
    wind = field.fit_wind_field(cfg, sample, CONUS)
    posterior = regression.fit_posterior(cfg, sample)
    at = np.random.default_rng(0).uniform(-5e5, 5e5, (400, 2))
    mean, var = posterior.at(at)
    axes = tuple(wind.origin[i] + wind.spacing * np.arange(wind.mean.shape[i + 1]) for i in (0, 1))
    for k in range(len(wind.times)):
        rough = RegularGridInterpolator(axes, wind.mean[k])(at)
        rough_var = RegularGridInterpolator(axes, wind.latent_var[k])(at)
        assert np.sqrt(np.mean((rough - mean[k]) ** 2)) < 0.05  # [m/s], against gusts above 1 m/s
        assert np.sqrt(np.mean((np.sqrt(rough_var) - np.sqrt(var[k])) ** 2)) < 0.05
    i, j = 7, 31
    exact, exact_var = posterior.at(wind.origin + wind.spacing * np.array([[i, j]]))
    np.testing.assert_allclose(wind.mean[:, i, j], exact[:, 0], atol=1e-6)
    np.testing.assert_allclose(wind.latent_var[:, i, j], exact_var[:, 0], atol=1e-6)
    np.testing.assert_allclose(wind.gust_var, posterior.gust_var, atol=1e-6)
    assert wind.score == pytest.approx(posterior.score)


def test_calm_air_is_zero_for_ever():
    cfg = WindConfig(source="calm")
    wind = field.fit_wind_field(cfg, place_readings(cfg, sources.read_readings(cfg), CONUS), CONUS)
    assert wind.until == np.inf
    np.testing.assert_array_equal(wind.times, [0.0])
    assert not wind.mean.any()
    assert not wind.latent_var.any()
    assert not wind.gust_var.any()
    low, high = corners(wind)
    assert (low <= CONUS.bounds[0]).all()
    assert (high >= CONUS.bounds[1]).all()


@pytest.mark.parametrize(
    ("horizon", "slots"), [(None, 4), (0.0, 1), (1.0, 2), (10800.0, 2), (10801.0, 3), (1e9, 4)]
)
def test_times_past_the_horizon_are_left_out(sample, horizon, slots):
    four = WindObservations(sample.times[:4], sample.points[:4], sample.winds[:4], "")
    assert len(readings_until(four, horizon).times) == slots
    if slots > 1 and horizon:
        kept = readings_until(four, horizon).times
        assert kept[-1] >= min(horizon, four.times[-1])
        assert kept[-2] < horizon


def test_holding_the_last_field_is_told_to_the_planner(few):
    held = replace(few, until=float(few.times[-1] + 3600.0), ends="it is held for 1 h")
    wind = field.fit_wind_field(WindConfig(), held, CONUS)
    assert (wind.known_until, wind.ends) == (few.times[-1] + 3600.0, "it is held for 1 h")
    assert field.fit_wind_field(WindConfig(), few, CONUS).known_until == few.times[-1]


# --- memory between runs


def same(a, b):
    for name in ("origin", "times", "mean", "latent_var", "gust_var"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert (a.spacing, a.known_until, a.score, a.source) == (b.spacing, b.known_until, b.score, b.source)


def test_the_same_readings_are_fitted_once(few, fits):
    first = field.fit_wind_field(WindConfig(), few, CONUS)
    copied = WindObservations(
        few.times.copy(), tuple(p.copy() for p in few.points), tuple(w.copy() for w in few.winds), few.source
    )
    same(first, field.fit_wind_field(WindConfig(), copied, CONUS))
    assert len(fits) == 1


def test_any_change_that_matters_is_fitted_anew(few, fits):
    field.fit_wind_field(WindConfig(), few, CONUS)
    winds = (few.winds[0] + [[0.01, 0.0]], few.winds[1])
    moved = WindObservations(few.times, few.points, winds, few.source)
    wider = Scene(CONUS.bounds * 1.1, CONUS.start, {}, (), CONUS.crs)
    for cfg, seen, scene in (
        (WindConfig(), moved, CONUS),
        (WindConfig(kernel="rbf"), few, CONUS),
        (WindConfig(noise_min=0.5), few, CONUS),
        (WindConfig(holdout=0.3), few, CONUS),
        (WindConfig(spacing=50e3), few, CONUS),
        (WindConfig(), few, wider),
    ):
        before = len(fits)
        field.fit_wind_field(cfg, seen, scene)
        assert len(fits) == before + 1


def test_another_version_of_a_package_is_another_fit(few, fits, monkeypatch):
    field.fit_wind_field(WindConfig(), few, CONUS)
    monkeypatch.setattr(field, "version", lambda package: "0.0")
    field.fit_wind_field(WindConfig(), few, CONUS)
    assert len(fits) == 2


def test_a_change_that_does_not_matter_is_not(few, fits):
    field.fit_wind_field(WindConfig(), few, CONUS)
    renamed = WindObservations(few.times, few.points, few.winds, "the same readings from elsewhere")
    wind = field.fit_wind_field(WindConfig(gust_time=60.0, ball=3.0), renamed, CONUS)
    assert len(fits) == 1
    assert wind.gust_time == 60.0
    assert wind.source == "the same readings from elsewhere"


def test_the_cache_can_be_switched_off(few, fits, cache):
    for _ in range(2):
        field.fit_wind_field(WindConfig(cache=False), few, CONUS)
    assert len(fits) == 2
    assert not cache.exists()


def changed(**changes):
    """An entry whose content was changed by somebody who writes valid archives."""

    def change(entry):
        content = {name: table.copy() for name, table in read_npz(entry).items()}
        for name, value in changes.items():
            content[name] = value(content[name])
        write_npz(entry, content)

    return change


def without(name):
    return lambda entry: write_npz(entry, {k: v for k, v in read_npz(entry).items() if k != name})


def not_a_number(array):
    array.flat[array.size // 2] = np.nan
    return array


def other_byte(entry):
    content = bytearray(entry.read_bytes())
    content[len(content) // 2] ^= 1
    entry.write_bytes(content)


DAMAGES = {
    "empty": lambda entry: entry.write_bytes(b""),
    "no archive": lambda entry: entry.write_bytes(b"not an archive"),
    "cut": lambda entry: entry.write_bytes(entry.read_bytes()[:1000]),
    "other byte": other_byte,
    "no numbers": lambda entry: write_npz(entry, {}),
    "no rho": without("rho"),
    "no score": without("gp_nlpd"),
    "no modes": without("psi"),
    "another array": lambda entry: write_npz(entry, read_npz(entry) | {"more": np.zeros(1)}),
    "rho 2": changed(rho=lambda array: array + 2.0),
    "rho nan": changed(rho=not_a_number),
    "two scores": changed(gp_nlpd=lambda array: np.zeros(2)),
    "nan": changed(mean=not_a_number),
    "nan in modes": changed(psi=not_a_number),
    "shape": changed(mean=lambda array: array[:, 1:]),
    "one component": changed(latent_var=lambda array: array[..., :1]),
    "whole numbers": changed(mean=lambda array: array.astype(int)),
    "negative": changed(gust_var=lambda array: -array),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_made_again_with_one_warning(few, fits, cache, caplog, damage):
    first = field.fit_wind_field(WindConfig(), few, CONUS)
    DAMAGES[damage](next(cache.rglob("*.npz")))
    with caplog.at_level(logging.WARNING):
        same(first, field.fit_wind_field(WindConfig(), few, CONUS))
        same(first, field.fit_wind_field(WindConfig(), few, CONUS))
    assert len(fits) == 2  # the second attempt found the new entry
    assert len(caplog.records) == 1
    assert "\n" not in caplog.text.strip()
    assert str(cache) in caplog.text


class Planted:
    """An object that, unpickled, would write a file."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return (open, (str(self.mark), "w"))


def test_planted_code_in_an_entry_is_not_executed(few, fits, cache, tmp_path):
    first = field.fit_wind_field(WindConfig(), few, CONUS)
    arrays = next(cache.rglob("*.npz"))
    mark = tmp_path / "executed"
    np.savez(arrays, allow_pickle=True, mean=np.array([Planted(mark)], object))
    same(first, field.fit_wind_field(WindConfig(), few, CONUS))
    assert len(fits) == 2
    assert not mark.exists()


UNPICKLING = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "read_pickle"}


MACHINE_CODE = PACKAGE / "kernels" / "code_cache.py"  # executable in any form: read_code checks who wrote it


def test_no_module_of_the_package_reads_pickles():
    """What is unpickled is executed."""
    names = ("careful_io", "flight_quantities", "wind_laws", "hydra_plugins")
    folders = (PACKAGE, *(PACKAGE.parent / name for name in names))
    sources = [path for folder in folders for path in folder.rglob("*.py")]
    assert len(sources) > 100
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {getattr(node, key, None) for key in ("id", "attr", "name", "module")}
            assert not names & UNPICKLING or path == MACHINE_CODE, path
            if isinstance(node, ast.ImportFrom) and node.module == "joblib":  # its Memory keeps pickles
                assert {alias.name for alias in node.names} <= {"Parallel", "delayed", "cpu_count"}, path
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant), path
                assert node.value.value is False, path


@pytest.mark.skipif(os.name == "nt", reason="folders of Windows have no such mode")
@pytest.mark.parametrize("which", ["wind", ""])
def test_a_cache_that_others_may_write_is_not_used(few, fits, cache, caplog, which):
    field.fit_wind_field(WindConfig(), few, CONUS)
    (cache / which).chmod(0o777)
    with caplog.at_level(logging.WARNING):
        field.fit_wind_field(WindConfig(), few, CONUS)
    assert len(fits) == 2
    assert "may be written by others (mode 777); give it to you alone (chmod 700)" in caplog.text
    (cache / which).chmod(0o700)
    field.fit_wind_field(WindConfig(), few, CONUS)
    assert len(fits) == 2


def test_folders_of_the_cache_are_made_for_their_owner_alone(few, cache):
    before = os.umask(0)
    try:
        field.fit_wind_field(WindConfig(), few, CONUS)
    finally:
        os.umask(before)
    assert [path.stat().st_mode & 0o777 for path in (cache, cache / "wind")] == [0o700, 0o700]


def test_a_cache_that_cannot_be_written_costs_time_only(few, fits, cache, caplog):
    cache.write_text("a file where a folder should be")
    with caplog.at_level(logging.WARNING):
        first, second = (field.fit_wind_field(WindConfig(), few, CONUS) for _ in range(2))
    same(first, second)
    assert len(fits) == 2
    assert len(caplog.records) == 1
    assert "PARETO_LTL_CACHE" in caplog.text


def test_a_cache_that_fills_up_while_writing_costs_time_only(few, fits, caplog, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tables, "write_npz", full)
    with caplog.at_level(logging.WARNING):
        wind = field.fit_wind_field(WindConfig(), few, CONUS)
    assert wind.score
    assert len(fits) == 1  # what was worked out is used
    assert any("No space left" in record.message for record in caplog.records)


def test_a_remembered_field_does_not_load_scikit_learn(few, cache, tmp_path):
    """Its import alone would cost more than the whole look-up may."""
    script = textwrap.dedent("""
        import sys
        import numpy as np
        from pareto_ltl.settings import WindConfig
        from pareto_ltl.world.scene import Scene
        from flight_quantities import frames
        from pareto_ltl.wind import field, sources
        bounds = np.array([[-5e5, -5e5], [5e5, 5e5]])
        crs = frames.local_plane(37.0, -92.0)
        scene = Scene(bounds, np.zeros(2), {}, (), crs, "2018-10-10T12:00:00Z")
        cfg = WindConfig()
        from pareto_ltl.wind.observations import place_readings
        seen = place_readings(cfg, sources.read_readings(cfg), scene)
        wind = field.fit_wind_field(cfg, seen, scene)
        print(len(wind.times), "sklearn" in sys.modules, "pandas" in sys.modules)
    """)
    run = [sys.executable, "-c", script]
    told = [
        subprocess.run(run, capture_output=True, text=True, check=True, env=os.environ).stdout
        for _ in range(2)
    ]
    assert told[0].startswith("2 True")
    assert told[1].split() == ["2", "False", "False"]


# --- the file


def test_a_field_comes_back_from_its_file(few, tmp_path):
    wind = field.fit_wind_field(WindConfig(), replace(few, until=1e5), CONUS)
    path = write_netcdf(wind, tmp_path / "deep" / "wind.nc", CONUS)
    same(read_netcdf(path), wind)
    assert [file.name for file in path.parent.iterdir()] == ["wind.nc"]


def test_the_file_holds_what_the_field_was_fitted_from(few, tmp_path):
    """A CF ragged array of the readings, and hyperparameters that give the field again at its nodes."""
    import xarray as xr

    cfg = WindConfig(kernel="rbf")
    wind = field.fit_wind_field(cfg, few, CONUS)
    path = write_netcdf(wind, tmp_path / "wind.nc", CONUS)
    again = read_netcdf(path).evidence
    assert again is not None
    for k, (points, winds) in enumerate(zip(again.points, again.winds, strict=True)):
        np.testing.assert_array_equal(points, few.points[k])
        np.testing.assert_array_equal(winds, few.winds[k])
    hyper, means = regression.Hyper(*again.hyper[0, 0, 1:].tolist()), again.hyper[..., 0]
    assert (again.hyper[..., 1:] == hyper).all()
    residuals = regression.leave_one_out(again.kernel, again.points, again.winds, hyper, means)
    anchors, squares = regression.squared_residuals(again.points, residuals)
    seen = regression.WindPosterior(
        wind.times, again.points, again.winds, again.kernel, hyper, means, {}, residuals, anchors, squares
    )
    mean, var = seen.at(wind.origin + wind.spacing * np.array([[3, 5], [20, 40]]))
    np.testing.assert_allclose(mean, wind.mean[:, [3, 20], [5, 40]])
    np.testing.assert_allclose(var, wind.latent_var[:, [3, 20], [5, 40]])
    with xr.open_dataset(path, engine="h5netcdf") as data:
        assert data["reading_count"].attrs["sample_dimension"] == "reading"
        assert int(data["reading_count"].sum()) == data.sizes["reading"] == sum(map(len, few.points))
        assert data["u_prior_length"].attrs["units"] == "m"
        np.testing.assert_allclose(data["v_noise_sd"] ** 2, wind.gust_var[:, 1])


def test_calm_air_comes_back_from_its_file(tmp_path):
    still = np.zeros((1, 3, 4, 2))
    wind = WindField(np.zeros(2), 5.0, np.zeros(1), still, still, np.zeros((1, 2)), np.inf)
    same(read_netcdf(write_netcdf(wind, tmp_path / "wind.nc")), wind)


def test_the_file_is_what_a_colleague_expects(few, tmp_path):
    """CF: dimensions (time, y, x), units on everything, a clock and a map projection."""
    import pyproj
    import xarray as xr

    wind = field.fit_wind_field(WindConfig(), few, CONUS)
    path = write_netcdf(wind, tmp_path / "wind.nc", CONUS)
    with xr.open_dataset(path, engine="h5netcdf") as data:
        assert str(data.attrs["Conventions"]).startswith("CF-")
        for name in ("u", "v", "u_var", "v_var"):
            assert data[name].dims == ("time", "y", "x")
            assert data[name].attrs["grid_mapping"] == "crs"
        for name in ("u_gust_var", "v_gust_var"):
            assert data[name].dims == ("time",)
        assert [data[n].attrs["units"] for n in ("u", "u_var", "v_gust_var", "x", "y")] == [
            "m s-1", "m2 s-2", "m2 s-2", "m", "m",
        ]  # fmt: skip
        assert data["time"].values[1] == np.datetime64("2018-10-09T03:00:00")
        east = data.sel(x=-300e3, y=200e3)
        i, j = 14, 34  # (-300 + 650) / 25, (200 + 650) / 25
        np.testing.assert_allclose(east["u"], wind.mean[:, i, j, 0])
        np.testing.assert_allclose(east["v_var"], wind.latent_var[:, i, j, 1])
        np.testing.assert_allclose(data["v_gust_var"], wind.gust_var[:, 1])
        told = pyproj.Proj(pyproj.CRS.from_cf(data["crs"].attrs))
        np.testing.assert_allclose(told(-90.0, 40.0), pyproj.Proj(CONUS.crs)(-90.0, 40.0), atol=1e-3)


@pytest.mark.parametrize("content", [None, b"", b"no netcdf", b"\x89HDF\r\n\x1a\n broken"])
def test_a_file_that_is_no_field_is_named(content, tmp_path):
    path = tmp_path / "wind.nc"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DataError, match=r"wind.nc .*expected the wind.nc of a run") as caught:
        read_netcdf(path)
    assert "\n" not in str(caught.value)
