"""What this process compiles: events for those who show it. This module loads no numba."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

Watching = Callable[[str], None]
WATCHERS: list[tuple[Watching, Watching]] = []


@contextmanager
def compilation_watched(begins: Watching, ends: Watching = lambda _: None) -> Iterator[None]:
    """In the block, call ``begins`` with the name of each kernel before it is compiled, ``ends`` after it."""
    watcher = begins, ends
    WATCHERS.append(watcher)
    try:
        yield
    finally:
        WATCHERS.remove(watcher)


def compilation_begins(kernel: str) -> None:
    """The code of ``kernel`` is not on disk and is compiled next."""
    for begins, _ in tuple(WATCHERS):
        begins(kernel)


def compilation_ends(kernel: str) -> None:
    """The code of ``kernel`` is there."""
    for _, ends in tuple(WATCHERS):
        ends(kernel)
