"""Which tests run which lines: recorded for each folder of tests, so that a mutant meets its tests alone.

    cd tests && python -m mutants.reach [folder ...]

A record is a JSON file below ``build/mutants``, which takes the time of these tests to make. It is made again
when a source, or a test of its folder, is another one. ``PARETO_LTL_TESTS`` says which tests (``levels.py``).
"""

from __future__ import annotations

import ast
import hashlib
import json
import math
import os
import re
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import coverage
import pytest

from mutants.judge import Case
from mutants.making import Mutant
from mutants.table import FOLDERS, SOURCE, UNCOMPILED_FOLDERS, UNCOMPILED_SETTINGS

ROOT = Path(__file__).parents[2]
MOST_SECONDS = 20.0  # of tests that meet one mutant
SHARE_OF_OTHERS = 0.25  # as much again for further tests of the same files
FIRST = 3  # powers of 2 of seconds by which tests of the name of a module, and recorded numbers, come before
RECORDED = ("/test_recorded", "/test_declared")  # in names of files that compare all numbers of a result
RECORDS = ROOT / "build/mutants"


class Recorder:
    """Plugin of pytest: the lines of ``src`` by test, and the processor time of each test."""

    def __init__(self, record: Path, made_of: str) -> None:
        self.record, self.made_of, self.seconds = record, made_of, dict[str, float]()
        self.coverage = coverage.Coverage(
            data_file=None, config_file=False, source=[str(ROOT / "src")], messages=False
        )
        self.coverage.start()
        self.failed = set[str]()

    @pytest.hookimpl(hookwrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.coverage.switch_context(item.nodeid)
        begun = time.process_time()
        yield
        self.seconds[item.nodeid] = time.process_time() - begun
        self.coverage.switch_context("")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.outcome != "passed":  # a skipped test notices nothing
            self.failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.coverage.stop()
        data = self.coverage.get_data()
        names = [name for name in self.seconds if name not in self.failed]
        number = {name: k for k, name in enumerate(names)}
        lines: dict[str, dict[int, list[int]]] = {}
        imported: dict[str, list[int]] = {}
        for file in data.measured_files():
            of_file = {
                line: sorted(number[name] for name in tests if name in number)
                for line, tests in data.contexts_by_lineno(file).items()
            }
            lines[str(Path(file).relative_to(SOURCE))] = {k: v for k, v in of_file.items() if v}
            at_import = [k for k, tests in data.contexts_by_lineno(file).items() if "" in tests]
            imported[str(Path(file).relative_to(SOURCE))] = sorted(at_import)
        self.record.parent.mkdir(parents=True, exist_ok=True)
        tests = [[name, round(self.seconds[name], 3)] for name in names]
        self.record.write_text(
            json.dumps({"of": self.made_of, "tests": tests, "lines": lines, "imported": imported}),
            encoding="utf-8",
        )


def record_all(folders: Sequence[str] = ()) -> None:
    """Record the folders of tests, or these of them, each in a process of its own, where that is needed."""
    for uncompiled, of_road in ((False, FOLDERS), (True, UNCOMPILED_FOLDERS)):
        for folder in of_road:
            if (not folders or folder in folders) and not _is_new(folder, uncompiled):
                _record(folder, uncompiled)


def record_of(folder: str, uncompiled: bool) -> Path:
    """The file of the record of a folder."""
    return RECORDS / f"{folder}{'_uncompiled' * uncompiled}.json"


def _made_of(folder: str) -> str:
    """Checksum of the sources and of the tests of a folder."""
    digest = hashlib.sha256()
    tests = ROOT / "tests" / folder
    for file in sorted([*SOURCE.rglob("*.py"), *(tests.rglob("*.py") if tests.is_dir() else [tests])]):
        digest.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    return digest.hexdigest()


def _is_new(folder: str, uncompiled: bool) -> bool:
    file = record_of(folder, uncompiled)
    return file.exists() and json.loads(file.read_text(encoding="utf-8")).get("of") == _made_of(folder)


def _record(folder: str, uncompiled: bool) -> None:
    if (child := os.fork()) == 0:
        os.chdir(ROOT)
        if uncompiled:
            os.environ |= UNCOMPILED_SETTINGS
        words = ["-q", "-p", "no:cacheprovider", "-p", "no:xdist", f"tests/{folder}"]
        os._exit(int(pytest.main(words, plugins=[Recorder(record_of(folder, uncompiled), _made_of(folder))])))
    if os.waitpid(child, 0)[1]:
        sys.exit(f"tests/{folder}: these tests fail without a mutant")


class Reach:
    """Which tests run which lines, of all records."""

    def __init__(self) -> None:
        self.seconds = dict[str, float]()
        self.lines = dict[str, dict[int, list[str]]]()
        self.imported = dict[str, set[int]]()  # lines that are run outside a test, as by an import

    @classmethod
    def read(cls, uncompiled: bool) -> Reach:
        """The records of the tests that run compiled kernels, or of those that run them as Python."""
        self = cls()
        for folder in UNCOMPILED_FOLDERS if uncompiled else FOLDERS:
            if not (file := record_of(folder, uncompiled)).exists():
                continue
            record = json.loads(file.read_text(encoding="utf-8"))
            names = [name for name, _ in record["tests"]]
            self.seconds.update(record["tests"])
            for path, run in record.get("imported", {}).items():
                self.imported.setdefault(path, set()).update(run)
            for path, lines in record["lines"].items():
                of_file = self.lines.setdefault(path, {})
                for line, tests in lines.items():
                    of_file.setdefault(int(line), []).extend(names[k] for k in tests)
        return self

    def tests(
        self, mutant: Mutant, file: Path, seconds: float = MOST_SECONDS
    ) -> tuple[tuple[str, ...], float]:
        """The tests that meet a mutant, those first that cost least, and their processor time [s].

        They run the lines of the mutant; if none does, the statement around it, then the function; and where
        the mutant stands in no function, lines that name what it defines.
        """
        path = str(file.relative_to(SOURCE))
        of_file = self.lines.get(path, {})
        for spots in _lines_around(ast.parse(file.read_text(encoding="utf-8")), mutant):
            if isinstance(spots, str):
                found = self._naming(spots)
            else:
                found = {name for line in spots for name in of_file.get(line, ())}
            if found:
                return self._cheapest(found, mutant.module.rpartition(".")[2], seconds)
        return (), 0.0

    def case(self, mutant: Mutant, file: Path, seconds: float) -> Case:
        """A mutant and the tests that meet it."""
        lines = self.imported.get(str(file.relative_to(SOURCE)), set())
        at_import = not lines.isdisjoint(range(mutant.line, mutant.end + 1))
        return Case(mutant, file, *self.tests(mutant, file, seconds), at_import)

    def _naming(self, word: str) -> set[str]:
        """The tests that run a line with this word, of any module."""
        found, pattern = set[str](), re.compile(rf"\b{word}\b")
        for path, lines in self.lines.items():
            for number, text in enumerate((SOURCE / path).read_text(encoding="utf-8").splitlines(), 1):
                if number in lines and pattern.search(text):
                    found.update(lines[number])
        return found

    def _cheapest(self, names: set[str], module: str, seconds: float) -> tuple[tuple[str, ...], float]:
        """Tests of these names, as far as time reaches: of the module's name, recorded numbers, quick files.

        Among files that are as quick, the first of each, then the second of each. A file is as slow as its
        slowest test, since a test alone also makes the fixtures that it had from others when it was recorded.
        """
        files = dict[str, list[str]]()
        for name in sorted(self.seconds, key=lambda name: (self.seconds[name], name)):
            files.setdefault(name.partition("::")[0], []).append(name)
        place, others = dict[str, tuple[float, ...]](), dict[str, tuple[float, ...]]()
        for file, of_file in files.items():
            if names.isdisjoint(of_file):
                continue
            slowest = self.seconds[of_file[-1]]
            first = any(name in file for name in (f"test_{module}", *RECORDED))
            speed = round(math.log2(max(slowest, 0.5))) - FIRST * first
            place |= {
                name: (speed, k, self.seconds[name])
                for k, name in enumerate(n for n in of_file if n in names)
            }
            # What a fixture or a cache holds was run for one test, and is used by others of its file.
            others |= {name: (speed, k) for k, name in enumerate(of_file) if name not in names}
        chosen, spent, begun = list[str](), 0.0, set[str]()
        for most, queue in ((seconds, place), ((1.0 + SHARE_OF_OTHERS) * seconds, others)):
            for name in sorted(queue, key=queue.__getitem__):
                file = name.partition("::")[0]
                cost = self.seconds[name] if file in begun else self.seconds[files[file][-1]]
                if not chosen or spent + cost <= most:
                    begun.add(file)
                    chosen.append(name)
                    spent += cost
        return tuple(chosen), spent


def _lines_around(tree: ast.Module, mutant: Mutant) -> Iterator[Sequence[int] | str]:
    """The lines of a mutant and of what is around it, closest first; names that a module or class defines."""
    around: list[Any] = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.stmt) and node.lineno <= mutant.line and mutant.end <= (node.end_lineno or 0)
    ]
    around.sort(key=lambda node: node.lineno - node.end_lineno)
    functions = [node for node in around if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    if functions:
        body = functions[-1].body
        if mutant.line >= body[0].lineno:
            yield range(mutant.line, mutant.end + 1)
            yield range(around[-1].lineno, around[-1].end_lineno + 1)
        yield range(body[0].lineno, functions[-1].end_lineno + 1)
    elif around:
        held = around[-1]
        for target in getattr(held, "targets", [getattr(held, "target", None)]):
            if isinstance(target, ast.Name):
                yield target.id
        yield range(held.lineno, held.end_lineno + 1)
    yield range(1, len(ast.unparse(tree)))


if __name__ == "__main__":
    record_all(sys.argv[1:])
