"""Helpers for readers of a results directory: the place of a file, and the error for a wrong content."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pareto_ltl.support.errors import DataError

MISSHAPEN = (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, csv.Error)


@contextmanager
def shaped(path: Path, what: str) -> Iterator[None]:
    """Turn an error while the content of ``path`` is made into ``what`` into a DataError that names both."""
    try:
        yield
    except MISSHAPEN as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(f"{path}: not {what} ({reason}); run the plan again") from error


def inside(place: Path | str, name: str) -> Path:
    """The file ``name`` in ``place``, or ``place`` itself if it is a file."""
    place = Path(place)
    return place / name if place.is_dir() else place
