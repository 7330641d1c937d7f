"""Fingerprints: SHA-256 of data, of files and of the source of the package, as 64 hexadecimal digits.

A result is made again when a fingerprint of what it depends on has changed.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from careful_io.reading import refuse_special

SOURCES = Path(__file__).resolve().parents[1]  # of the installed packages
PACKAGES = (  # of one distribution
    "careful_io", "flight_quantities", "ltlf", "pareto_ltl*", "plane_kernels", "plane_logic",
    "typed_kernels", "wind_laws", "declared_settings",
)  # fmt: skip
FRESH = 2.0  # [s] a file that was changed less than this ago may change again without a new date


def data_fingerprint(content: Any) -> str:
    """Fingerprint of ``content``, a value that JSON can hold; the order of keys is ignored."""
    return text_fingerprint(json.dumps(content, sort_keys=True))


def text_fingerprint(text: str) -> str:
    """Fingerprint of ``text`` in UTF-8."""
    return hashlib.sha256(text.encode()).hexdigest()


def file_fingerprint(path: Path) -> str:
    """Fingerprint of the bytes of ``path``; OSError if it cannot be read, DataError if it is not a file.

    A file is read once per process, and again when its date or size changes. A file that was written less
    than :data:`FRESH` seconds ago is read every time, as it can change again without a new date.
    """
    refuse_special(path)
    stat = os.stat(path)
    if abs(time.time() - stat.st_mtime) < FRESH:
        return _file_fingerprint.__wrapped__(str(path), stat.st_mtime_ns, stat.st_size)
    return _file_fingerprint(str(path), stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=4096)
def _file_fingerprint(path: str, _changed: int, _size: int) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@lru_cache
def code_fingerprint(*names: str, without: tuple[str, ...] = ()) -> str:
    """Fingerprint of the source of the installed packages, or of the modules called ``names``.

    Parameters
    ----------
    names : str
        Names such as ``"ltlf"`` (a package with all its modules) or ``"ltlf.dfa"``.
    without : tuple of str
        Modules and packages to leave out, named in the same way.

    Raises
    ------
    ValueError
        If there is no module or package of such a name.
    """
    left_out = {source for name in without for source in _source_files(name)}
    found = (place for pattern in PACKAGES for place in SOURCES.glob(f"{pattern}/__init__.py"))
    wanted = names or sorted(place.parent.name for place in found)
    sources = {source for name in wanted for source in _source_files(name)} - left_out
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(f"{source.relative_to(SOURCES).as_posix()}\0".encode() + source.read_bytes() + b"\0")
    return digest.hexdigest()


def _source_files(name: str) -> list[Path]:
    """The source files of a module, or of a package with its subpackages."""
    place = SOURCES.joinpath(*name.split("."))
    module = place.with_name(f"{place.name}.py")
    sources = list(place.rglob("*.py")) if place.is_dir() else [module] if module.is_file() else []
    if not sources:
        raise ValueError(f"there is no module or package {name!r}")
    return sources


def file_hashes(paths: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of each file, by its name as given."""
    return {str(path): file_fingerprint(path) for path in paths}


def unchanged(inputs: Mapping[str, str]) -> bool:
    """Whether the files that a run read have not changed since."""
    try:
        return all(file_fingerprint(Path(name)) == digest for name, digest in inputs.items())
    except OSError:
        return False
