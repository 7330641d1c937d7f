"""Decorators that compile kernels, and the selection of code by the type of a model."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import config, njit
from numba.core.errors import TypingError
from numba.extending import overload

from typed_kernels.code_cache import FOREIGN, KernelCache
from typed_kernels.compilers import HelperCompiler, KernelCompiler, SharedCompiler

F = TypeVar("F", bound=Callable[..., Any])
# A wrapper for calls from C would hold the function once more, optimised and compiled.
PLAIN = {"_nrt": False, "error_model": "numpy", "no_cfunc_wrapper": True}
# Numba compiles a helper again for callers with other options: without "nogil", once for kernels and once for
# helpers.
HELPER = PLAIN | {"nogil": True, "pipeline_class": HelperCompiler}
ENTRY = {"nogil": True, "no_cfunc_wrapper": True, "pipeline_class": KernelCompiler}
SHARED_ENTRY = ENTRY | {"pipeline_class": SharedCompiler}


def kernel(function: F) -> F:
    """Compile a helper that allocates no memory, without reference counts.

    Helpers read arrays from nested named tuples. Numba changes a reference count, atomically, at every such
    read. The arrays belong to the caller and outlive the call, so the counts are not needed; with them, code
    that reads many arrays is several times as slow.
    """
    return _helper(function)


def inlined(function: F) -> F:
    """Copy a helper of a few lines into its callers before these are compiled.

    Numba optimises a helper that is not inlined again for each of its callers, which takes time.
    """
    return cast(F, njit(**PLAIN, inline="always")(function))


def vector(function: F) -> F:
    """Compile a helper whose sums may be reordered, so that its loops are vectorised.

    For sums over rows of arrays. Infinity and NaN behave as in IEEE arithmetic.
    """
    return _helper(function, fastmath={"reassoc", "contract", "nsz"})


def _helper(function: F, **options: Any) -> F:
    """Make a function that kernels call as machine code, and Python through a second compiled copy.

    With ``overload``, the code for kernels has no wrapper that unpacks Python objects, and compiles faster.
    The copy is compiled only if Python calls the helper, as tests do.
    """
    if config.DISABLE_JIT:
        return function
    copy = njit(**PLAIN, **options)(function)

    @wraps(function)
    def helper(*arguments: Any) -> Any:
        return copy(*arguments)

    overload(helper, strict=False, jit_options=HELPER | options)(lambda *_: function)
    return cast(F, helper)


def entry(function: F) -> F:
    """Compile a function that is called from Python: cached on disk, without the interpreter's lock."""
    return _cached(njit(**PLAIN | ENTRY)(function), function)


def shared_entry(function: F) -> F:
    """Compile a function that is called from Python and from other kernels."""
    return _cached(njit(**PLAIN | SHARED_ENTRY)(function), function)


def allocating(function: F) -> F:
    """Compile a function that allocates arrays, with reference counts; Python and kernels may call it."""
    return _cached(njit(**SHARED_ENTRY)(function), function)


def _cached(compiled: Any, function: F) -> F:
    """``compiled`` with the cache of this package; numba's own would be set by ``cache=True``."""
    if not config.DISABLE_JIT:
        compiled._cache = KernelCache(function)  # noqa: SLF001
    return cast(F, compiled)


class ChosenByType:
    """A function with one implementation for each type of its first argument, a named tuple.

    In compiled callers, numba inserts the implementation at compile time (``numba.extending.overload``):
    there is no branch at run time, and only the code of the models in use is compiled. Callers in plain
    Python look up the type in the same table.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.implementations: dict[type, Callable[..., Any]] = {}
        table = self.implementations

        @wraps(function)
        def chosen(*arguments: Any) -> Any:
            if type(arguments[0]) not in table:
                raise TypeError(self.missing(type(arguments[0])))
            return table[type(arguments[0])](*arguments)

        def implementation(first: Any, *_: Any) -> Callable[..., Any]:
            model = getattr(first, "instance_class", type(first))
            if model not in table:
                raise TypingError(self.missing(model))
            return table[model]

        overload(chosen, strict=False, jit_options=HELPER)(implementation)
        self.chosen = chosen

    def missing(self, model: type) -> str:
        """The error message for a model without an implementation."""
        name, known = self.chosen.__name__, ", ".join(sorted(t.__name__ for t in self.implementations))
        return (
            f"{name} has no code for {model.__name__}, only for {known}; add it with @implements({name}, ...)"
        )

    def register(self, *models: type) -> Callable[[F], F]:
        """Make the decorated function the implementation for ``models``."""

        def add(function: F) -> F:
            self.implementations.update(dict.fromkeys(models, function))
            declared, added = source_file(self.chosen), source_file(function)
            if added.parent != declared.parent:
                FOREIGN.setdefault(declared, set()).add(added)
            return function

        return add


def source_file(function: Callable[..., Any]) -> Path:
    """The file in which ``function`` is written, without what wraps it."""
    return Path(inspect.getfile(inspect.unwrap(function)))


IMPLEMENTATIONS: dict[Any, ChosenByType] = {}


def by_type(function: F) -> F:
    """Declare a function whose implementation is selected by the type of its first argument.

    :func:`implements` adds implementations.
    """
    chosen = ChosenByType(function)
    IMPLEMENTATIONS[chosen.chosen] = chosen
    return cast(F, chosen.chosen)


def implements(function: Callable[..., Any], *models: type) -> Callable[[F], F]:
    """Register the decorated function as the code of ``function`` for ``models``."""
    return IMPLEMENTATIONS[function].register(*models)
