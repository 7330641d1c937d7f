"""What is remembered between runs, and how many cores a run takes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from careful_io import folders
from careful_io.machine import GIVEN, cores
from pareto_ltl.support import cache
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.commands import run_command_line
from patience import PATIENCE

FIT = """
import sys
import numpy as np
from pareto_ltl.settings import SceneConfig, WindConfig
from pareto_ltl.world.scene_settings import scene_from_settings as read_scene
from pareto_ltl.wind.records import WindObservations
from pareto_ltl.wind import field
from wind_laws import gp as regression

whole = regression.fit_posterior
def noted(cfg, seen, bounds):
    with open("fits.txt", "a") as file:
        file.write("fit\\n")
    return whole(cfg, seen, bounds)
regression.fit_posterior = noted
place = {"a": [[5e5, 5e5], [6e5, 5e5], [5e5, 6e5]]}
scene = read_scene(SceneConfig(bounds=[[0, 0], [1e6, 1e6]], start=[1e5, 1e5], regions=place), None)
rng = np.random.default_rng(int(sys.argv[1]))
points = rng.uniform(0, 1e6, (30, 2))
seen = WindObservations(np.zeros(1), (points,), (rng.normal(0, 3, (30, 2)),), "made up")
print(repr(float(field.fit_wind_field(WindConfig(), seen, scene).mean.sum())))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PARETO_LTL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def fit(seed: int = 0) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", FIT, str(seed)], stdout=subprocess.PIPE, text=True)


def test_processes_that_begin_together_fit_the_wind_once_and_agree(folder: Path) -> None:
    processes = [fit() for _ in range(3)]
    outputs = {process.communicate(timeout=PATIENCE)[0] for process in processes}
    assert [process.returncode for process in processes] == [0, 0, 0]
    assert len(outputs) == 1
    assert Path("fits.txt").read_text().split() == ["fit"]


def test_the_cache_keeps_below_its_limit(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PARETO_LTL_CACHE_MIB", "0")
    with fit() as process:
        assert process.wait(timeout=PATIENCE) == 0
    assert list((folder / "wind").iterdir()) == []
    monkeypatch.delenv("PARETO_LTL_CACHE_MIB")
    with fit() as process:
        assert process.wait(timeout=PATIENCE) == 0
    assert [path.suffix for path in sorted((folder / "wind").iterdir())] == [".npz"]


def test_the_entries_that_were_not_used_for_longest_go_first(tmp_path: Path) -> None:
    for number, name in enumerate(("old", "used", "new")):
        (tmp_path / f"{name}.npz").write_bytes(bytes(100))
        (tmp_path / f"{name}.json").touch()
        os.utime(tmp_path / f"{name}.npz", (number, number))
    folders.mark_used(tmp_path / "old.npz")
    folders.trim_folder(tmp_path, 250)
    assert {path.name for path in tmp_path.iterdir()} == {"old.npz", "old.json", "new.npz", "new.json"}


def test_the_command_tells_the_size_and_clears(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "wind").mkdir(parents=True)
    (folder / "wind" / "entry").write_bytes(bytes(3 * 2**20))
    other = folder / "somebody_elses"
    other.touch()
    assert run_command_line(["cache"]) == 0
    assert f"{folder}: 2 files, 3.0 of 1024 MiB" in capsys.readouterr().out
    assert run_command_line(["cache", "clear"]) == 0
    assert "cleared 3.0 MiB" in capsys.readouterr().out
    assert list(folder.iterdir()) == [other]
    assert run_command_line(["cache", "clear"]) == 0
    assert run_command_line(["cache", "burn"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_limit_that_is_no_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PARETO_LTL_CACHE_MIB", "1 GB")
    with pytest.raises(ConfigError, match="whole number of MiB, got '1 GB'"):
        cache.cache_limit()


def test_a_run_takes_the_cores_it_was_given(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in GIVEN:
        monkeypatch.delenv(name, raising=False)
    assert cores() == len(os.sched_getaffinity(0))
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "3")
    assert cores() == 3
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    assert cores() == 2
    monkeypatch.setenv("OMP_NUM_THREADS", "4,2")  # OpenMP's nested form says nothing to us
    assert cores() == 3
