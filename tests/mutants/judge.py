"""Mutants met by tests that were chosen for them, in forks of a process that has collected all of these.

Where a function changes, the fork gives it other code (:func:`put`). What is run while modules are imported
has left its results by then, as all does that is written in a module or a class. Such mutants meet their
tests in a process that imports the changed source (:class:`Changed`). Nothing is written to a file.

A test that notices a mutant is run once more in the same way without one. If it fails then too, it says
nothing, and the mutant meets the others.
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
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

from mutants.making import Mutant

MORE_TIME = (10.0, 4.0)  # [s] and times the processor time of the tests without a mutant
WALL = 20.0  # times that limit, on the clock: the machine may be shared
NEW_LOCALS = inspect.CO_NEWLOCALS  # flag of the code of a function, which the body of a class has not
PAUSE = 0.01  # [s] between two looks at a process
OPTIONS = ("-x", "-q", "--tb=no", "-p", "no:cacheprovider", "-p", "no:xdist")
# Imported once for all mutants; no module of ours is among them. Plugins of pytest are not, either: it warns
# of those that it finds imported, and our warnings are errors.
FOREIGN = (
    "numpy", "scipy.stats", "scipy.optimize", "scipy.sparse", "scipy.spatial", "scipy.integrate", "numba",
    "shapely", "pyproj", "yaml", "networkx", "h5py", "h5netcdf", "moocore", "clarabel", "cvxpy",
    "sklearn.gaussian_process",
)  # fmt: skip


class Case(NamedTuple):
    """A mutant, its source file, the tests that meet it, in their order, the time they take [s], and whether
    its line is run while modules are imported.
    """

    mutant: Mutant
    file: Path
    tests: tuple[str, ...]
    seconds: float
    at_import: bool = False


class Verdict(NamedTuple):
    """Whether a test noticed a mutant, and the processor time spent [s]."""

    killed: bool
    seconds: float


def judged(cases: Sequence[Case], root: Path, tell: Callable[[Case, Verdict], None]) -> dict[Mutant, Verdict]:
    """What the tests below ``root`` say of each mutant; ``tell`` is called with each verdict.

    A mutant without tests survives. Forks: the caller should not have threads.
    """
    verdicts = dict[Mutant, Verdict]()

    def settle(case: Case, verdict: Verdict) -> None:
        verdicts[case.mutant] = verdict
        tell(case, verdict)

    for case in cases:
        if not case.tests:
            settle(case, Verdict(False, 0.0))
    met = [case for case in cases if case.tests]
    spent = _told(met, root, _judge_in_memory, settle)
    rest = [case for case in met if case.mutant not in verdicts]
    _told(rest, root, _judge_from_start, settle, spent)
    return verdicts


def _told(
    cases: Sequence[Case],
    root: Path,
    judge: Callable[[Sequence[Case], Path, Any], None],
    settle: Callable[[Case, Verdict], None],
    before: dict[Mutant, float] | None = None,
) -> dict[Mutant, float]:
    """Let a fork judge the cases; settle what it decides, and return the time spent on the others [s]."""
    spent, (read, write) = dict[Mutant, float](), os.pipe()
    if not cases:
        return spent
    if (child := os.fork()) == 0:
        code = 1
        try:
            os.close(read)
            os.chdir(root)
            with os.fdopen(write, "w") as report:
                judge(cases, root, report)
            code = 0
        finally:
            os._exit(code)
    os.close(write)
    with os.fdopen(read) as lines:
        for number, outcome, seconds in map(json.loads, lines):
            case = cases[number]
            spent[case.mutant] = seconds + (before or {}).get(case.mutant, 0.0)
            if outcome is not None:
                settle(case, Verdict(outcome, spent[case.mutant]))
    if os.waitpid(child, 0)[1]:
        raise RuntimeError("the process that judges mutants ended early")
    return spent


def _judge_in_memory(cases: Sequence[Case], root: Path, report: Any) -> None:
    pytest = importlib.import_module("pytest")
    silence()
    files = sorted({name.partition("::")[0] for case in cases for name in case.tests})
    with tempfile.TemporaryDirectory(prefix="mutants_") as folder:
        judge = InMemory(cases, report)
        pytest.main([*OPTIONS, f"--basetemp={folder}/tests", *files], plugins=[judge])
    if not judge.ran:
        raise RuntimeError("the tests of the mutants cannot be collected")


class InMemory:
    """Plugin of pytest: instead of all tests, run those of each mutant in a fork."""

    def __init__(self, cases: Sequence[Case], report: Any) -> None:
        self.cases, self.report, self.ran, self.sound = cases, report, False, dict[str, bool]()

    def pytest_collection(self) -> None:
        find_only()

    def pytest_runtestloop(self, session: Any) -> bool:
        self.ran = True
        items = {item.nodeid: item for item in session.items}
        for case in self.cases:
            with suppress(ImportError):
                importlib.import_module(case.mutant.module)
        live = functions_by_file()
        gc.collect()
        gc.freeze()
        for number, case in enumerate(self.cases):
            new = changed_code(case.file.read_text("utf-8"), case.mutant.source, str(case.file))
            chosen = [items[name] for name in case.tests if name in items]
            if not new or not chosen:
                continue
            functions = live.get(str(case.file), [])
            code, seconds = meet(
                [item.nodeid for item in chosen],
                partial(_with, session, items, new, functions),
                partial(_with, session, items, {}, ()),
                limit(case),
                self.sound,
            )
            undecided = code == 4 or (code == 0 and case.at_import)
            self.report.write(json.dumps([number, None if undecided else code != 0, seconds]) + "\n")
            self.report.flush()
        return True


def find_only() -> None:
    """Let Hypothesis look for a failing example, and not for a smaller one: any failure will do."""
    hypothesis = importlib.import_module("hypothesis")
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
    hypothesis.settings.register_profile("mutants", hypothesis.settings.default, phases=phases)
    hypothesis.settings.load_profile("mutants")


def _with(
    session: Any,
    items: dict[str, Any],
    new: dict[str, CodeType],
    functions: Sequence[FunctionType],
    names: Sequence[str],
    told: Path,
) -> Callable[[], int]:
    return partial(_run, session, [items[name] for name in names], new, functions, told)


def _run(
    session: Any,
    items: Sequence[Any],
    new: dict[str, CodeType],
    functions: Sequence[FunctionType],
    told: Path,
) -> int:
    """Run these tests with the new code until one fails: 3 if one does, else 0; 4 if it cannot be given.

    The name of the test that fails is written into ``told``.
    """
    if not put(new, functions):
        return 4
    for item, after in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
        if session.testsfailed:
            told.write_text(item.nodeid)
            return 3
    return 0


def meet(
    names: Sequence[str],
    with_mutant: Callable[[Sequence[str], Path], Callable[[], int]],
    without: Callable[[Sequence[str], Path], Callable[[], int]],
    seconds: float,
    sound: dict[str, bool],
) -> tuple[int, float]:
    """The exit code of the tests that a mutant meets, and the processor time [s].

    ``sound`` holds whether tests that failed with a mutant pass without one; those that do not are left out.
    Tests that end without a failed one, since time is over or the process dies, are run without it as well:
    unless they then pass, they say nothing.
    """
    spent, names = 0.0, [name for name in names if sound.get(name, True)]
    with tempfile.TemporaryDirectory(prefix="mutant_") as folder:
        told = Path(folder) / "failed.txt"
        while names:
            told.unlink(missing_ok=True)
            code, took = forked(with_mutant(names, told), seconds)
            spent += took
            failed = told.read_text() if told.exists() else ""
            if code in (0, 4):
                return code, spent
            noticed = [failed] if failed else list(names)
            key = "\n".join(noticed)
            if key not in sound:
                alone, took = forked(without(noticed, told), seconds)
                sound[key], spent = alone == 0, spent + took
                if alone:
                    print(f"fails without a mutant, too: {', '.join(noticed)}", file=sys.stderr, flush=True)
            if sound[key]:
                return code, spent
            names = [name for name in names if name not in noticed]
    return 0, spent


def limit(case: Case) -> float:
    """The processor time [s] that the tests of a mutant may take."""
    return MORE_TIME[0] + MORE_TIME[1] * case.seconds


def forked(work: Callable[[], int], seconds: float) -> tuple[int, float]:
    """The exit code of ``work`` in a fork that may take so much processor time, and what it took [s]."""
    before, until = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() + WALL * seconds
    if (child := os.fork()) == 0:
        code = 5
        try:
            os.setpgid(0, 0)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
            silence()
            code = work()
        finally:
            os._exit(code)
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > until:
            with suppress(ProcessLookupError):
                os.killpg(child, 9)
            ended = os.waitpid(child, 0)
            break
        time.sleep(PAUSE)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    code = os.waitstatus_to_exitcode(ended[1])
    return code, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def silence() -> None:
    """Let this process print nothing."""
    with Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)


def _judge_from_start(cases: Sequence[Case], root: Path, report: Any) -> None:
    for name in FOREIGN:
        with suppress(ImportError):
            importlib.import_module(name)
    sound = dict[str, bool]()
    with tempfile.TemporaryDirectory(prefix="mutant_") as folder:
        first = partial(_meet_changed, None, cases[0].tests[:1], Path(folder) / "failed.txt")
        if forked(first, limit(cases[0]))[0] not in (0, 1):  # else each mutant would count as killed
            raise RuntimeError("tests of the mutants cannot be run")
    for number, case in enumerate(cases):
        code, seconds = meet(
            case.tests,
            partial(partial, _meet_changed, case),
            partial(partial, _meet_changed, None),
            limit(case),
            sound,
        )
        report.write(json.dumps([number, code != 0, seconds]) + "\n")
        report.flush()


def _meet_changed(case: Case | None, names: Sequence[str], told: Path) -> int:
    """Run these tests in this process, which imports the changed source; without a mutant, the source."""
    pytest = importlib.import_module("pytest")
    if case is not None:
        sys.meta_path.insert(0, Changed(case))
    files = list(dict.fromkeys(name.partition("::")[0] for name in names))
    words = [*OPTIONS, f"--basetemp={told.parent}/tests", *files]
    return int(pytest.main(words, plugins=[Chosen(names, told)]))


class Chosen:
    """Plugin of pytest: run these tests alone, in their order."""

    def __init__(self, names: Sequence[str], told: Path) -> None:
        self.names, self.told = names, told

    def pytest_collection(self) -> None:
        find_only()

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        of_name = {item.nodeid: item for item in items}
        items[:] = [of_name[name] for name in self.names if name in of_name]

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.told.write_text(report.nodeid)


class Changed(MetaPathFinder, SourceFileLoader):
    """Importer of one module with the source of its mutant."""

    def __init__(self, case: Case) -> None:
        SourceFileLoader.__init__(self, case.mutant.module, str(case.file))
        self.text = case.mutant.source

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if name != self.name:
            return None
        parts = [str(Path(self.path).parent)] if Path(self.path).name == "__init__.py" else None
        return spec_from_file_location(name, self.path, loader=self, submodule_search_locations=parts)

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.text, self.path, "exec")


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


def functions_by_file() -> dict[str, list[FunctionType]]:
    """All live functions by the file that they are written in."""
    found: dict[str, list[FunctionType]] = {}
    for one in gc.get_objects():
        if isinstance(one, FunctionType):
            found.setdefault(one.__code__.co_filename, []).append(one)
    return found


def put(new: dict[str, CodeType], functions: Sequence[FunctionType]) -> bool:
    """Give functions their new code; whether each was found, and none is a closure over other names."""
    found = set()
    for one in functions:
        if one.__qualname__ in new:
            code = new[one.__qualname__]
            if one.__code__.co_freevars != code.co_freevars:
                return False
            one.__code__ = code
            found.add(one.__qualname__)
    return found == set(new)
