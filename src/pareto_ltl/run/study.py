"""The record of a study: tables, numbers and a text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from careful_io.files import write_bytes, write_csv


@dataclass(frozen=True, slots=True)
class Study:
    """The result of a study.

    Attributes
    ----------
    tables : mapping of name to rows
        Each row maps column to value; a table becomes ``name.csv``.
    numbers : mapping of name to float
        The metrics of the study, for ``metrics.json``.
    text : str
        The main tables as Markdown, for documents and the screen.
    pictures : mapping of name to object
        Further data for figures (paths, flights); not written to disk.
    """

    tables: Mapping[str, Sequence[Mapping[str, Any]]]
    numbers: Mapping[str, float]
    text: str
    pictures: Mapping[str, Any] = field(default_factory=dict)


def write_study(directory: Path, study: Study) -> None:
    """Write every table as CSV, columns in the order of the first row, and the main ones as ``tables.md``."""
    for name, rows in study.tables.items():
        if rows:
            header = tuple(rows[0])
            write_csv(directory / f"{name}.csv", header, ([row[key] for key in header] for row in rows))
    write_bytes(directory / "tables.md", study.text.encode())
