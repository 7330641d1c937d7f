"""All faults of an input in one message, as of a table or a set of files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from careful_io.errors import DataError
from careful_io.messages import LONGEST_LINE, shown_text

ENDING = 40  # characters of a message for the number of faults that are left out
MAX_SHOWN = 400  # characters of one of several faults
MAX_KEPT = 10_000  # faults whose texts are kept; more are counted

Item = TypeVar("Item")
Made = TypeVar("Made")


class FaultsError(DataError):
    """Several faults of one input.

    Attributes
    ----------
    texts : tuple of str
        The message of each fault, at most :data:`MAX_KEPT`.
    more : int
        Number of further faults.
    """

    def __init__(self, message: str, texts: tuple[str, ...] = (), more: int = 0) -> None:
        super().__init__(message)
        self.texts, self.more = texts, more


class Faults:
    """Faults of an input whose messages begin with ``where``; ``texts`` are the faults of earlier steps."""

    def __init__(self, where: str, texts: Iterable[str] = ()) -> None:
        self.where, self.more = where, 0
        self._texts: dict[str, None] = {}
        for text in texts:
            self.add(text)

    @classmethod
    def of_files(cls, kind: str, files: Sequence[Path]) -> Faults:
        """Faults of ``files`` of a ``kind``, such as "table"."""
        return cls(f"{kind} {files[0]}" if len(files) == 1 else f"the set of {len(files)} {kind}s")

    @property
    def texts(self) -> list[str]:
        """The messages, without those that are only counted."""
        return list(self._texts)

    def __len__(self) -> int:
        return len(self._texts) + self.more

    def add(self, text: str) -> None:
        """Add the message ``text``, unless it is known."""
        if len(self._texts) < MAX_KEPT:
            self._texts[text] = None
        elif text not in self._texts:
            self.more += 1

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Add the messages of a DataError in the block, and go on after the block."""
        try:
            yield
        except DataError as error:
            self.note(error)

    def tried(self, make: Callable[[], Made]) -> Made | None:
        """The result of ``make``; None, with its message added, if it raises a DataError."""
        with self.noted():
            return make()
        return None

    def each(self, items: Iterable[Item], make: Callable[[Item], Made]) -> list[tuple[Item, Made]]:
        """The ``items`` for which ``make`` raises no DataError, with its results."""
        found: list[tuple[Item, Made]] = []
        for item in items:
            with self.noted():
                found.append((item, make(item)))
        return found

    def going(self, items: Iterable[Item]) -> Iterator[Item]:
        """``items`` up to the first that cannot be made, whose messages are added."""
        steps = iter(items)
        while True:
            try:
                item = next(steps)
            except StopIteration:
                return
            except DataError as error:
                self.note(error)
                return
            yield item

    def note(self, error: DataError) -> None:
        """Add the messages of ``error``."""
        for text in getattr(error, "texts", (str(error),)):
            self.add(text)
        self.more += getattr(error, "more", 0)

    def refuse(self) -> None:
        """Raise one DataError that names the faults, if there are any; of too many the first ones."""
        texts, total = self.texts, len(self)
        if not texts:
            return
        if total == 1:
            raise DataError(texts[0])
        line = f"{self.where} has {total} faults: "
        for number, text in enumerate(texts, 1):
            own = shown_text(text.removeprefix(self.where).lstrip(":, "), MAX_SHOWN)
            more = f"{'; ' if number > 1 else ''}({number}) {own}"
            if len(line) + len(more) > LONGEST_LINE - ENDING:
                line += f"; and {total - number + 1} more"
                break
            line += more
        else:
            line += f"; and {self.more} more" if self.more else ""
        raise FaultsError(line, tuple(texts), self.more)
