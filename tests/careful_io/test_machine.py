"""Memory: what there is, and what does not fit is refused before it is asked for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from careful_io import machine
from pareto_ltl.support.errors import ConfigError


@pytest.fixture
def gigabyte_free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "available_memory", lambda: 1e9)


@pytest.mark.usefixtures("gigabyte_free")
def test_what_does_not_fit_is_refused_with_the_largest_value_that_does() -> None:
    with pytest.raises(ConfigError) as caught:
        machine.require_memory(1000.0, "planner.n_max", 10**7, "10 trees", "planner.trees")
    assert str(caught.value) == (
        "planner.n_max=10000000 needs 10 GB of memory for 10 trees, and 1 GB are free: at most 1000000 fits, "
        "or lower planner.trees"
    )
    machine.require_memory(1000.0, "planner.n_max", 1_000_000, "10 trees")


@pytest.mark.usefixtures("gigabyte_free")
def test_a_value_of_which_not_even_one_fits_is_refused() -> None:
    with pytest.raises(ConfigError, match="no value fits"):
        machine.require_memory(2e9, "planner.n_max", 2, "1 tree")


@pytest.mark.parametrize("names", machine.CGROUPS)
def test_the_limit_of_a_container_counts(
    names: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "CGROUP_FOLDER", tmp_path)
    for name, value in zip(names, (50_000_000, 20_000_000), strict=True):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(f"{value}\n")
    assert machine.available_memory() == 30_000_000


def test_a_container_without_a_limit_leaves_the_memory_of_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "CGROUP_FOLDER", tmp_path)
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "memory.current").write_text("1\n")
    assert list(machine.container_room()) == []
    assert machine.available_memory() > 0


@pytest.mark.parametrize("value", ["0", "-1", "two", "1.5", "²", " "])
def test_a_number_of_kernel_threads_that_is_none_is_refused(
    value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", value)
    with pytest.raises(
        ConfigError, match=r"NUMBA_NUM_THREADS must be a whole number from 1, got .*: unset it"
    ):
        machine.check_kernel_threads()


@pytest.mark.parametrize("value", ["1", "64", ""])
def test_a_number_of_kernel_threads_is_left_to_numba(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_NUM_THREADS", value)
    machine.check_kernel_threads()


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (("3", "2"), 3), (("1", "2"), 1), (("0", "2"), 2), (("", "1"), 1), (("-4", "2"), 2),
        (("two", "4"), 4), (("0", "0"), 5), (("", ""), 5),
    ],
)  # fmt: skip
def test_the_first_variable_with_a_number_says_how_many_cores_there_are(
    given: tuple[str, str], expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in zip(machine.GIVEN, given, strict=True):
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(os, "sched_getaffinity", {0: {0, 2, 3, 4, 6}}.__getitem__, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    assert machine.cores() == expected


@pytest.mark.parametrize(("counted", "expected"), [(7, 7), (1, 1), (None, 1)])
def test_without_a_set_of_cores_those_of_the_machine_count(
    counted: int | None, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in machine.GIVEN:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: counted)
    assert machine.cores() == expected
