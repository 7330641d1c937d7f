"""A run is an object whose records are attributes, each made when it is first asked for, timed and written.

:func:`record` makes a method of a subclass of :class:`BaseRun` such an attribute. A pipeline is a list of the
names of records; other packages add records to it as functions of the run.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar, overload

from pareto_ltl.run import provenance
from pareto_ltl.run.progress import ProgressBar
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.display import Displayed
from pareto_ltl.support.errors import ConfigError, InfeasibleError
from pareto_ltl.support.seeds import stage_seeds

if TYPE_CHECKING:
    from numpy.random import SeedSequence

    from pareto_ltl.settings import Settings

LOG = logging.getLogger("pareto_ltl")
T = TypeVar("T")


class Record(Generic[T]):
    """An attribute of a run, or a record that another package adds to the pipelines.

    Attributes
    ----------
    make : callable
        Function from the run to the record. It imports slow packages in its body.
    stage : str
        Its name in ``pipelines/*.yaml``, in the log and in the metrics.
    name : str
        Its name as an attribute of the run; outside a class by default ``stage``.
    writes : tuple of str
        Files of the record in the results directory: the same settings give the same bytes, except in columns
        of seconds. ``*`` is a wildcard.
    shows : tuple of str
        Files for people, figures and texts, which may contain times of computation.
    later : tuple of str
        Files that commands write for a finished run; the next run in the directory removes them, too.
    codec : str
        ``module:NAME``: functions ``write_NAME(directory, record)`` and ``read_NAME(place)`` of the module
        write the record into a directory and read it back, from the directory or from its only file. Empty if
        ``make`` writes the files itself, or there are none.
    words : str
        What it does, for people who wait; empty: its name. The desk has the same words.
    check : callable
        Raises ConfigError for settings with which it cannot run, before anything is made.
    elsewhere : bool
        It may read and write files outside of the results directory, as studies do.
    """

    def __init__(
        self, make: Callable[[Any], T], stage: str = "", writes: tuple[str, ...] = (),
        shows: tuple[str, ...] = (), codec: str = "", *, name: str = "", words: str = "",
        later: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        self.make, self.writes, self.shows, self.later, self.codec = make, writes, shows, later, codec
        self.stage = stage or make.__name__
        self.name, self.words, self.elsewhere = name or self.stage, words, False
        self.check: Callable[[Settings], None] = lambda _: None
        self.__doc__ = make.__doc__

    def __set_name__(self, kind: type, name: str) -> None:
        self.name = name

    @property
    def for_people(self) -> bool:
        """Whether all its files are figures and pages, on which no other record depends."""
        return bool(self.shows) and not self.writes

    @overload
    def __get__(self, run: None, kind: type) -> Self: ...

    @overload
    def __get__(self, run: BaseRun, kind: type) -> T: ...

    def __get__(self, run: BaseRun | None, kind: type) -> Self | T:
        return self if run is None else run.made(self)

    def save(self, directory: Path, found: T) -> None:
        """Write the record ``found`` into ``directory`` if it has a codec."""
        if self.codec:
            self._coder("write")(directory, found)

    def load(self, place: Path | str) -> T:
        """The record in a directory or a file, as :meth:`save` wrote it; DataError if it cannot be read."""
        found: T = self._coder("read")(place)
        return found

    def _coder(self, action: str) -> Callable[..., Any]:
        module, _, name = self.codec.partition(":")
        function: Callable[..., Any] = getattr(import_module(module), f"{action}_{name}")
        return function


def record(
    *writes: str, shows: tuple[str, ...] = (), codec: str = "", stage: str = "", words: str = ""
) -> Callable[[Callable[[Any], T]], Record[T]]:
    """Make a method of a run, or a function of one, a :class:`Record`; ``stage`` is by default its name."""
    return lambda make: Record(make, stage, writes, shows, codec, words=words)


@dataclass(eq=False, repr=False)
class BaseRun(Displayed):
    """Settings and records; a subclass has one method for each record.

    Attributes
    ----------
    settings : Settings
        The settings that records are made with.
    records : dict of str to object
        The records that were made, read or given, by name.
    directory : Path or None
        Where records are written as soon as they are made; None keeps them in memory.
    progress : ProgressBar or None
        Shows the present stage.
    seconds : dict of str to float
        Time that each stage took, without the stages that it waited for [s].
    read : mapping of str to str or None
        SHA-256 of the files that an earlier run read for the ``records``; None if this run reads them.
    stored : frozenset of str or None
        Names of the records that are in files of ``directory``, into which then nothing is written.
    failure : str
        Why the mission is infeasible; empty if it is not, or not known to be.
    budget : Budget
        Time limit of growth and refinement together (``planner.budget_seconds``).
    """

    settings: Settings
    records: dict[str, Any] = field(default_factory=dict)
    directory: Path | None = None
    progress: ProgressBar | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    read: Mapping[str, str] | None = None
    stored: frozenset[str] | None = None
    failure: str = field(default="", init=False)
    budget: Budget = field(init=False)
    _infeasible: dict[str, InfeasibleError] = field(default_factory=dict, init=False)
    _added: set[str] = field(default_factory=set, init=False)  # records that are no attributes of the class

    def __post_init__(self) -> None:
        self.budget = Budget(self.settings.planner.budget_seconds)

    @classmethod
    def rows(cls) -> dict[str, Record[Any]]:
        """The records of the class by name, in the order in which they follow from each other."""
        found = (value for base in reversed(cls.__mro__) for value in vars(base).values())
        return {value.name: value for value in found if isinstance(value, Record)}

    def made(self, row: Record[T]) -> T:
        """The record of ``row``: given, read, or made now; InfeasibleError each time if there is none."""
        if row.name in self._infeasible:
            raise self._infeasible[row.name]
        if row.name not in self.records:
            if row.name in (self.stored or ()):
                self.records[row.name] = self._load(row)
            else:
                self._make(row)
        found: T = self.records[row.name]
        return found

    def _load(self, row: Record[Any]) -> Any:
        return row.load(self.place)

    def _make(self, row: Record[Any]) -> None:
        writing = self.directory is not None and self.stored is None
        began, earlier = time.perf_counter(), dict(self.seconds)
        passed_on = False
        try:
            with self.progress.stage(row.stage, row.words) if self.progress else nullcontext():
                self.records[row.name] = row.make(self)
                if row.name not in self.rows():
                    self._added.add(row.name)
                if writing:
                    row.save(self.place, self.records[row.name])
                    if self.progress:
                        self.progress.made(row.name, self.records)
        except InfeasibleError as error:
            passed_on = error in self._infeasible.values()  # from a record that this one asked for
            self._infeasible[row.name], self.failure = error, self.failure or str(error)
            raise
        finally:
            if not passed_on:
                waited = sum(spent for name, spent in self.seconds.items() if name not in earlier)
                self.seconds[row.stage] = time.perf_counter() - began - waited
        if writing:
            LOG.info("%s done in %.3f s", row.stage, self.seconds[row.stage])

    def get(self, name: str) -> Any:
        """The record ``name`` if it was made, read or given, or is in a file; else None."""
        row = self.rows().get(name)
        if name not in self.records and row is not None and name in (self.stored or ()):
            if not (self.place / row.writes[0]).is_file():
                return None
            self.made(row)
        return self.records.get(name)

    def make(self, *names: str) -> dict[str, Any]:
        """Make the records ``names`` if they do not exist; return them by name."""
        return {name: getattr(self, name) for name in names}

    def given(self, **records: Any) -> Self:
        """A run with ``records`` instead; those that follow from them are made again when asked for."""
        names = list(self.rows())
        if unknown := [name for name in records if name not in names]:
            raise TypeError(f"a run has no record {unknown[0]!r}; it has {', '.join(names)}")
        after = set(names[min(map(names.index, records), default=len(names)) :])
        left_out = after | self._added if records else after  # what other stages made may follow from any
        other = self.with_settings(self.settings)
        kept = {name: found for name, found in self.records.items() if name not in left_out}
        other.records = kept | records
        other.stored = None if self.stored is None else self.stored - after
        return other

    def with_settings(self, settings: Settings) -> Self:
        """A run of the same records, with other settings for those that are not made yet."""
        place = None if self.stored is None else self.directory
        return type(self)(settings, dict(self.records), place, read=self.read, stored=self.stored)

    def with_seed(self, seed: int) -> Self:
        """A run of the same records with another seed, also of the search, for records not made yet."""
        return self.with_settings(self.settings.with_seed(seed))

    def seeds(self, stream: str) -> SeedSequence:
        """The stream of random numbers ``stream`` of the run, from its beginning."""
        return stage_seeds(self.settings.seed, stream)

    @property
    def place(self) -> Path:
        """The results directory. A run without one raises ``ConfigError``."""
        if self.directory is None:
            raise ConfigError("this record is files: give the run a results directory")
        return self.directory

    def input_files(self) -> list[Path]:
        """The files that the records depend on; raises ``DataError`` if wind files are missing."""
        return provenance.input_files(self.settings)

    def wind_files(self) -> tuple[Path, ...]:
        """The files of the wind among them."""
        return provenance.wind_files(self.settings)

    def input_hashes(self) -> Mapping[str, str]:
        """SHA-256 of the files that the records depend on, by name; files of an earlier run are not read."""
        return provenance.input_hashes(self.settings) if self.read is None else self.read
