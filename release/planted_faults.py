"""Is every gate red when something is broken? ``make planted-faults``, or ``ARGS="types language"`` for some.

Each row runs one gate, restricted to what the fault concerns, in a copy of the working tree: first without
the fault, then with it, and wants it to fail then with a text that names the fault. The rows with ``slow``
take more than a minute, and run with ``--all``. Output: a table; exit code 1 if a gate stayed green.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BIN = Path(sys.executable).parent
PYTHON = sys.executable
SKIPS = 'step "nothing skipped without need"'


@dataclass(frozen=True)
class Fault:
    """A fault and the gate that must see it.

    Attributes
    ----------
    gate : str
    what : str
        The fault, for people.
    file, old, new : str
        The first ``old`` in ``file`` becomes ``new``; without ``old`` the file ends with ``new``.
    command : tuple of str
        The gate, in the folder of the copy.
    says : str
        A regular expression that its output must contain.
    """

    gate: str
    what: str
    file: str
    old: str
    new: str
    command: tuple[str, ...]
    says: str
    slow: bool = False


def of_tests(*words: str, uncompiled: bool = False) -> tuple[str, ...]:
    """The command of some tests."""
    settings = ("PARETO_LTL_TESTS=all", *["NUMBA_DISABLE_JIT=1"] * uncompiled)
    return ("env", *settings, PYTHON, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words)


CORE, VERIFY, APPS = "src/pareto_ltl", "src/pareto_ltl_verify", "src/pareto_ltl_apps"
TIMES, FILES, BRANCHING = "src/careful_io/times.py", "src/careful_io/files.py", "docs/branching.md"
REPORTED = "faults[f\"branch {row['name']}: {row['where']}\"] = "
SKIP_SEARCH = (
    "set -e; step() { :; }; work=$PWD; touch tests.log kernels.log night.log; "
    f"eval \"$(sed -n '/^{SKIPS}/,/^fi/p' .ci/run)\""
)
COVERAGE = (
    f"test -f {CORE}/support/planted.py || exit 0; '{BIN}/coverage' run --data-file=measured "
    f"-m pareto_ltl.support.planted && '{BIN}/coverage' combine --quiet --data-file=measured measured.* && "
    f"'{BIN}/coverage' report --data-file=measured --fail-under=92"
)
FAULTS = (
    Fault(
        "lint", "an import that nothing uses", TIMES, "", "\nimport zlib\n", (f"{BIN}/ruff", "check"), "F401"
    ),
    Fault(
        "format", "two spaces too many", TIMES, "", "\n\nPLANTED  =  1\n",
        (f"{BIN}/ruff", "format", "--check"), "would be reformatted",
    ),
    Fault(
        "types", "an integer in the place of a text", TIMES, "",
        "\n\ndef planted(a: int) -> str:\n    return a\n",
        (f"{BIN}/mypy", TIMES), "Incompatible return value",
    ),
    Fault(
        "imports", "the planner imports an application", TIMES, "",
        "\nfrom pareto_ltl_apps.cli import summary as summary\n", (f"{BIN}/lint-imports",), "BROKEN",
    ),
    Fault(
        "waist", "an application takes one more name from inside", f"{APPS}/cli/summary.py", "",
        "\nfrom pareto_ltl.wind.field import task_key as task_key\n",
        (PYTHON, "release/waist.py"), "names|modules",
    ),
    Fault(
        "lines of documents", "a line of 160 characters", BRANCHING, "", "\n" + "word " * 32 + "\n",
        (PYTHON, "release/wrap_docs.py", "--check"), "branching",
    ),
    Fault(
        "language", "a word that says nothing", BRANCHING, "", "\nThe second one was told apart.\n",
        of_tests("tests/test_language.py"), "told apart",
    ),
    Fault(
        "settings", "a default that changed", f"{APPS}/branching/settings.py",
        "rejoin: bool = setting(\n        True", "rejoin: bool = setting(\n        False",
        of_tests("tests/settings/test_declared.py"), "branch.rejoin",
    ),
    Fault(
        "interface", "a name that left", f"{CORE}/extend.pyi",
        "from pareto_ltl.planning.branching.records import Branching as Branching\n", "",
        of_tests("tests/test_interface_kept.py"), "Branching",
    ),
    Fault(
        "links", "a page that is not there", BRANCHING, "(exports.md#", "(export.md#",
        of_tests("tests/test_docs.py", "-k", "links_in_the_repository or every_link"), "export",
    ),
    Fault(
        "locks", "a package without its hash", "requirements.lock", "--hash=sha256:", "--nohash=sha256:",
        of_tests("tests/test_packaging.py", "-k", "locks_pin"), "nohash|assert",
    ),
    Fault(
        "actions", "an action by its tag", ".github/workflows/ci.yml", "actions/checkout@",
        "actions/checkout@v4 #", of_tests("tests/test_packaging.py", "-k", "pinned_by_hash"), "checkout@v4",
    ),
    Fault(
        "attestation", "a release without its provenance", ".github/workflows/release.yml",
        "actions/attest-build-provenance@", "actions/upload-artifact@",
        of_tests("tests/test_packaging.py", "-k", "provenance"), "attest-build-provenance",
    ),
    Fault(
        "skips", "a test that was skipped for want of a program", "tests.log", "",
        "SKIPPED [1] tests/logic/test_mona.py:9: mona is not installed\n",
        ("bash", "-c", SKIP_SEARCH), "mona is not installed",
    ),
    Fault(
        "coverage", "code that no test runs", f"{CORE}/support/planted.py", "", "PLANTED = 1\n",
        ("bash", "-c", COVERAGE), "less than fail-under",
    ),
    Fault(
        "uncompiled kernels", "an index beyond an array", "src/plane_kernels/geometry.py",
        "for j in range(faces.ptr[part], faces.ptr[part + 1]):\n        nx, ny",
        "for j in range(faces.ptr[part], faces.ptr[part + 1] + 1):\n        nx, ny",
        of_tests("tests/kernels/test_geometry.py", "-k", "segment", uncompiled=True), "IndexError|assert",
    ),
    Fault(
        "two roads", "a sign in the law of a cell", f"{APPS}/branching/moments.py",
        "cov - np.outer(slope, slope)", "cov + np.outer(slope, slope)",
        of_tests("tests/branching/test_branch_cells.py"), "FAILED",
    ),
    Fault(
        "fuzz", "a reader that raises what nobody expects", f"{APPS}/flight/telemetry.py",
        "airspeed = _airspeed_column(", "{}[len(names) > 7]\n            airspeed = _airspeed_column(",
        of_tests("tests/fuzz/test_fuzz.py", "-k", "telemetry"), "KeyError",
    ),
    Fault(
        "whole files", "a file that is written in its place", FILES,
        'draft = path.with_name(f".{os.getpid()}.{path.name}")', "draft = path",
        of_tests("tests/careful_io/test_files.py"), "FAILED",
    ),
    Fault(
        "n-th call", "drafts that stay", FILES, "        draft.unlink(missing_ok=True)\n\n\ndef _flush",
        "        pass\n\n\ndef _flush", of_tests("tests/run/test_nth_call.py", "-x"), "a draft is left",
        slow=True,
    ),
    Fault(
        "checker", "a claim that always holds", f"{VERIFY}/claims/branches.py", REPORTED,
        REPORTED + "False and ",
        of_tests("tests/branching/test_branches.py", "-k", "lie_about_branches and words"), "FAILED",
        slow=True,
    ),
)  # fmt: skip


def planted(fault: Fault, copy: Path) -> bool:
    """Plant ``fault`` into ``copy``; whether there was a place for it."""
    file = copy / fault.file
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    if fault.old and fault.old not in text:
        return False
    text = text.replace(fault.old, fault.new, 1) if fault.old else text + fault.new
    file.write_text(text, encoding="utf-8")
    return True


def answer(fault: Fault, copy: Path) -> tuple[int, str]:
    """Exit code and output of the gate."""
    environment = {**os.environ, "PYTHONPATH": f"{copy / 'src'}", "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        fault.command, cwd=copy, env=environment, capture_output=True, text=True, check=False, timeout=900
    )
    return done.returncode, done.stdout + done.stderr


def copied(place: Path) -> Path:
    """The files that git knows, as they are in the working tree."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in filter(None, names.stdout.split("\0")):
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name)
    subprocess.run(["git", "init", "-q"], cwd=place, check=True)
    return place


def main(words: Sequence[str] | None = None) -> int:
    """Plant the faults one after another."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("gates", nargs="*", help="all that are quick")
    parser.add_argument("--all", action="store_true", help="those that take minutes, too")
    asked = parser.parse_args(words)
    chosen = [
        one for one in FAULTS if (one.gate in asked.gates if asked.gates else asked.all or not one.slow)
    ]
    wrong = 0
    print("| gate | planted fault | without it | with it |\n|---|---|---|---|", flush=True)
    for fault in chosen:
        with tempfile.TemporaryDirectory() as folder:
            copy, states, said = copied(Path(folder)), [], ""
            for there in (False, True):
                began = time.monotonic()
                if there and not planted(fault, copy):
                    states.append("no place for it")
                    continue
                code, said = answer(fault, copy)
                red = bool(code) and (not there or re.search(fault.says, said) is not None)
                states.append(f"{'red' if red else 'green'}, {time.monotonic() - began:.0f} s")
                if red != there:
                    print(f"\n{said[-1200:]}\n", file=sys.stderr, flush=True)
        right = states[0].startswith("green") and states[1].startswith("red")
        wrong += not right
        note = "" if right else " WRONG"
        print(f"| {fault.gate} | {fault.what} | {' | '.join(states)} |{note}", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
