"""Records in files: a JSON document of a known schema, or an archive of arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from careful_io.archives import read_npz
from careful_io.reading import inside, shaped
from pareto_ltl.support.schemas import read_document


@contextmanager
def stored(
    place: Path | str, name: str, what: str, schema: str | Mapping[str, str] | None = None
) -> Iterator[Any]:
    """The content of the file ``name`` in ``place``, or of the file ``place``, to be made into ``what``.

    A JSON file is checked against ``schema`` (as :func:`read_document`); without one it is an archive of
    arrays. An error in the block becomes a DataError that names the file.
    """
    path = inside(place, name)
    content = read_npz(path) if schema is None else read_document(path, schema)
    with shaped(path, what):
        yield content
