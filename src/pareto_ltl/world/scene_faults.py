"""The faults of a map, collected so that one message names all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import LONGEST_LINE, shown_text

ENDING = 40  # characters of a message for the number of faults that are left out
MOST_SHOWN = 400  # characters of one of several faults

Item = TypeVar("Item")
Made = TypeVar("Made")


class MapFaults:
    """Faults of a map whose messages begin with ``where``; ``texts`` are the faults of earlier steps."""

    def __init__(self, where: str, texts: Iterable[str] = ()) -> None:
        self.where, self.texts = where, list(texts)

    def add(self, text: str) -> None:
        """Add the message ``text``, unless it is known."""
        if text not in self.texts:
            self.texts.append(text)

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Add the message of a DataError in the block, and go on after the block."""
        try:
            yield
        except DataError as error:
            self.add(str(error))

    def each(self, items: Iterable[Item], make: Callable[[Item], Made]) -> list[tuple[Item, Made]]:
        """The ``items`` for which ``make`` raises no DataError, with its results."""
        found: list[tuple[Item, Made]] = []
        for item in items:
            with self.noted():
                found.append((item, make(item)))
        return found

    def refuse(self) -> None:
        """Raise one DataError that names the faults, if there are any; of too many the first ones."""
        if not self.texts:
            return
        if len(self.texts) == 1:
            raise DataError(self.texts[0])
        line = f"{self.where} has {len(self.texts)} faults: "
        for number, text in enumerate(self.texts, 1):
            own = shown_text(text.removeprefix(self.where).lstrip(": "), MOST_SHOWN)
            more = f"{'; ' if number > 1 else ''}({number}) {own}"
            if len(line) + len(more) > LONGEST_LINE - ENDING:
                line += f"; and {len(self.texts) - number + 1} more"
                break
            line += more
        raise DataError(line)
