"""Would the tests notice a fault? Mutants of the packages, each met by the tests that run its line.

    make mutants COUNT=100 SEED=2026-11-28
    cd tests && python -m mutants.harness [--count N] [--seed S] [name ...]

``reach.py`` has recorded which tests run which lines. Tests have a limit of processor time: a mutant that
loops is killed by it. Exit codes: 0, at least :data:`WANTED` of the mutants are killed; 1, fewer; 2, wrong
arguments.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence

from mutants.judge import Case, Verdict, judged
from mutants.making import Mutant, drawn
from mutants.reach import MOST_SECONDS, ROOT, Reach, record_all
from mutants.table import EQUIVALENT, UNCOMPILED, modules

WANTED = 0.95


def chosen_mutants(names: Sequence[str], count: int, seeds: Sequence[str]) -> list[Mutant]:
    """``count`` mutants of the modules whose name begins with one of ``names``, for each seed."""
    files = {name: file for name, file in modules().items() if not names or name.startswith(tuple(names))}
    return [one for seed in seeds for one in drawn(files, count, seed)]


def survivors(chosen: Sequence[Mutant], seconds: float) -> list[Mutant]:
    """The mutants that no test notices in so much processor time; a line for each mutant is printed."""
    alive, files = list[Mutant](), modules()

    def tell(case: Case, verdict: Verdict) -> None:
        told = "killed" if verdict.killed else "SURVIVES" if case.tests else "NO TEST"
        print(f"{told:8} {verdict.seconds:5.1f} s  {case.mutant.text()}", flush=True)
        alive.extend([case.mutant] * (not verdict.killed))

    for uncompiled in (False, True):
        of_road = [one for one in chosen if one.module.startswith(UNCOMPILED) == uncompiled]
        reach = Reach.read(uncompiled)
        cases = [reach.case(one, files[one.module], seconds) for one in of_road]
        if cases:
            _in_fork_with(uncompiled, cases, tell)
    return alive


def _in_fork_with(uncompiled: bool, cases: Sequence[Case], tell: Callable[[Case, Verdict], None]) -> None:
    before = os.environ.pop("NUMBA_DISABLE_JIT", None)
    if uncompiled:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    judged(cases, ROOT, tell)
    os.environ.pop("NUMBA_DISABLE_JIT", None)
    if before is not None:
        os.environ["NUMBA_DISABLE_JIT"] = before


def main(words: Sequence[str] | None = None) -> int:
    """Draw mutants, let the tests meet them, and print the score."""
    parser = argparse.ArgumentParser(prog="make mutants", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="module", help="or the beginning of its name")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", nargs="+", default=["0"], help="of the mutants that are drawn, for each")
    parser.add_argument("--seconds", type=float, default=MOST_SECONDS, help="of tests that meet one mutant")
    parser.add_argument("--old-records", action="store_true", help="of the lines that tests run")
    asked = parser.parse_args(words)
    if not asked.old_records:
        record_all()
    chosen = chosen_mutants(asked.names, asked.count, asked.seed)
    met = [one for one in chosen if one.key not in EQUIVALENT]
    alive = survivors(met, asked.seconds)
    share = 1.0 - len(alive) / max(len(met), 1)
    for one in alive:
        print(f"survives: {one.text()}")
    print(
        f"seeds {', '.join(asked.seed)}: {len(met) - len(alive)} of {len(met)} mutants killed, "
        f"{100 * share:.1f} %; {len(chosen) - len(met)} left out, which change no result"
    )
    return 0 if share >= WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
