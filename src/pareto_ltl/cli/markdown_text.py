"""Markdown of a study as ``rich`` shows it in a terminal: tables whose columns fit, no raw marks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

WIDTH = 78  # columns of a terminal that tables fit into, without the edges of a table
GAP = 2  # columns between two columns of a table
FAILED = "failed"  # the column that a table has before others


def shown_markdown(text: str, source: str) -> Iterator[object]:
    """The parts of ``text``; of a table that is too wide, the columns that fit, and a line on the others."""
    from rich.markdown import Markdown

    for is_table, block in groupby(text.splitlines(), key=lambda line: line.startswith("|")):
        if not is_table:
            yield Markdown("\n".join(block))
            continue
        header, _, *rows = ([cell.strip() for cell in line.strip("|").split(" | ")] for line in block)
        fitting = fitting_columns([header, *rows])
        yield _table([[row[k] for k in fitting] for row in (header, *rows)])
        if left := [name for k, name in enumerate(header) if k not in fitting]:
            yield f"{len(left)} more column{'s' * (len(left) > 1)} in {source}: {', '.join(left)}"


def fitting_columns(rows: Sequence[Sequence[str]], width: int = WIDTH) -> list[int]:
    """The columns that fit into ``width``: the first one, failures, then the others from the left."""
    used, fitting = 0, list[int]()
    for k in sorted(range(len(rows[0])), key=lambda k: (k > 0, rows[0][k] != FAILED)):
        used += max(len(row[k]) for row in rows) + GAP
        if used > width and fitting:
            break
        fitting.append(k)
    return sorted(fitting)


def _table(rows: Sequence[Sequence[str]]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, GAP, 0, 0))
    for name in rows[0]:
        table.add_column(name)
    for row in rows[1:]:
        table.add_row(*row)
    return table
