"""Make the outputs that README.md and the documents show anew, each with the commit that it is of.

A block in a document stands between two comments, the first of which names an output of ``OUTPUTS``::

    <!-- numbers: NAME -->
        ...
    <!-- end of numbers -->

The commands are run in a temporary folder, and the outputs are also written to ``docs/numbers.json``, where a
test looks for the blocks. Run by ``make docs-numbers``, in some minutes.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
NUMBERS = ROOT / "docs" / "numbers.json"
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(
    r"(?P<begin><!-- numbers: (?P<name>[\w ]+) -->\n)(?P<text>.*?)(?P<end><!-- end of numbers -->)", re.DOTALL
)
COLUMNS = 80
VARYING = re.compile(r"^\s*in all .*s\s*$")  # the time of this machine


def summary(text: str) -> list[str]:
    """The answer, the table below it and the sentences on the plan; not what its numbers cover."""
    lines = [line.rstrip() for line in text.splitlines() if not VARYING.match(line)]
    end = next((k for k, line in enumerate(lines) if line.startswith("Covered: ")), len(lines))
    return squeezed(lines[:end])


def table(text: str) -> list[str]:
    """All lines."""
    return squeezed([line.rstrip() for line in text.splitlines()])


def squeezed(lines: list[str]) -> list[str]:
    """``lines`` without empty ones at the ends and without a second one after another."""
    kept = [line for k, line in enumerate(lines) if line or (k and lines[k - 1])]
    while kept and not kept[-1]:
        kept.pop()
    return kept[next((k for k, line in enumerate(kept) if line), 0) :]


@dataclass(frozen=True, slots=True)
class Output:
    """What a command prints: the words after ``pareto-ltl``, and the lines that are shown."""

    words: tuple[str, ...]
    shown: Callable[[str], list[str]]


OUTPUTS = {
    "plan of phi2": Output(("plan", "+experiment=phi2", "hydra.run.dir=outputs/first"), summary),
    "limits of phi2": Output(("explain", "outputs/first", "--limits"), table),
    "shorter plan of phi2": Output(
        ("choose", "outputs/first", "--failure", "0.05", "--out", "outputs/shorter"), summary
    ),
}


def main() -> None:
    """Run the commands, write their outputs and the blocks."""
    outputs: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, output in OUTPUTS.items():
            lines = output.shown(_said(Path(folder), output.words))
            outputs[name] = {"command": " ".join(("pareto-ltl", *output.words)), "lines": lines}
            print(f"{name}: {len(lines)} lines")
    git = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    content = {"commit": git.stdout.strip(), "outputs": outputs}
    NUMBERS.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for document in DOCUMENTS:
        old = document.read_text(encoding="utf-8")
        new = BLOCK.sub(lambda found: found["begin"] + block(outputs, found["name"]) + found["end"], old)
        if new != old:
            document.write_text(new, encoding="utf-8")
            print(f"{document.relative_to(ROOT)} is changed")


def block(outputs: dict[str, Any], name: str) -> str:
    """The lines of an output as a block of code."""
    return "".join(f"    {line}".rstrip() + "\n" for line in outputs[name]["lines"])


def blocks(text: str) -> Iterator[tuple[str, str]]:
    """Name and text of each block of a document."""
    yield from ((found["name"], found["text"]) for found in BLOCK.finditer(text))


def _said(folder: Path, words: tuple[str, ...]) -> str:
    environment = os.environ | {"COLUMNS": str(COLUMNS), "NO_COLOR": "1", "TERM": "dumb"}
    command = [sys.executable, "-m", "pareto_ltl", *words]
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(f"pareto-ltl {' '.join(words)}: {run.stderr.strip()}")
    return run.stdout


if __name__ == "__main__":
    main()
