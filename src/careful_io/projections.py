"""Texts that name a projection to PROJ: a map may not make it read a file."""

from __future__ import annotations

import re

from careful_io.errors import DataError
from careful_io.messages import shown_value

# Parameters of PROJ, and of WKT and PROJJSON, whose value is the name of a file; @null names none.
FILES = re.compile(
    r"(grids|geoidgrids|init|file|model|catalog)\s*=\s*(?!@null\b)|PARAMETERFILE|parameter_file|^\s*@",
    re.IGNORECASE,
)


def refuse_files(crs: str) -> None:
    """DataError if PROJ would read a file, which may lie anywhere, to understand ``crs``."""
    if FILES.search(crs):
        raise DataError(
            f"crs {shown_value(crs)} names a file, which is not read; write the map in longitude and latitude"
        )
