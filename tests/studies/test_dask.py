"""Studies and sweeps on a cluster of Dask: nothing is lost when workers are killed."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import dask
import pytest
from distributed import Client, LocalCluster

from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies import cluster, parts
from pareto_ltl_apps.studies.cluster import connected
from pareto_ltl_apps.studies.parts import Part
from pareto_ltl_apps.studies.settings import EvaluationConfig
from patience import PATIENCE
from quick_wind import wind_words
from small_study import files

PARTS = 20


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """The scheduler of two workers, each a process with one thread.

    Dask gives up a worker that has not started again in time, 15 s if nothing else is set.
    """
    patient = dask.config.set({"distributed.deploy.lost-worker-timeout": f"{PATIENCE:.0f}s"})
    with (
        patient,
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50) as local,
    ):
        yield local.scheduler_address


@pytest.fixture(autouse=True)
def _sent_by_value() -> Iterator[None]:
    """Workers cannot import this module."""
    import cloudpickle

    module: ModuleType = sys.modules[__name__]
    cloudpickle.register_pickle_by_value(module)
    yield
    cloudpickle.unregister_pickle_by_value(module)


def some(count: int, *more: Any) -> list[Part]:
    return [Part(f"square-{k}", (k, *more), parts.part_key(Settings(), "square", k)) for k in range(count)]


def square(context: int, k: int) -> dict[str, float]:
    return {"value": context + k * k, "third": k / 3}


def counted(seen: list[int], done: int, total: int) -> None:
    assert total == PARTS
    seen.append(done)


def deadly(context: int, k: int, folder: str) -> dict[str, float]:
    """Kills the process of every tenth part when it runs for the first time."""
    mark = Path(folder) / str(k)
    if k % 10 == 0 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return square(context, k)


def test_a_cluster_does_what_one_process_does(address: str, tmp_path: Path) -> None:
    for name, cfg in (("here", EvaluationConfig(jobs=1)), ("there", EvaluationConfig(cluster=address))):
        seen: list[int] = []
        parts.work_parts(cfg, tmp_path / name, square, 3, some(PARTS), partial(counted, seen))
        assert seen == list(range(1, PARTS + 1))
    assert files(tmp_path / "here" / parts.PARTS_FOLDER) == files(tmp_path / "there" / parts.PARTS_FOLDER)


def test_no_part_is_lost_when_workers_are_killed(address: str, tmp_path: Path) -> None:
    cfg, marks = EvaluationConfig(cluster=address), tmp_path / "marks"
    marks.mkdir()
    done = parts.work_parts(cfg, tmp_path, deadly, 3, some(PARTS, str(marks)))
    assert [result["value"] for result in done] == [3 + k * k for k in range(PARTS)]
    assert len(list(marks.iterdir())) == PARTS // 10


def test_a_part_that_kills_each_of_its_workers_is_given_up_and_the_others_are_kept(
    address: str, tmp_path: Path
) -> None:
    def always(context: int, k: int) -> dict[str, float]:
        if k == 4:
            os.kill(os.getpid(), signal.SIGKILL)
        return square(context, k)

    with pytest.raises(DataError, match=r"1 of 8 parts have no result: square-4"):
        parts.work_parts(EvaluationConfig(cluster=address), tmp_path, always, 0, some(8))
    rest = [part for part in some(8) if part.name != "square-4"]
    assert len(parts.work_parts(EvaluationConfig(jobs=1), tmp_path, square, 0, rest)) == 7


def test_a_worker_with_other_code_is_refused(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pareto_ltl_apps.studies.cluster._code", lambda: "of another version")
    with pytest.raises(DataError, match="has another version of pareto_ltl: install the same one everywhere"):
        parts.work_parts(EvaluationConfig(cluster=address), tmp_path, square, 0, some(3))


def test_a_sweep_on_a_cluster_has_the_table_of_one_without(address: str, tmp_path: Path) -> None:
    words = [
        "sweep", "+experiment=hop", "seed=1,2", "planner.trees=1", "planner.n_max=300", "report=none",
        "fidelity.refine=none", "fidelity.judge=bound", "exports=none", "planner.epsilon=0.5",
        "planner.delta=0.9", *wind_words(),
    ]  # fmt: skip
    for name, launcher in (
        ("here", []),
        ("there", ["hydra/launcher=dask", f"hydra.launcher.address={address}"]),
    ):
        code = run_command_line([*words, *launcher, f"hydra.sweep.dir={tmp_path / name}"])
        assert code == 0
    here, there = ((tmp_path / name / "summary.csv").read_bytes() for name in ("here", "there"))
    assert here == there
    assert len(list(csv.DictReader(here.decode().splitlines()))) == 2


def test_workers_that_start_again_when_they_are_counted_are_awaited() -> None:
    """They were there a moment ago: the answer is no number of threads, and none to complain about."""
    seen = iter([{}, {}, {"tcp://a": {"nthreads": 1}}])
    restarting: Any = SimpleNamespace(
        wait_for_workers=lambda *_, **__: None, scheduler_info=lambda **_: {"workers": next(seen)}
    )
    assert cluster.threads_of_workers(restarting) == {1}


def test_what_is_no_cluster_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pareto_ltl_apps.studies.cluster.PATIENCE", 1.0)
    with (
        pytest.raises(ConfigError, match=r"no scheduler of Dask answers .* start one with 'dask scheduler'"),
        connected("tcp://127.0.0.1:1"),
    ):
        pass
    with LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as empty:
        with (
            pytest.raises(ConfigError, match="the scheduler has no workers"),
            connected(empty.scheduler_address),
        ):
            pass
        worker = subprocess.Popen(
            [
                sys.executable, "-m", "dask", "worker", empty.scheduler_address, "--nthreads", "2",
                "--no-dashboard",
            ],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            with Client(empty.scheduler_address, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=60)
            with (
                pytest.raises(ConfigError, match="workers have 2 threads"),
                connected(empty.scheduler_address),
            ):
                pass
        finally:
            worker.terminate()
            worker.wait()
