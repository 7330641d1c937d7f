"""The machine code of kernels on disk: which is loaded, when it is compiled again, and where it is written.

A file holds the code of one kernel for one list of types. Its name contains a fingerprint of everything that
the code depends on: numba, Python, the processor, the types, and the stamp of the kernel. The stamp is a
fingerprint of the kernel's module, of every module of kernels that this one imports
(:mod:`typed_kernels.packages`), and of the files of other packages that add code to a function of these
(:data:`FOREIGN`). After a change, only what depends on it is compiled again. Numba's own cache compares only
the file of a compiled function, and has an index of pickled types: two processes that write it at the same
time can exchange each other's code. There is no index here.

Code is looked for in the folder that a wheel brings (:mod:`typed_kernels.shipped_code`), then in
:meth:`KernelCache.folders`. Only undamaged files that other users cannot write are read
(:mod:`typed_kernels.code_files`). If none of the folders can be written, one warning says so.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import re
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numba
from numba import config
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

from typed_kernels import packages
from typed_kernels.code_files import SUFFIX, read_code, write_code
from typed_kernels.packages import PACKAGES
from typed_kernels.shipped_code import Target, shipped_code, unusable_reason
from typed_kernels.watching import compilation_begins, compilation_ends

LOG = logging.getLogger(__name__)

# Source files with code for a function whose implementation is chosen by type, by the file of that function,
# if they are not in its folder.
FOREIGN: dict[Path, set[Path]] = {}
IMPORT = re.compile(r"^[ \t]*from[ ]+([\w.]+)[ ]+import[ ]+(\((?:[^()#]|#.*)*\)|[^\n]*)", re.MULTILINE)
COMPILING = "compiling for this machine, once: a minute or two; later runs find the machine code on disk"
DRAFT_LIFE = 600.0  # [s] writing a file takes less


class KernelCache(_Cache):  # type: ignore[misc]  # numba has no types
    """Machine code of one function: what numba calls before and after it compiles the function."""

    def __init__(self, function: Any) -> None:
        code = function.__code__
        self.function, self.source, self.enabled = function, Path(code.co_filename), True
        PACKAGES.setdefault(function.__module__.rpartition(".")[0], self.source.parent)
        name = re.sub("[<>]", "", function.__qualname__)
        self.start = f"{self.source.stem}.{name}-"
        self.base = f"{self.start}{code.co_firstlineno}-{_mark(self.source)}."

    @property
    def cache_path(self) -> str:
        """The folder in which code is looked for first, apart from the folder in a wheel."""
        return str(self.folders()[0])

    def folders(self) -> list[Path]:
        """``NUMBA_CACHE_DIR`` if it is set; else ``__pycache__`` beside the source, and the user's cache."""
        return code_folders(self.source.parent)

    def file_name(self, signature: Any, target: Target) -> str:
        """The name of the file with the code for the types ``signature`` and the processor ``target``."""
        cells = self.function.__closure__
        closure = dumps(tuple(cell.cell_contents for cell in cells)).hex() if cells else ""
        versions = numba.__version__, sys.implementation.cache_tag, self.function.__code__.co_code.hex()
        options = repr((config.OPT, config.BOUNDSCHECK, config.DEBUGINFO_DEFAULT))
        parts = (*versions, options, closure, code_stamp(self.source), str(signature), *target)
        return f"{self.base}{text_fingerprint(chr(0).join(parts))[:24]}{SUFFIX}"

    def kernel_name(self, signature: Any, file_name: str) -> str:
        """What a file says that it is: module, function and types, and the name of the file."""
        function = self.function
        types = text_fingerprint(str(signature))
        return f"{function.__module__}.{function.__qualname__} {types} {file_name}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for the types ``sig``, None if it must be compiled."""
        target_context.refresh()
        if not self.enabled:
            return None
        target = Target(*target_context.codegen().magic_tuple())
        shipped = shipped_code(self.source.parent)
        content = None
        if shipped is not None and shipped.triple == target.triple:
            name = self.file_name(sig, shipped.target)
            content = shipped.read(name, self.source, self.kernel_name(sig, name))
        name = self.file_name(sig, target)
        for folder in self.folders():
            content = content or read_code(folder / name, self.source, self.kernel_name(sig, name))
        if content is None:
            self._announce()
            return None
        return CompileResult._rebuild(target_context, *pickle.loads(content))  # noqa: SLF001

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the code ``data`` for the types ``sig``, if it does not depend on addresses in memory."""
        try:
            self._save(sig, data)
        finally:
            compilation_ends(self.start[:-1])

    def _save(self, signature: Any, data: Any) -> None:
        if not self.enabled or data.lifted or data.library.has_dynamic_globals:
            return
        # The text of the annotated source, with paths of this machine, is left out.
        reduced = tuple("" if isinstance(part, str) else part for part in data._reduce())  # noqa: SLF001
        name, content = self.file_name(signature, Target(*data.codegen.magic_tuple())), dumps(reduced)
        refused = ""
        for folder in self.folders():
            try:
                folder.mkdir(mode=0o755, parents=True, exist_ok=True)
                self.remove_outdated(folder)
                write_code(folder / name, self.source, self.kernel_name(signature, name), content)
            except OSError as error:
                refused = refused or f"{folder}: {getattr(error, 'strerror', None) or error}"
            else:
                return
        _warn_unwritable(refused)

    def _announce(self) -> None:
        """Say once in the log, and on a terminal, that code is compiled; tell watchers which kernel."""
        _say_compiling(unusable_reason(self.source.parent))
        compilation_begins(self.start[:-1])

    def remove_outdated(self, folder: Path) -> None:
        """Remove code of this function from other sources, and drafts of writers that were killed."""
        for found in folder.glob(f"{self.start}*"):
            if not found.name.startswith(self.base) and found.suffix in (SUFFIX, ".nbi"):
                found.unlink(missing_ok=True)
        for draft in folder.glob(f".*.{self.start}*"):  # its process may run on another machine
            with suppress(FileNotFoundError):  # it has just become a file of code
                if time.time() - draft.stat().st_mtime > DRAFT_LIFE:
                    draft.unlink()

    def enable(self) -> None:
        """Load and write code from now on."""
        self.enabled = True

    def disable(self) -> None:
        """Neither load nor write code."""
        self.enabled = False

    def flush(self) -> None:
        """Remove the code of this function from the folders."""
        for folder in self.folders():
            for found in folder.glob(f"{self.base}*{SUFFIX}"):
                with suppress(OSError):
                    found.unlink(missing_ok=True)


def code_folders(place: Path) -> list[Path]:
    """The folders with the code of sources in the folder ``place``."""
    inside = f"{place.name}_{text_fingerprint(str(place))[:40]}"
    if config.CACHE_DIR:
        return [Path(config.CACHE_DIR) / inside]
    users = Path(AppDirs(appname="numba", appauthor=False).user_cache_dir)
    return [place / "__pycache__", users / inside]


def has_code(kernel: str) -> bool:
    """Whether there is code of ``kernel``, as "module.function", for its present source and any types."""
    sources = (place / f"{kernel.partition('.')[0]}.py" for place in PACKAGES.values())
    return any(
        any(folder.glob(f"{kernel}-*-{_mark(source)}.*{SUFFIX}"))
        for source in sources
        if source.is_file()
        for folder in code_folders(source.parent)
    )


@lru_cache
def _warn_unwritable(text: str) -> None:
    """Say once that code is compiled in every run; ``text`` is a folder and what happened."""
    LOG.warning(
        "machine code cannot be kept, so every run compiles it again: %s; make room there, or let "
        "NUMBA_CACHE_DIR name a folder that can be written",
        text,
    )


@lru_cache
def _say_compiling(reason: str) -> None:
    LOG.info("%s", COMPILING)
    if reason:
        LOG.warning("%s", reason)
    if sys.stderr.isatty():
        for line in (COMPILING, reason) if reason else (COMPILING,):
            print(f"{packages.PROGRAM}: {line}", file=sys.stderr)


def code_stamp(file: Path) -> str:
    """Fingerprint of all source that the kernels in ``file`` depend on, as it is now."""
    reached = reachable_sources(file)
    added = (FOREIGN.get(source, set()) for source in reached)
    return _fingerprint(reached.union(*added))


@lru_cache
def _mark(file: Path) -> str:
    """Short fingerprint of the kernel modules that ``file`` depends on."""
    return _fingerprint(reachable_sources(file))[:10]


def _fingerprint(sources: Iterable[Path]) -> str:
    return text_fingerprint("".join(_source_fingerprint(source) for source in sorted(sources)))


@cache
def _source_fingerprint(source: Path) -> str:
    """SHA-256 of a source file, read once: as this process has imported it."""
    return hashlib.sha256(source.read_bytes()).hexdigest()


def text_fingerprint(text: str) -> str:
    """SHA-256 of ``text`` in UTF-8, 64 hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


@lru_cache
def reachable_sources(file: Path) -> frozenset[Path]:
    """``file`` and all modules of kernels that it imports, directly or indirectly."""
    found, waiting = set[Path](), [file]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting.extend(imported_kernels(source))
    return frozenset(found)


@lru_cache
def imported_kernels(file: Path) -> tuple[Path, ...]:
    """Files of the modules of kernels from which ``file`` imports, or that it imports itself.

    A pattern is 40 times as fast as Python's parser.
    """
    found: list[Path] = []
    folder: Path | None
    for module, rest in IMPORT.findall(file.read_text(encoding="utf-8")):
        if module in PACKAGES or module == ".":
            folder = PACKAGES.get(module, file.parent)
            found += [folder / f"{name.split()[0]}.py" for name in _listed_names(rest)]
        else:
            package, _, name = module.rpartition(".")
            folder = PACKAGES.get(package) if package else file.parent if module.startswith(".") else None
            found += [folder / f"{name}.py"] if folder else []
    return tuple(path for path in found if path.is_file())


def _listed_names(rest: str) -> list[str]:
    """The names, each with its alias, that ``(a, b as c)`` or ``a, b as c`` lists; comments are left out."""
    bare = re.sub("#.*", "", rest).strip(" ()\n")
    return [name for name in bare.split(",") if name.strip()]
