"""Fuzzing that is led by the lines that a case reaches, by atheris (libFuzzer), where that is installed.

    make guided SECONDS=60 SEED=7
    cd tests && python -m fuzz.guided [--seconds N] [--seed S] [target ...]

Each target runs in a process of its own, whose readers are instrumented. libFuzzer makes the bytes from which
Hypothesis builds a case, so that cases are spoilt in the ways of ``mutations.py``. It begins with the kept
cases of ``kept/TARGET.json``, which every run of the tests reads again (``test_guided.py``); ``--keep`` adds
those that reached new lines. A failure is repeated with the same seed, and its case is printed.
"""

from __future__ import annotations

import argparse
import base64
import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

KEPT = Path(__file__).parent / "kept"
MAX_KEPT = 60  # cases of a target
LONGEST = 4000  # [characters] of a kept case
SECONDS_OF_CASE = 20  # a case that takes longer is a fault
MIB = 3000  # of the process; more is a fault
LONGEST_INPUT = 2000  # [bytes] from which a case is built
COMPILED = "pareto_ltl.kernels"  # numba compiles no instrumented code
TARGETS = (  # readers in Python alone
    "formulas", "automata", "geojson", "kml", "scenes", "settings_files", "csv_winds", "position_fixes",
    "inventories", "forecast_errors", "telemetry", "journals", "backdrops", "requests", "geotiffs", "pmtiles",
    "autopilot_logs", "results",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Led:
    """What libFuzzer did with a target: cases read, places in the code that they reached, and a fault."""

    target: str
    cases: int
    reached: int
    fault: str

    def line(self) -> str:
        told = "1 fault" if self.fault else "no fault"
        return f"{self.target:<20}{self.cases:>9} cases {self.reached:>7} places   {told}"


def available() -> bool:
    """Whether atheris is installed."""
    return importlib.util.find_spec("atheris") is not None


# --- kept cases ------------------------------------------------------------------------------


def packed(case: Any) -> Any:
    """A case as JSON: bytes in base64, tuples and lists of cases as lists."""
    if isinstance(case, bytes):
        return {"base64": base64.b64encode(case).decode()}
    if isinstance(case, tuple | list):
        return [packed(one) for one in case]
    return {"text": case.encode("utf-16", "surrogatepass").hex()} if _is_odd(case) else case


def _is_odd(case: Any) -> bool:
    return isinstance(case, str) and re.search("[\ud800-\udfff]", case) is not None


def unpacked(content: Any) -> Any:
    """The case of which :func:`packed` has made ``content``; a list is a tuple."""
    if isinstance(content, list):
        return tuple(unpacked(one) for one in content)
    if isinstance(content, dict):
        if "text" in content:
            return bytes.fromhex(content["text"]).decode("utf-16", "surrogatepass")
        return base64.b64decode(content["base64"])
    return content


def kept(target: str) -> list[Any]:
    """The kept cases of a target, oldest first."""
    file = KEPT / f"{target}.json"
    return [unpacked(one) for one in json.loads(file.read_text())] if file.exists() else []


def keep(target: str, cases: Sequence[Any]) -> None:
    """Add short cases to the kept ones, the shortest first, up to :data:`MAX_KEPT`."""
    file = KEPT / f"{target}.json"
    texts = json.loads(file.read_text()) if file.exists() else []
    new = sorted((packed(case) for case in cases), key=lambda one: len(json.dumps(one)))
    texts += [one for one in new if one not in texts and len(json.dumps(one)) <= LONGEST]
    KEPT.mkdir(exist_ok=True)
    lines = ",\n".join(json.dumps(one) for one in texts[:MAX_KEPT])
    file.write_text(f"[\n{lines}\n]\n")


# --- in the process of a target --------------------------------------------------------------


def lead(name: str, place: Path, seed: int, seconds: int) -> None:
    """Let libFuzzer search; it ends the process."""
    import atheris

    with atheris.instrument_imports(include=["pareto_ltl", "pareto_ltl_apps"], exclude=[COMPILED]):
        from hypothesis import given

        from fuzz.harness import house, warmed
        from fuzz.targets import TARGETS as EVERY

        target = next(one for one in EVERY if one.name == name)
        prepared = target.prepare(place)
        if prepared is None:
            sys.exit(f"{name} cannot run here")
        prepared = warmed(prepared, target)
    from fuzz.harness import check_line

    shown = place / "case.txt"

    def tried(case: Any) -> None:
        try:
            prepared.read(case)
        except target.allowed as error:
            check_line(str(error))
        except BaseException:
            shown.write_text(repr(case)[:3000], errors="replace")
            raise

    @house(1)
    @given(prepared.cases)
    def read(case: Any) -> None:
        tried(case)

    if (again := os.environ.get("FUZZ_CASES_OF")) is not None:  # what the inputs in a folder are
        _write_cases(prepared.cases, Path(again), place)
        return
    for case in kept(name):
        tried(case)
    corpus = place / "corpus"
    corpus.mkdir()
    words = [
        sys.argv[0], f"-seed={seed % 2**31 or 1}", f"-max_total_time={seconds}",
        f"-timeout={SECONDS_OF_CASE}", f"-rss_limit_mb={MIB}", f"-max_len={LONGEST_INPUT}",
        "-len_control=10", f"-artifact_prefix={place}/", str(corpus),
    ]  # fmt: skip
    atheris.Setup(words, read.hypothesis.fuzz_one_input)
    atheris.Fuzz()


def _write_cases(cases: Any, corpus: Path, place: Path) -> None:
    """The cases that the inputs in ``corpus`` make, packed, in ``cases.json``."""
    from hypothesis import given

    from fuzz.harness import house

    found: list[Any] = []

    @house(1)
    @given(cases)
    def note(case: Any) -> None:
        found.append(packed(case))

    for file in sorted(corpus.iterdir(), key=lambda path: path.stat().st_size):
        note.hypothesis.fuzz_one_input(file.read_bytes())
    (place / "cases.json").write_text(json.dumps(found))


# --- from outside ----------------------------------------------------------------------------


def led(name: str, seed: int, seconds: int, keeping: bool = False) -> Led:
    """Search in a new process; ``keeping`` adds the cases that reached new places to the kept ones."""
    with tempfile.TemporaryDirectory(prefix="guided_") as folder:
        place = Path(folder) / "place"
        place.mkdir()
        done = _child(name, place, seed, seconds)
        counts = re.findall(r"^#(\d+)\s.*?cov: (\d+)", done.stderr, re.MULTILINE)
        cases, reached = map(int, counts[-1]) if counts else (0, 0)
        fault = ""
        if done.returncode or not counts:
            case = place / "case.txt"
            fault = f"{done.stderr[-3000:]}\ncase: {case.read_text() if case.exists() else 'unknown'}"
        elif keeping:
            other = Path(folder) / "other"
            other.mkdir()
            _child(name, other, seed, seconds, FUZZ_CASES_OF=str(place / "corpus"))
            keep(name, [unpacked(one) for one in json.loads((other / "cases.json").read_text())])
    return Led(name, cases, reached, fault)


def _child(name: str, place: Path, seed: int, seconds: int, **more: str) -> subprocess.CompletedProcess[str]:
    tests = Path(__file__).parents[1]
    path = os.pathsep.join([str(tests), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | more | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    words = [sys.executable, "-m", "fuzz.guided", "--child", str(place), "--seed", str(seed)]
    return subprocess.run(
        [*words, "--seconds", str(seconds), name], capture_output=True, text=True, errors="replace",
        check=False, cwd=place, env=environment,
    )  # fmt: skip


def searches(names: Sequence[str], seed: int, seconds: int, keeping: bool) -> Iterator[Led]:
    """The searches of several targets, one after another."""
    for name in names:
        yield led(name, seed, seconds, keeping)


def main() -> int:
    """Search in the targets named on the command line, or all; 1 if there is a fault, 2 without atheris."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("targets", nargs="*", metavar="target", help=f"of {', '.join(TARGETS)}")
    parser.add_argument("--seconds", type=int, default=60, help="of each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="add cases that reached new places to kept/")
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if unknown := set(asked.targets) - set(TARGETS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; expected some of {', '.join(TARGETS)}")
    if not available():
        print("atheris is not installed: pip install -r tests/fuzz/requirements.txt", file=sys.stderr)
        return 2
    if asked.child is not None:
        lead(asked.targets[0], asked.child, asked.seed, asked.seconds)
        return 0
    print(f"seed {asked.seed}", flush=True)
    faults = 0
    for one in searches(asked.targets or TARGETS, asked.seed, asked.seconds, asked.keep):
        print(one.line(), one.fault, sep="\n" if one.fault else "", flush=True)
        faults += bool(one.fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
