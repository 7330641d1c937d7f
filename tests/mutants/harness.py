"""Would the tests notice a fault? Mutants of modules, each run against the tests of its module.

    make mutants COUNT=100 SEED=2026-11-28
    cd tests && python -m mutants.harness [--count N] [--seed S] [module ...]

Mutants are first made in memory (``quick.py``): a fork of a process that has collected the tests gets the
code of the changed function, which costs a mutant that is killed a second. What these tests do not notice, or
what cannot be made in this way, is written into a copy of ``src``, one at a time, and tested from the start,
in a fork of a process that has imported the packages of others. Tests have a limit of processor time: a
mutant that loops is killed by it. Exit codes: 0, at least :data:`WANTED` of the mutants are killed; 1, fewer;
2, the tests fail without a mutant.
"""

from __future__ import annotations

import argparse
import importlib
import io
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path

from mutants.making import Mutant, drawn
from mutants.quick import killed_in_memory
from mutants.table import EQUIVALENT, MODULES

TESTS = Path(__file__).parents[1]
ROOT = TESTS.parent
WANTED = 0.95
MORE_TIME = (10.0, 3.0)  # [s] and times the processor time of the tests without a mutant
WALL = 20.0  # times that limit, on the clock: the machine may be shared
# Imported once for all mutants; no module of ours is among them.
FOREIGN = (
    "numpy", "scipy.stats", "scipy.optimize", "scipy.sparse", "scipy.spatial", "scipy.integrate", "numba",
    "shapely", "pyproj", "yaml", "networkx", "h5py", "h5netcdf", "moocore", "clarabel", "cvxpy",
    "sklearn.gaussian_process", "pytest",
)  # fmt: skip


def copied(folder: Path) -> Path:
    """The ``src`` of a copy of what the package consists of, with its machine code, in ``folder``."""
    for name in ("src", "conf", "pipelines"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("*.pyc"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder / "src"


def file_of(module: str, source: Path) -> Path:
    """The file of a module below ``source``."""
    path = source.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def run(tests: Sequence[str], source: Path, seconds: float) -> tuple[bool, float, str]:
    """Whether the tests pass with the packages in ``source``, their processor time, and what pytest printed.

    Tests that take longer than ``seconds`` of processor time do not pass.
    """
    with tempfile.TemporaryDirectory(prefix="mutant_") as folder:
        begun, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        printed = Path(folder) / "printed.txt"
        child = os.fork()
        if child == 0:
            _run_here(tests, source, seconds, Path(folder))
        code = _waited(child, begun + WALL * seconds)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return code == 0, spent, printed.read_text(errors="replace") if printed.exists() else ""


def _waited(child: int, until: float) -> int:
    """The exit code of a process; another than 0 if it does not end in time, and is ended."""
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status
        if time.monotonic() > until:
            with suppress(ProcessLookupError):
                os.killpg(child, 9)
            os.waitpid(child, 0)
            return 1
        time.sleep(0.02)


def _run_here(tests: Sequence[str], source: Path, seconds: float, folder: Path) -> None:
    """Run the tests in this process, a fork, and end it."""
    code = 1
    try:
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
        sys.path[:0] = [str(source), str(TESTS)]
        os.environ["PYTHONPATH"] = str(source)
        os.chdir(ROOT)
        pytest = importlib.import_module("pytest")
        text = io.StringIO()
        with redirect_stdout(text), redirect_stderr(text):
            words = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", f"--basetemp={folder / 'tests'}"]
            code = int(pytest.main([*words, *(f"tests/{name}" for name in tests)]))
        (folder / "printed.txt").write_text(text.getvalue(), errors="replace")
    except BaseException:
        (folder / "printed.txt").write_text(traceback.format_exc(), errors="replace")
    finally:
        os._exit(code)


def import_foreign() -> None:
    """Import the packages of others that are installed."""
    for name in FOREIGN:
        with suppress(ImportError):
            importlib.import_module(name)


class Limits:
    """How long the tests of a module take without a mutant, each measured once."""

    def __init__(self, source: Path) -> None:
        self.source, self.spent = source, dict[tuple[str, ...], float]()

    def of(self, tests: tuple[str, ...]) -> float:
        """The limit of processor time [s] of the tests on a mutant."""
        if tests not in self.spent:
            passed, seconds, printed = run(tests, self.source, 600.0)
            if not passed:
                sys.exit(f"{printed[-3000:]}\n{' '.join(tests)}: these tests fail without a mutant")
            self.spent[tests] = seconds
            print(f"{seconds:6.1f} s  {' '.join(tests)}", flush=True)
        return MORE_TIME[0] + MORE_TIME[1] * self.spent[tests]


def survivors(chosen: Sequence[Mutant], tests: Mapping[str, tuple[str, ...]], source: Path) -> list[Mutant]:
    """The mutants that the tests of their modules do not notice; a line for each mutant is printed.

    ``source`` is a copy, whose files are as they were afterwards.
    """
    limits, alive = Limits(source), list[Mutant]()
    for names in dict.fromkeys(tests[mutant.module] for mutant in chosen):
        of_tests = [mutant for mutant in chosen if tests[mutant.module] == names]
        killed = killed_in_memory(of_tests, names, source, limits.of(names), TESTS)
        for mutant in of_tests:
            passed, seconds = (
                (False, killed[mutant]) if mutant in killed else _from_start(mutant, names, limits)
            )
            alive += [mutant] * passed
            told = "SURVIVES" if passed else "killed"
            print(f"{told:8} {seconds:5.1f} s  {mutant.text()}", flush=True)
    return alive


def _from_start(mutant: Mutant, tests: tuple[str, ...], limits: Limits) -> tuple[bool, float]:
    """Whether the tests pass with a mutant that is written into the source, and their processor time [s]."""
    file = file_of(mutant.module, limits.source)
    before = file.read_text(encoding="utf-8")
    try:
        _write(file, mutant.source)
        passed, seconds, _ = run(tests, limits.source, limits.of(tests))
    finally:
        _write(file, before)
    return passed, seconds


def _write(file: Path, text: str) -> None:
    """Write a source with a time of its own: bytecode is found by the second in which a file was written."""
    written = int(file.stat().st_mtime) + 2
    file.write_text(text, encoding="utf-8")
    os.utime(file, (written, written))


def main(words: Sequence[str] | None = None) -> int:
    """Draw mutants, run the tests of each, and print the score."""
    parser = argparse.ArgumentParser(prog="make mutants", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("modules", nargs="*", metavar="module", help=f"of {', '.join(MODULES)}")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", nargs="+", default=["0"], help="of the mutants that are drawn, for each")
    asked = parser.parse_args(words)
    if unknown := set(asked.modules) - set(MODULES):
        parser.error(f"no row of mutants/table.py: {', '.join(sorted(unknown))}")
    names = asked.modules or list(MODULES)
    import_foreign()
    with tempfile.TemporaryDirectory(prefix="mutants_") as folder:
        source = copied(Path(folder))
        files = {name: file_of(name, source) for name in names}
        chosen = [one for seed in asked.seed for one in drawn(files, asked.count, seed)]
        known = [one for one in chosen if one.key in EQUIVALENT]
        alive = survivors([one for one in chosen if one not in known], MODULES, source)
    judged = len(chosen) - len(known)
    share = 1.0 - len(alive) / max(judged, 1)
    for one in alive:
        print(f"survives: {one.text()}")
    print(
        f"seeds {', '.join(asked.seed)}: {judged - len(alive)} of {judged} mutants killed, "
        f"{100 * share:.1f} %; {len(known)} left out, which change no result"
    )
    return 0 if share >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
