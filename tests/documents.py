"""Commands and code blocks of the documents, in the form that a reader would copy."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCUMENTS = (
    *sorted(ROOT.glob("*.md")),
    *(path for folder in ("docs", "examples") for path in sorted((ROOT / folder).rglob("*.md"))),
)
PROGRAM = re.compile(r"(?:pareto-ltl|python -m pareto_ltl)(?= )(?P<rest>.*)")
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<language>\w*)\n(?P<code>.*?)^(?P=indent)```$", re.MULTILINE | re.DOTALL
)
INDENTED = re.compile(r"(?:^|(?<=\n\n))(?: {4}[^\n]*(?:\n|$)|\n(?= {4}))+")


@dataclass(frozen=True)
class Block:
    """A block of code: the language of its fence, ``""`` without one, and its lines."""

    language: str
    code: str


def code_blocks(document: Path) -> list[Block]:
    """The fenced and the indented blocks of a document, without those in list items and comments."""
    text = document.read_text(encoding="utf-8")
    fenced = [Block(found["language"], found["code"]) for found in FENCE.finditer(text)]
    rest = FENCE.sub("", text)
    return fenced + [
        Block("", re.sub(r"^ {4}", "", found[0], flags=re.MULTILINE)) for found in INDENTED.finditer(rest)
    ]


def shell_commands(document: Path) -> list[list[str]]:
    """The words after ``pareto-ltl`` of every command in a document, in order, without comments."""
    blocks = [
        block.code.replace("\\\n", " ") for block in code_blocks(document) if block.language in ("", "sh")
    ]
    lines = [line for code in blocks for line in code.splitlines()]
    return [shlex.split(found["rest"], comments=True) for line in lines if (found := PROGRAM.match(line))]


def python_blocks(document: Path) -> list[str]:
    """The blocks of Python of a document."""
    return [block.code for block in code_blocks(document) if block.language == "python"]
