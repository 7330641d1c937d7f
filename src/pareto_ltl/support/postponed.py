"""Imports of a library that this package never needs, postponed to the first use."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Any


@contextmanager
def postponed(name: str, functions: tuple[str, ...]) -> Iterator[None]:
    """Within the context the import of the module ``name`` does nothing until something of it is used.

    ``from name import f`` then gives a function that imports the module when it is called, for each f of
    ``functions``; the import of anything else imports the module at once, also in other threads.
    """
    stand_in = _Later(name)
    vars(stand_in).update({function: partial(_called, name, function) for function in functions})
    sys.modules.setdefault(name, stand_in)  # nothing is postponed if it was imported before
    try:
        yield
    finally:
        _remove(stand_in)


class _Later(ModuleType):
    """The place of a module that is not imported yet."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # the import system asks for some
            raise AttributeError(name)
        _remove(self)
        return getattr(import_module(self.__name__), name)


def _called(module: str, function: str, *args: Any, **options: Any) -> Any:
    return getattr(import_module(module), function)(*args, **options)


def _remove(stand_in: _Later) -> None:
    if sys.modules.get(stand_in.__name__) is stand_in:
        del sys.modules[stand_in.__name__]
