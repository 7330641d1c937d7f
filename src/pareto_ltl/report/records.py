"""What a study hands on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Study:
    """What an evaluation found.

    Attributes
    ----------
    tables : mapping of name to rows
        Each row maps column to value; a table becomes ``name.csv``.
    numbers : mapping of name to float
        Its share of ``metrics.json``.
    text : str
        The main tables as Markdown, for documents and the screen.
    pictures : mapping of name to object
        What figures draw beyond the tables (paths, flights); not written to disk.
    """

    tables: Mapping[str, tuple[Mapping[str, Any], ...]]
    numbers: Mapping[str, float]
    text: str
    pictures: Mapping[str, Any] = field(default_factory=dict)
