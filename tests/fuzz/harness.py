"""Fuzzing of every reader, each target in its own process.

    make fuzz CASES=100000        or, from tests/, python -m fuzz.harness [--cases N] [--first N] [target ...]

A case must end within :data:`SECONDS`, make the process grow by at most :data:`GROWTH`, and end with a value
or with one of the package's errors, in one line. The process has a limit on its memory, and a case that ends
the process is shown. Hypothesis makes a failing case smaller. Cases come in blocks of 2,000 with the seeds 0,
1, and so on, or from ``--first``: the same numbers always give the same cases.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import psutil
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import HypothesisWarning

from careful_io.messages import LONGEST_LINE
from fuzz.kinds import KIND_TARGETS
from fuzz.records import CASES, Fuzz, Target
from fuzz.targets import TARGETS
from unmeasured import untraced

SECONDS = 10.0  # of one case
GROWTH = 2**30  # [bytes] of the process
LAST_CASE = "last_case.pickle"
SKIPPED = "cannot run here"


@dataclass(frozen=True, slots=True)
class Report:
    """Result of one target: number of cases read, seconds, and the text of each fault."""

    name: str
    cases: int = 0
    seconds: float = 0.0
    faults: tuple[str, ...] = ()
    skipped: bool = False

    def line(self) -> str:
        rate = self.cases / max(self.seconds, 1e-9)
        told = (
            SKIPPED if self.skipped else f"{self.cases:>8} cases {self.seconds:>7.1f} s {rate:>7.0f} cases/s"
        )
        return f"{self.name:<32}{SKIPPED if self.skipped else told}   {len(self.faults)} faults"


class SlowCaseError(BaseException):
    """A case took too long; no reader catches this."""


# --- in the process of a target --------------------------------------------------------------


def fuzz_here(target: Target, cases: int, place: Path, first: int = 0) -> Report:
    """Read ``cases`` cases of ``target`` in this process; stop a block of cases at its first fault.

    The number of a block, which begins with ``first``, is the seed of its cases.
    """
    prepared = target.prepare(place)
    if prepared is None:
        return Report(target.name, skipped=True)
    prepared = warmed(prepared, target)
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", HypothesisWarning)  # that a case is long
    _limit_memory()
    read, faults, start = 0, [], time.perf_counter()
    for block in range(-(-cases // CASES)):
        size = min(CASES, cases - block * CASES)
        counted: list[int] = []
        number = first + block
        try:
            read_block(target, prepared, place, number, size, counted)
        except SlowCaseError as error:
            faults.append(f"block {number}: {error}")
        except Exception as error:
            faults += [f"block {number}: {_fault_text(one)}" for one in _single_errors(error)]
        read += len(counted)
    return Report(target.name, read, time.perf_counter() - start, tuple(faults))


def warmed(prepared: Fuzz, target: Target) -> Fuzz:
    """Import what the readers import, before memory is limited, so that it does not count for a case."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")

        @seed(10**6)
        @house(20)
        @given(prepared.cases)
        def warm(case: Any) -> None:
            try:
                prepared.read(case)
            except Exception:
                return

        warm()
    return prepared


def house(cases: int) -> Any:
    return settings(
        max_examples=cases,
        deadline=None,
        database=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )


def read_block(
    target: Target, prepared: Fuzz, place: Path, block: int, size: int, counted: list[int]
) -> None:
    with (place / LAST_CASE).open("wb", buffering=0) as last:

        @seed(block)
        @house(size)
        @given(prepared.cases)
        def read(case: Any) -> None:
            _note_case(last, case, counted)
            _set_alarm(SECONDS)
            try:
                prepared.read(case)
            except target.allowed as error:
                check_line(str(error))
            finally:
                _set_alarm(0.0)

        read()


def _set_alarm(seconds: float) -> None:
    """Raise :class:`SlowCaseError` after ``seconds``; never for 0, or where the system has no such alarm."""
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _out_of_time)
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _note_case(last: Any, case: Any, counted: list[int]) -> None:
    """Write ``case`` to a file in case the process dies; end the process if C code does not return."""
    if len(counted) % 50 == 0:
        faulthandler.dump_traceback_later(6 * SECONDS, exit=True)
    counted.append(1)
    last.seek(0)
    last.truncate()
    last.write(pickle.dumps(case))


def check_line(text: str) -> None:
    """A message is one line of text, not empty, not endless, and can be printed."""
    assert text.strip(), "an error without a message"
    assert "\n" not in text, f"a message of several lines: {text!r}"
    assert len(text) <= LONGEST_LINE, f"a message of {len(text)} characters: {text[:300]!r}"
    text.encode()


def _out_of_time(number: int, frame: Any) -> None:
    where = "".join(traceback.format_stack(frame)[-3:])
    raise SlowCaseError(f"a case took more than {SECONDS:g} s at\n{where}")


def _limit_memory() -> None:
    """Limit the address space if the system can; otherwise growth is only measured at the end."""
    try:
        import resource
    except ImportError:
        return
    most = psutil.Process().memory_info().vms + GROWTH
    resource.setrlimit(resource.RLIMIT_AS, (most, most))


def _single_errors(error: BaseException) -> list[BaseException]:
    """Hypothesis raises all distinct faults of a block together."""
    if isinstance(error, BaseExceptionGroup):
        return [one for part in error.exceptions for one in _single_errors(part)]
    return [error]


def _fault_text(error: BaseException) -> str:
    """Kind and message, the last calls, and the case, each cut to a readable length."""
    calls = traceback.format_list(traceback.extract_tb(error.__traceback__)[-4:])
    notes = [note if len(note) < 1500 else f"{note[:1500]}..." for note in getattr(error, "__notes__", [])]
    return "\n".join([f"{type(error).__name__}: {str(error)[:500]}", *calls, *notes])


# --- from outside ----------------------------------------------------------------------------


def fuzz_target(target: Target, cases: int, first: int = 0) -> Report:
    """Read ``cases`` cases of ``target`` in a new process; it is a fault if the process dies."""
    memory = Path("/dev/shm")  # opening a file takes 2 ms on a disk
    with tempfile.TemporaryDirectory(prefix="fuzz_", dir=memory if memory.is_dir() else None) as folder:
        place = Path(folder)
        command = [
            sys.executable,
            "-m",
            "fuzz.harness",
            "--child",
            str(place),
            "--cases",
            str(cases),
            "--first",
            str(first),
            target.name,
        ]
        tests = Path(__file__).parents[1]
        path = os.pathsep.join([str(tests), os.environ.get("PYTHONPATH", "")])
        environment = untraced(PYTHONPATH=path, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=place, env=environment
        )
        try:
            content = json.loads((place / "report.json").read_text())
            return Report(**(content | {"faults": tuple(content["faults"])}))
        except OSError:
            last = place / LAST_CASE
            case = repr(pickle.loads(last.read_bytes()))[:3000] if last.exists() else "none"
            fault = f"the process ended with {done.returncode} at the case {case}\n{done.stderr[-3000:]}"
            return Report(target.name, faults=(fault,))


def main() -> int:
    """Fuzz the targets named on the command line, or all; return 1 if there is a fault, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("targets", nargs="*", metavar="target")
    parser.add_argument("--cases", type=int, default=CASES, help="of each target (times its share)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first block of cases")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    every = (*TARGETS, *KIND_TARGETS)
    chosen = [target for target in every if target.name in (options.targets or [t.name for t in every])]
    if options.child is not None:
        report = fuzz_here(chosen[0], options.cases, options.child, options.first)
        (options.child / "report.json").write_text(json.dumps(asdict(report)))
        return 0
    faults = 0
    for target in chosen:
        report = fuzz_target(target, max(1, round(options.cases * target.share)), options.first)
        print(report.line(), *report.faults, sep="\n", flush=True)
        faults += len(report.faults)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
