"""Markdown of a study as ``rich`` shows it in a terminal: tables whose columns fit, no raw marks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

WIDTH = 78  # columns of a terminal that tables fit into, without the edges of a table
GAP = 2  # columns between two columns of a table


def shown_markdown(text: str, source: str) -> Iterator[object]:
    """The parts of ``text``; a table that is too wide has its first columns, and a line names ``source``."""
    from rich.markdown import Markdown

    for is_table, block in groupby(text.splitlines(), key=lambda line: line.startswith("|")):
        if not is_table:
            yield Markdown("\n".join(block))
            continue
        header, _, *rows = ([cell.strip() for cell in line.strip("|").split(" | ")] for line in block)
        fitting = fitting_columns([header, *rows])
        yield _table(header[:fitting], rows)
        if left := len(header) - fitting:
            yield f"{left} more column{'s' * (left > 1)} in {source}: {', '.join(header[fitting:])}"


def fitting_columns(rows: Sequence[Sequence[str]], width: int = WIDTH) -> int:
    """The number of first columns that fit into ``width``, at least one."""
    used = 0
    for k in range(len(rows[0])):
        used += max(len(row[k]) for row in rows) + GAP
        if used > width and k:
            return k
    return len(rows[0])


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, GAP, 0, 0))
    for name in header:
        table.add_column(name)
    for row in rows:
        table.add_row(*row[: len(header)])
    return table
