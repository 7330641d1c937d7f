"""Mutants made in memory: tests are collected once, and each mutant is a fork with other code in a function.

What fails then is killed. What passes may still be noticed by tests that run from the start: a function may
have been called while the modules were imported, its results may be kept, and a kernel is compiled. So only
kills count here.
"""

from __future__ import annotations

import gc
import importlib
import inspect
import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from mutants.making import Mutant

WALL = 20.0  # times the limit of processor time, on the clock
NEW_LOCALS = inspect.CO_NEWLOCALS  # flag of the code of a function, which the body of a class has not
PAUSE = 0.02  # [s] between two looks at a process


def changed_code(before: str, after: str, file: str) -> dict[str, CodeType] | None:
    """The new code of functions by their qualified name; None if something else is changed as well.

    Names are those of functions that exist twice nowhere in the module.
    """
    old, new = (compile(text, file, "exec") for text in (before, after))
    functions = list(_outermost(old))
    names = [code.co_qualname for code in functions]
    if _bare(old) != _bare(new) or len(names) != len(set(names)):
        return None
    return {b.co_qualname: b for a, b in zip(functions, _outermost(new), strict=True) if _text(a) != _text(b)}


def _outermost(code: CodeType) -> Iterator[CodeType]:
    """The functions of a module and its classes, without those inside them."""
    for part in code.co_consts:
        if isinstance(part, CodeType):
            if part.co_flags & NEW_LOCALS:
                yield part
            else:
                yield from _outermost(part)


def _text(code: CodeType) -> tuple[Any, ...]:
    """What two equal codes have in common wherever their lines are."""
    consts = tuple(_text(part) if isinstance(part, CodeType) else repr(part) for part in code.co_consts)
    return code.co_code, consts, code.co_names, code.co_varnames, code.co_freevars


def _bare(code: CodeType) -> tuple[Any, ...]:
    """The code of a module and its classes, without that of functions."""
    return code.co_code, tuple(map(_bare_constant, code.co_consts)), code.co_names


def _bare_constant(part: object) -> Any:
    if not isinstance(part, CodeType):
        return repr(part)
    return part.co_qualname if part.co_flags & NEW_LOCALS else _bare(part)


def put(new: dict[str, CodeType], file: str) -> bool:
    """Give all live functions of a file their new code; whether each was found, and none is compiled."""
    found = set()
    for one in gc.get_objects():
        if isinstance(one, FunctionType) and one.__code__.co_filename == file and one.__qualname__ in new:
            code = new[one.__qualname__]
            if one.__code__.co_freevars != code.co_freevars:
                return False
            one.__code__ = code
            found.add(one.__qualname__)
    return found == set(new)


class Judge:
    """Plugin of pytest: instead of running the tests once, runs them in a fork for each mutant."""

    def __init__(self, mutants: Sequence[Mutant], seconds: float, report: Path) -> None:
        self.mutants, self.seconds, self.report = mutants, seconds, report

    def pytest_runtestloop(self, session: Any) -> bool:
        with self.report.open("w", encoding="utf-8") as file:
            for number, mutant in enumerate(self.mutants):
                module = sys.modules.get(mutant.module)
                if module is None or module.__file__ is None or hasattr(module, "njit"):
                    continue
                new = changed_code(Path(module.__file__).read_text("utf-8"), mutant.source, module.__file__)
                if not new:
                    continue
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                if self._fails(session, new, module.__file__):
                    after = resource.getrusage(resource.RUSAGE_CHILDREN)
                    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
                    file.write(json.dumps([number, spent]) + "\n")
                    file.flush()
        return True

    def _fails(self, session: Any, new: dict[str, CodeType], file: str) -> bool:
        """Whether a test fails, or does not end, with the new code."""
        until, child = time.monotonic() + WALL * self.seconds, os.fork()
        if child == 0:
            code = 0
            try:
                os.setpgid(0, 0)
                resource.setrlimit(resource.RLIMIT_CPU, (int(self.seconds), int(self.seconds) + 1))
                if put(new, file):
                    code = 3 if _run(session) else 0
            except BaseException:
                code = 0
            finally:
                os._exit(code)
        while True:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                return status != 0
            if time.monotonic() > until:
                with suppress(ProcessLookupError):
                    os.killpg(child, 9)
                os.waitpid(child, 0)
                return True
            time.sleep(PAUSE)


def _run(session: Any) -> bool:
    """Run the collected tests until one fails; whether one does."""
    for item, after in zip(session.items, [*session.items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
        if session.testsfailed:
            return True
    return False


def killed_in_memory(
    mutants: Sequence[Mutant], tests: Sequence[str], source: Path, seconds: float, folder: Path
) -> dict[Mutant, float]:
    """The mutants that the tests notice, with their processor time [s]; ``folder`` is that of all tests."""
    with tempfile.TemporaryDirectory(prefix="mutants_") as place:
        report, child = Path(place) / "killed.txt", os.fork()
        if child == 0:
            try:
                with Path(os.devnull).open("w") as nothing:
                    os.dup2(nothing.fileno(), 1)
                    os.dup2(nothing.fileno(), 2)
                sys.path[:0] = [str(source), str(folder)]
                os.environ["PYTHONPATH"] = str(source)
                os.chdir(folder.parent)
                pytest = importlib.import_module("pytest")
                for mutant in mutants:
                    with suppress(ImportError):
                        importlib.import_module(mutant.module)
                words = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", f"--basetemp={place}/tests"]
                names = [f"{folder.name}/{name}" for name in tests]
                pytest.main([*words, *names], plugins=[Judge(mutants, seconds, report)])
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        lines = report.read_text("utf-8").splitlines() if report.exists() else []
    return {mutants[number]: spent for number, spent in map(json.loads, lines)}
