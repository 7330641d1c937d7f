"""MONA's side: a formula to its minimal automaton through ltlf2dfa; runs in ltlf2dfa's environment."""

from __future__ import annotations

import re
import resource
import subprocess
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from channel import serve
from ltlf2dfa.base import MonaProgram
from ltlf2dfa.parser.ltlf import LTLfParser


def children() -> float:
    """CPU time of the programs that were called so far [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def translation(text: str) -> dict[str, Any]:
    """States, and CPU time of ltlf2dfa with MONA (``through``) and of MONA alone on its file (``alone``).

    ltlf2dfa is stopped at MONA's output: its own text of the automaton, made with sympy, takes far longer.
    """
    began, before = time.process_time(), children()
    formula = LTLfParser()(text)
    told = formula.to_dfa(mona_dfa_out=True)
    through = time.process_time() - began + children() - before
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "formula.mona"
        file.write_text(MonaProgram(formula).mona_program())
        before = children()
        subprocess.run(["mona", "-q", "-u", "-w", file], stdout=subprocess.DEVNULL, check=True)
        alone = children() - before
    found = re.search(r"Automaton has (\d+) state", told)
    if found is None:
        raise RuntimeError(f"MONA said {told[:200]!r}")
    return {"states": int(found[1]), "through": through, "alone": alone}


def main() -> None:
    def handle(request: dict[str, Any]) -> dict[str, Any]:
        if request["op"] == "version":
            told = subprocess.run(["mona", "-v"], capture_output=True, text=True, check=False)
            program = re.search(r"v([0-9.-]+)", told.stdout + told.stderr)
            return {"ltlf2dfa": version("ltlf2dfa"), "mona": program[1] if program else "?"}
        return translation(request["formula"])

    serve(handle)


if __name__ == "__main__":
    main()
