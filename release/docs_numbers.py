"""Make the outputs and tables that README.md and the documents show anew, with the commit that they are of.

A block in a document stands between two comments, the first of which names an output of ``OUTPUTS``::

    <!-- numbers: NAME -->
        ...
    <!-- end of numbers -->

The commands are run in a temporary folder, and the outputs are also written to ``docs/numbers.json``, where a
test looks for the blocks. Run by ``make docs-numbers``, in four CPU minutes;
``docs_numbers.py NAME ...`` makes some of them alone.
"""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from careful_io.texts import probability_text

ROOT = Path(__file__).resolve().parents[1]
NUMBERS = ROOT / "docs" / "numbers.json"
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(
    r"(?P<begin><!-- numbers: (?P<name>[\w ]+) -->\n)(?P<text>.*?)(?P<end><!-- end of numbers -->)", re.DOTALL
)
COLUMNS = 80
DIRECTORY = "hydra.run.dir="
STUDY = ("evaluation.seeds=[0,1,2]", "evaluation.jobs=1", "report=none")
VARYING = re.compile(r"^\s*in all .*s\s*$")  # the time of this machine


def summary(text: str, _: Path) -> list[str]:
    """The answer, the table below it and the sentences on the plan; not what its numbers cover."""
    lines = [line.rstrip() for line in text.splitlines() if not VARYING.match(line)]
    end = next((k for k, line in enumerate(lines) if line.startswith("Covered: ")), len(lines))
    return squeezed(lines[:end])


def printed(text: str, _: Path) -> list[str]:
    """All lines."""
    return squeezed([line.rstrip() for line in text.splitlines()])


def table(text: str, _: Path) -> list[str]:
    """The lines of a table, without those that explain it."""
    lines = printed(text, _)
    return lines[: next((k for k, line in enumerate(lines) if k and not line), len(lines))]


def front_table(text: str, _: Path) -> list[str]:
    """The head of the table of a front, the plan, and every fourth point."""
    lines = table(text, _)
    first = next(k for k, line in enumerate(lines) if set(line.strip()) == {"─"}) + 1
    rows = lines[first:]
    return lines[:first] + [row for k, row in enumerate(rows) if k % 4 == 0 or "plan" in row]


def comparison(_: str, folder: Path) -> list[str]:
    """Of ``compare.csv``: length, bound and failures of each planner, in the winds of each law."""
    shown = [
        (row["title"], row["law"], _kilometres(row["length_m"]), _percent(row["forecast"]), _interval(row))
        for row in _rows(folder / "compare.csv")
    ]
    return in_columns(("planner", "winds", "km", "V + R", "failed (95 %)"), shown)


def growth(_: str, folder: Path) -> list[str]:
    """Of ``convergence.csv``: plans, bound, failures and hypervolume for each size of the trees."""
    shown = [
        (
            f"{int(row['size']):,}", row["law"], f"{float(row['planned']):.0%}".replace("%", " %"),
            _percent(row["mission_bound"]), _percent(row["failure_of_a_plan"]),
            _kilometres(row["length_m"]), f"{float(row['hypervolume'] or 'nan'):.3f}",
        )
        for row in _rows(folder / "convergence.csv")
    ]  # fmt: skip
    return in_columns(("vertices", "winds", "with a plan", "f_o", "failed", "km", "hypervolume"), shown)


def in_columns(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    """A table as lines of text, numbers at the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    texts = 2  # columns of words
    return [
        "  ".join(
            cell.ljust(width) if k < texts else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in (head, *rows)
    ]


def _rows(path: Path) -> list[Mapping[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _kilometres(metres: str) -> str:
    return "-" if metres in ("", "nan") else f"{float(metres) / 1000:,.0f}"


def _percent(share: str) -> str:
    return "-" if share in ("", "nan") else probability_text(float(share))


def _interval(row: Mapping[str, str]) -> str:
    low, high = (probability_text(float(row[f"failure_{end}"])).removesuffix(" %") for end in ("low", "high"))
    return f"{_percent(row['failure'])} ({low} to {high})"


def squeezed(lines: list[str]) -> list[str]:
    """``lines`` without empty ones at the ends and without a second one after another."""
    kept = [line for k, line in enumerate(lines) if line or (k and lines[k - 1])]
    while kept and not kept[-1]:
        kept.pop()
    return kept[next((k for k, line in enumerate(kept) if line), 0) :]


@dataclass(frozen=True, slots=True)
class Output:
    """What a command prints or writes: the words after ``pareto-ltl``, and the lines that are shown.

    ``shown`` gets what was printed, and the results directory.
    """

    words: tuple[str, ...]
    shown: Callable[[str, Path], list[str]]


OUTPUTS = {
    "plan of phi2": Output(("plan", "+experiment=phi2", "hydra.run.dir=outputs/first"), summary),
    "limits of phi2": Output(("explain", "outputs/first", "--limits"), printed),
    "shorter plan of phi2": Output(
        ("choose", "outputs/first", "--failure", "0.05", "--out", "outputs/shorter"), summary
    ),
    "front of phi2": Output(("front", "outputs/first"), front_table),
    "comparison on phi1": Output(
        ("pipelines=compare", "+experiment=phi1", *STUDY, "hydra.run.dir=outputs/compare_phi1"), comparison
    ),
    "comparison on phi2": Output(
        ("pipelines=compare", "+experiment=phi2", *STUDY, "hydra.run.dir=outputs/compare_phi2"), comparison
    ),
    "growth of the trees": Output(
        (
            "pipelines=convergence", "+experiment=phi1", "fidelity=paper", *STUDY,
            "hydra.run.dir=outputs/convergence",
        ),
        growth,
    ),
}  # fmt: skip
NEEDS_FIRST = ("limits of phi2", "shorter plan of phi2", "front of phi2")  # the result of "plan of phi2"


def main(names: list[str]) -> None:
    """Run the commands, write their outputs and the blocks."""
    if unknown := set(names) - set(OUTPUTS):
        raise SystemExit(
            f"docs_numbers.py: unknown {', '.join(sorted(unknown))}; there are {', '.join(OUTPUTS)}"
        )
    outputs: dict[str, Any] = json.loads(NUMBERS.read_text(encoding="utf-8"))["outputs"] if names else {}
    wanted = [name for name in OUTPUTS if not names or name in names]
    if set(wanted) & set(NEEDS_FIRST) and "plan of phi2" not in wanted:
        wanted.insert(0, "plan of phi2")
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted:
            output = OUTPUTS[name]
            run = next((word.partition("=")[2] for word in output.words if word.startswith(DIRECTORY)), "")
            lines = output.shown(_said(Path(folder), output.words), Path(folder) / run)
            outputs[name] = {"command": " ".join(("pareto-ltl", *output.words)), "lines": lines}
            print(f"{name}: {len(lines)} lines")
    git = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    content = {"commit": git.stdout.strip(), "outputs": {name: outputs[name] for name in OUTPUTS}}
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
    main(sys.argv[1:])
