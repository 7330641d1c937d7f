"""The cache of machine code on disk: where numba stores it, and when it is compiled again.

Numba by itself compares only the file of a compiled function, and would continue to use outdated helpers.
Here the stamp of a function is a fingerprint of its module, of every kernel module that this one imports,
and of the files of other packages that add code to a function of these (:data:`FOREIGN`): after a change,
only what depends on it is compiled again. Numba gets the stamp from a cache locator, a class that its setting
``NUMBA_CACHE_LOCATOR_CLASSES`` names.

An index file of numba refers to the types of its functions, and cannot be read after one of them is removed
from the source. So the fingerprint is part of the file name, and files with another one are removed unread.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

from numba import config
from numba.core.caching import InTreeCacheLocator, UserProvidedCacheLocator, UserWideCacheLocator

from pareto_ltl.support.fingerprints import file_fingerprint, text_fingerprint

# Source files outside kernels/ with code for a function whose implementation is chosen by type, by the file
# of that function. Kernels that cannot reach the function keep their stamp: two processes, of which one
# imports the other package, would else overwrite each other's code again and again.
FOREIGN: dict[Path, set[Path]] = {}
KERNELS = Path(__file__).parent
IMPORT = re.compile(
    r"^[ \t]*from[ ]+pareto_ltl\.kernels(?:\.(\w+))?[ ]+import[ ]+(\((?:[^()#]|#.*)*\)|[^\n]*)", re.MULTILINE
)


class CodeStamp:
    """Fingerprint of the source that a kernel file depends on, computed when it is compared or saved.

    At that time other packages have added their code. On disk it is a plain string.
    """

    def __init__(self, file: Path) -> None:
        self.file = file

    def __str__(self) -> str:
        reached = reachable_sources(self.file)
        added = (FOREIGN.get(source, set()) for source in reached)
        sources = sorted(reached.union(*added))
        return text_fingerprint("".join(file_fingerprint(source) for source in sources))

    def __eq__(self, other: object) -> bool:
        return str(self) == str(other)

    def __hash__(self) -> int:
        return hash(str(self))

    def __reduce__(self) -> tuple[type[str], tuple[str]]:
        return str, (str(self),)


class ReachableSource:
    """Common part of the three locators below: the stamp, and file names that contain a fingerprint."""

    def __init__(self, function: Any, file: str) -> None:
        super().__init__(function, file)  # type: ignore[call-arg]  # the locator that follows in the class
        self.stamp = CodeStamp(Path(file))
        self.files = f"{Path(file).stem}.{function.__qualname__}-*.nb[ci]"
        self.mark = _mark(Path(file))

    def get_source_stamp(self) -> CodeStamp:
        """The stamp that numba compares with the one on disk."""
        return self.stamp

    def get_disambiguator(self) -> str:
        """The part of file names that tells equal function names apart, with the fingerprint."""
        line: str = super().get_disambiguator()  # type: ignore[misc]
        return f"{line}-{self.mark}"

    def ensure_cache_path(self) -> None:
        """Make the folder, and remove machine code of this function with another fingerprint."""
        super().ensure_cache_path()  # type: ignore[misc]
        for found in Path(self.get_cache_path()).glob(self.files):  # type: ignore[attr-defined]
            if f"-{self.mark}." not in found.name:
                found.unlink(missing_ok=True)


class NamedFolder(ReachableSource, UserProvidedCacheLocator):  # type: ignore[misc]  # numba has no types
    """The folder that ``NUMBA_CACHE_DIR`` names."""


class BesideSource(ReachableSource, InTreeCacheLocator):  # type: ignore[misc]
    """``__pycache__`` beside the source, where it can be written."""


class UserFolder(ReachableSource, UserWideCacheLocator):  # type: ignore[misc]
    """The user's cache."""


LOCATORS = ",".join(f"{__name__}.{kind.__name__}" for kind in (NamedFolder, BesideSource, UserFolder))


@contextmanager
def stamped_by_source() -> Iterator[None]:
    """In the block, numba uses the stamps of this module for functions with ``cache=True``."""
    before = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = LOCATORS
    try:
        yield
    finally:
        config.CACHE_LOCATOR_CLASSES = before


@lru_cache
def _mark(file: Path) -> str:
    """Short fingerprint of the kernel modules that ``file`` depends on."""
    sources = sorted(reachable_sources(file))
    return text_fingerprint("".join(file_fingerprint(source) for source in sources))[:10]


@lru_cache
def reachable_sources(file: Path) -> frozenset[Path]:
    """``file`` and all kernel modules that it imports, directly or indirectly."""
    found, waiting = set[Path](), [file]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting.extend(imported_kernels(source))
    return frozenset(found)


@lru_cache
def imported_kernels(file: Path) -> tuple[Path, ...]:
    """Files of the kernel modules from which ``file`` imports, or that it imports itself.

    A pattern takes 3 ms for all kernels, Python's parser 125 ms.
    """
    found = IMPORT.findall(file.read_text(encoding="utf-8"))
    names = [module for module, _ in found]
    names += [name.split()[0] for module, rest in found if not module for name in _listed_names(rest)]
    return tuple(KERNELS / f"{name}.py" for name in names if name)


def _listed_names(rest: str) -> list[str]:
    """The names, each with its alias, that ``(a, b as c)`` or ``a, b as c`` lists; comments are left out."""
    bare = re.sub("#.*", "", rest).strip(" ()\n")
    return [name for name in bare.split(",") if name.strip()]
