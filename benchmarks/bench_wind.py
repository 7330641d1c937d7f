"""Wind budgets: 28 processes of 120 readings in 4 s, the lattice in 2 s, both from memory in 0.1 s.

    python -m pytest benchmarks/bench_wind.py --benchmark-columns=min,median,rounds

The budget of each line is in its ``extra_info`` [s].
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flight_quantities import frames
from pareto_ltl.settings import WindConfig
from pareto_ltl.wind import field, sources
from pareto_ltl.wind.netcdf import write_netcdf
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.world.scene import Scene
from wind_laws import gp as regression
from wind_laws.lattice import wind_lattice

NOAA = Path(__file__).parents[2] / "shared" / "data" / "noaa"
SCENE = Scene(
    np.array([[-5e5, -5e5], [5e5, 5e5]]),
    np.zeros(2),
    {},
    (),
    frames.local_plane(37.0, -92.0),
    "2018-10-09T00:00:00Z",
)


def observed(cfg, scene):
    return place_readings(cfg, sources.read_readings(cfg), scene)


@pytest.fixture(scope="module")
def seen():
    return observed(WindConfig(), SCENE)


def test_read_the_sample(benchmark, seen):
    benchmark.extra_info["budget"] = 0.1
    assert len(benchmark(observed, WindConfig(), SCENE).times) == 14


@pytest.mark.skipif(not NOAA.is_dir(), reason="the NOAA files are not beside this checkout")
def test_read_22_global_grib_fields(benchmark):
    pytest.importorskip("eccodes")
    cfg = WindConfig(source="grib", path=str(NOAA / "gfs_1p00_10m"))
    benchmark.extra_info["budget"] = 1.0
    found = benchmark.pedantic(observed, (cfg, SCENE), rounds=3)
    assert len(found.times) == 22


def test_read_a_field_of_hrrr_size_around_the_scene(benchmark, tmp_path):
    """1,799 x 1,059 nodes, of which those near the scene are kept: seconds and MB of one time."""
    eccodes = pytest.importorskip("eccodes")
    path = tmp_path / "hrrr.grib2"
    path.write_bytes(b"".join(hrrr_message(eccodes, short) for short in ("10u", "10v")))
    code = (
        "import resource, sys, time; from pathlib import Path; import eccodes, pyproj\n"
        "from pareto_ltl.wind.area import GeoBox\n"
        "from pareto_ltl_apps.formats.grib_files import grib_snapshots\n"
        "used = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3\n"
        "before, start = used(), time.perf_counter()\n"
        "grib_snapshots((Path(sys.argv[1]),), 75.0, area=GeoBox(-112.1, 23.4, 40.2, 50.5, 1e6))\n"
        "print(time.perf_counter() - start, used() - before)"
    )

    def read():
        done = subprocess.run(
            [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True
        )
        return list(map(float, done.stdout.split()))

    benchmark.extra_info["budget"] = 150.0  # [MB]
    benchmark.extra_info["seconds"], benchmark.extra_info["megabytes"] = benchmark.pedantic(read, rounds=1)


def hrrr_message(eccodes, short):
    handle = eccodes.codes_grib_new_from_samples("regular_ll_sfc_grib2")
    plane = {"LaD": 38.5, "LoV": 262.5, "Latin1": 38.5, "Latin2": 38.5}
    corner = {"latitudeOfFirstGridPoint": 21.138123, "longitudeOfFirstGridPoint": 237.280472}
    settings = {"gridType": "lambert", "Nx": 1799, "Ny": 1059, "DxInMetres": 3000, "DyInMetres": 3000}
    settings |= {f"{name}InDegrees": value for name, value in (plane | corner).items()}
    settings |= {"shapeOfTheEarth": 6, "jScansPositively": 1, "uvRelativeToGrid": 1}
    settings |= {"dataDate": 20181009, "dataTime": 600, "typeOfLevel": "heightAboveGround", "level": 10}
    for key, value in (settings | {"shortName": short, "bitsPerValue": 12}).items():
        eccodes.codes_set(handle, key, value)
    y, x = np.mgrid[0:1059, 0:1799]
    eccodes.codes_set_values(handle, (5 + 3 * np.sin(x / 100) + 2 * np.cos(y / 80)).ravel())
    raw = eccodes.codes_get_message(handle)
    eccodes.codes_release(handle)
    return raw


@pytest.mark.skipif(not NOAA.is_dir(), reason="the NOAA files are not beside this checkout")
@pytest.mark.parametrize(
    ("source", "path", "budget"),
    [
        ("netcdf", "gfs_netcdf/GFS_test.nc", 0.5),
        ("stations", "metar/metars.cache.csv.gz", 1.0),
    ],
)
def test_read_and_place_other_sources(benchmark, source, path, budget):
    cfg = WindConfig(source=source, path=str(NOAA / path), hold_last=True, max_gap=48.0)
    readings = sources.read_readings(cfg)
    there = replace(SCENE, time_zero=readings.first_time)
    benchmark.extra_info["budget"] = budget
    benchmark.pedantic(observed, (cfg, there), rounds=3)


def test_fit_28_processes_of_120_readings(benchmark, seen):
    benchmark.extra_info["budget"] = 4.0
    posterior = benchmark.pedantic(regression.fit_posterior, (WindConfig(), seen), rounds=3, warmup_rounds=1)
    benchmark.extra_info.update(posterior.score)


def test_evaluate_the_lattice(benchmark, seen):
    posterior = regression.fit_posterior(WindConfig(), seen)
    origin, spacing, shape = wind_lattice(SCENE.bounds, WindConfig().spacing, WindConfig().padding)
    nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 2)
    benchmark.extra_info["budget"] = 2.0
    benchmark.pedantic(posterior.at, (origin + spacing * nodes,), rounds=3)


def test_recall_both_from_memory(benchmark, seen, tmp_path, monkeypatch):
    monkeypatch.setenv("PARETO_LTL_CACHE", str(tmp_path))
    field.fit_wind_field(WindConfig(), seen, SCENE)
    benchmark.extra_info["budget"] = 0.1
    benchmark(field.fit_wind_field, WindConfig(), seen, SCENE)


def test_store_the_field(benchmark, seen, tmp_path):
    wind = field.fit_wind_field(WindConfig(cache=False), seen, SCENE)
    benchmark.pedantic(write_netcdf, (wind, tmp_path / "wind.nc", SCENE), rounds=5, warmup_rounds=1)
