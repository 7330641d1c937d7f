"""What readers of a results directory share: where a file lies, and the error for one of another shape."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pareto_ltl.support.errors import DataError

MISSHAPEN = (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, csv.Error)


@contextmanager
def shaped(path: Path, what: str) -> Iterator[None]:
    """What goes wrong while the content of ``path`` becomes ``what`` is a DataError that names both."""
    try:
        yield
    except MISSHAPEN as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(f"{path}: not {what} ({reason}); run the plan again") from error


def inside(place: Path | str, name: str) -> Path:
    """``place`` itself when it is a file, else the file ``name`` in it."""
    place = Path(place)
    return place / name if place.is_dir() else place


__all__ = ["inside", "shaped"]
