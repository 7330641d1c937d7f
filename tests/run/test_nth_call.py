"""A fault at the n-th call of open, write, fsync or replace in a small plan: at night for all n.

The search is made once and then given, so that a run takes a second. Whatever fails, the command ends with
one line and exit code 2, no file is half-written, no draft stays, and the next run succeeds.
"""

from __future__ import annotations

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from levels import AT_NIGHT
from pareto_ltl.planning import growth
from pareto_ltl_apps.cli.commands import run_command_line
from whole_files import check_whole

RUN = (
    "+experiment=phi1", "wind=calm", "planner.trees=1", "planner.n_max=400", "fidelity=paper",
    "fidelity.refine=none", "deployment.runs=20", "report=none",
)  # fmt: skip
CALLS = ("open", "write", "fsync", "replace")
FEW = (1, 5)  # by day
MOST = 400  # calls of one kind in a run


class Faulty:
    """Counts the calls of one kind that concern files below ``place``, and fails the n-th of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, place: Path, kind: str, number: int) -> None:
        self.place, self.number, self.count = str(place), number, 0
        opened, closed, replaced = io.open, os.fsync, os.replace

        def open_(file: Any, mode: str = "r", *args: Any, **options: Any) -> Any:
            inside = isinstance(file, str | os.PathLike) and self.place in os.fspath(file)
            if inside and kind == "open":
                self.call(file)
            stream = opened(file, mode, *args, **options)
            return Counted(stream, self) if inside and kind == "write" and mode[0] in "wax+" else stream

        def fsync(number: int) -> None:
            if kind == "fsync":
                self.call(None)
            closed(number)

        def replace(source: Any, target: Any, **options: Any) -> None:
            if kind == "replace" and self.place in os.fspath(target):
                self.call(target)
            replaced(source, target, **options)

        for module, name, stand_in in (
            (io, "open", open_), (builtins, "open", open_), (os, "fsync", fsync), (os, "replace", replace),
        ):  # fmt: skip
            monkeypatch.setattr(module, name, stand_in)

    def call(self, file: Any) -> None:
        self.count += 1
        if self.count == self.number:
            raise OSError(errno.EIO, os.strerror(errno.EIO), None if file is None else os.fspath(file))


class Counted:
    """A stream whose writes count."""

    def __init__(self, stream: Any, faulty: Faulty) -> None:
        self.stream, self.faulty = stream, faulty

    def write(self, data: Any) -> Any:
        self.faulty.call(getattr(self.stream, "name", None))
        return self.stream.write(data)

    def __enter__(self) -> Counted:
        return self

    def __exit__(self, *error: object) -> None:
        self.stream.close()

    def __iter__(self) -> Iterator[Any]:
        return iter(self.stream)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """``grow_forest`` with the forest of one run."""
    made: list[Any] = []
    grown = growth.grow_forest

    def once(*args: Any, **options: Any) -> Any:
        if not made:
            made.append(grown(*args, **options))
        return made[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(growth, "grow_forest", once)
        assert run_command_line([*RUN, f"hydra.run.dir={tmp_path_factory.mktemp('first')}"]) == 0
    return once


@pytest.mark.parametrize("kind", CALLS)
def test_a_fault_at_the_nth_call_leaves_nothing_half_written(
    kind: str, search: Callable[..., Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(1, MOST) if AT_NIGHT else FEW:
        place = tmp_path / f"{kind}{number}"
        command = [*RUN, f"hydra.run.dir={place}"]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(growth, "grow_forest", search)
            faulty = Faulty(patch, place, kind, number)
            code = run_command_line(command)
            said = capsys.readouterr()
        assert not list(place.glob(".*.*")), (number, "a draft is left")
        check_whole(place, "failed")
        if faulty.count < number:
            assert code == 0
            break
        assert (code, said.err.count("\n"), "Traceback" in said.err) == (2, 1, False), (number, said.err)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(growth, "grow_forest", search)
        assert run_command_line(command) == 0
