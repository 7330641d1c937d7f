"""Wrap the prose of the documentation at 100 columns, ``wrap_docs.py [--check] [FILE ...]``.

Paragraphs and list items are wrapped; tables, code, formulas, HTML and headings stay as they are. Code,
formulas and links in a line are not divided. ``--check`` only names the files that would change.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 100  # columns
WHOLE = re.compile(r"`[^`]*`|\$[^$]*\$|!?\[[^\]]*\]\([^)]*\)|<[^>]*>|[^\s`$\[<]+|[`$\[<]")  # parts of a word
ITEM = re.compile(r"(\s*)([-*+]|\d+\.)\s+")
OTHER = re.compile(r"\s*(\||#|<|:::|!!!|\?\?\?|>|\[[^\]]*\]:|\$\$|---|===|\{|    \S)")  # stays as it is
BLOCK = re.compile(r"<|[-+*>|#=]+$|\d+[.)]$|#|:::|!!!")  # would begin something else at the start of a line


def pages() -> list[Path]:
    """The pages that people write; ``benchmarks/gallery.py`` writes the gallery."""
    top = (ROOT / name for name in ("README.md", "CONTRIBUTING.md", "RELEASING.md"))
    return [*top, *(page for page in sorted((ROOT / "docs").rglob("*.md")) if page.name != "gallery.md")]


def words_of(text: str) -> list[str]:
    """The parts of ``text`` between which a line may end."""
    words, end = [""], 0
    for part in WHOLE.finditer(text):
        if part.start() > end or not words[-1]:
            words.append(part[0])
        else:
            words[-1] += part[0]
        end = part.end()
    return [word for word in words if word]


def wrapped(text: str, first: str, rest: str) -> list[str]:
    """``text`` in lines that begin with ``first``, then with ``rest``."""
    lines, line = [], first
    for word in words_of(text):
        begun = line.strip() not in ("", first.strip())
        if begun and len(line) + 1 + len(word) > WIDTH and not BLOCK.match(word):
            lines.append(line)
            line = rest + word
        else:
            line += (" " if begun else "") + word
    return [*lines, line]


def wrapped_page(text: str) -> str:
    """The page ``text`` with its prose wrapped."""
    return "\n".join(_lines(text.split("\n")))


def _lines(lines: list[str]) -> Iterator[str]:
    at, fence = 0, ""
    while at < len(lines):
        line = lines[at]
        mark = re.match(r"\s*(```+|~~~+|\$\$)", line)
        if fence or mark or (at == 0 and line == "---"):
            yield line
            at += 1
            if fence:
                fence = "" if line.strip().startswith(fence) or line.rstrip().endswith(fence) else fence
            else:
                sign = mark[1] if mark else "---"
                closed = sign == "$$" and line.strip() != "$$" and line.rstrip().endswith("$$")
                fence = "" if closed else sign
            continue
        item = ITEM.match(line)
        if not line.strip() or (OTHER.match(line) and not item):
            yield line
            at += 1
            continue
        first = item[0] if item else re.match(r"\s*", line)[0]  # type: ignore[index]
        rest = " " * len(first)
        parts = [line[len(first) :]]
        at += 1
        while at < len(lines) and _goes_on(lines[at], lines[at - 1]):
            parts.append(lines[at].strip())
            at += 1
        yield from wrapped(" ".join(part.rstrip() for part in parts), first, rest)
        if parts[-1].endswith("  "):
            raise ValueError(f"a line with a break at its end: {parts[-1]!r}")


def _goes_on(line: str, before: str) -> bool:
    """Whether ``line`` belongs to the paragraph or item of the line ``before`` it."""
    if before.endswith("  ") or not line.strip() or ITEM.match(line):
        return False
    if re.match(r"\s*(```|~~~)", line):
        return False
    return not OTHER.match(line.strip() if line.startswith("    ") else line)


def main(words: list[str]) -> int:
    """Wrap, or name what would change; the exit code is 1 if there is something to name."""
    files = [Path(word) for word in words if word != "--check"] or pages()
    changed = [path for path in files if wrapped_page(text := path.read_text(encoding="utf-8")) != text]
    for path in changed:
        if "--check" in words:
            print(f"{path}: prose is not wrapped at {WIDTH} columns: python release/wrap_docs.py")
        else:
            path.write_text(wrapped_page(path.read_text(encoding="utf-8")), encoding="utf-8")
    return int("--check" in words and bool(changed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
