"""Wind budgets: 28 processes of 120 readings in 4 s, the lattice in 2 s, both from memory in 0.1 s.

    python -m pytest benchmarks/bench_wind.py --benchmark-columns=min,median,rounds

The budget of each line is in its ``extra_info`` [s].
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pareto_ltl.settings import WindConfig
from pareto_ltl.wind import field, sources
from pareto_ltl.wind import gp as regression
from pareto_ltl.wind.netcdf import write_netcdf
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.world import projection
from pareto_ltl.world.scene import Scene

NOAA = Path(__file__).parents[2] / "shared" / "data" / "noaa"
SCENE = Scene(
    np.array([[-5e5, -5e5], [5e5, 5e5]]),
    np.zeros(2),
    {},
    (),
    projection.local_plane(37.0, -92.0),
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


def test_fit_28_processes_of_120_readings(benchmark, seen):
    benchmark.extra_info["budget"] = 4.0
    posterior = benchmark.pedantic(regression.fit_posterior, (WindConfig(), seen), rounds=3, warmup_rounds=1)
    benchmark.extra_info.update(posterior.score)


def test_evaluate_the_lattice(benchmark, seen):
    posterior = regression.fit_posterior(WindConfig(), seen)
    origin, spacing, shape = field.wind_lattice(WindConfig(), SCENE)
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
