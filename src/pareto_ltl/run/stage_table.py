"""Definition of a stage: a function, the records it needs, the record it makes, the settings it reads.

``run/stages.py`` holds the stages of a plan. ``studies/stages.py`` holds the stages of the studies, and
joins both with the stages of other packages into the table of the application.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Generic
from zlib import crc32

from pareto_ltl.run.records import RecordKey, Records, T
from pareto_ltl.settings import Settings
from pareto_ltl.support.budget import Budget
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import STAGE_GROUP, extension_names, load_extension

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.random import SeedSequence

    from pareto_ltl.run.pipeline import Run

FOREST_STREAM = "forest"  # stream of the random numbers of growth
FIGURES = "_figures"  # end of the names of stages that draw a study

Progress = Callable[..., None]  # called with (done, total), and with a text on the result so far


class StageInputs:
    """The inputs of one stage: the records that it declares, the settings, its random stream.

    ``inputs[WIND]`` is a record that the stage needs, ``inputs.get(PLAN)`` one that it uses if it exists.
    """

    __slots__ = ("_run", "_stage")

    def __init__(self, stage: Stage[Any], run: Run) -> None:
        self._stage = stage
        self._run = run

    def __getitem__(self, key: RecordKey[T]) -> T:
        if key not in self._stage.needs:
            raise ValueError(f"stage {self._stage.name!r} asks for {key.name!r}: add its key to needs")
        return self._run.records[key]

    def get(self, key: RecordKey[T]) -> T | None:
        """The record of ``key``, one of the stage's ``uses``; None if no earlier stage made it."""
        if key not in self._stage.uses:
            raise ValueError(f"stage {self._stage.name!r} asks for {key.name!r}: add its key to uses")
        return self._run.records.get(key)

    @property
    def records(self) -> Records:
        """A new store of the records that the stage needs, and of those that it uses and that exist."""
        used = {key: record for key in self._stage.uses if (record := self.get(key)) is not None}
        return Records({key: self[key] for key in self._stage.needs} | used)

    @property
    def settings(self) -> Settings:
        """All settings of the run."""
        return self._run.settings

    @property
    def seeds(self) -> SeedSequence:
        """The random stream of the stage, from its beginning; it depends on the run's seed and ``stream``."""
        if self._stage.stream is None:
            raise ValueError(f"stage {self._stage.name!r} draws random numbers: give it a stream")
        return stage_seeds(self.settings.seed, self._stage.stream)

    @property
    def directory(self) -> Path:
        """The results directory. A run without one raises ``ConfigError``."""
        if self._run.directory is None:
            raise ConfigError(f"stage {self._stage.name!r} writes files: run it with a results directory")
        return self._run.directory

    @property
    def budget(self) -> Budget:
        """Time limit of growth and refinement together (``planner.budget_seconds``)."""
        return self._run.budget

    @property
    def hashes(self) -> Mapping[str, str]:
        """SHA-256 of the files that the records of the run depend on, by name."""
        return self._run.input_hashes()

    @property
    def failure(self) -> str:
        """Why the mission is infeasible; empty if it is not, or not known to be."""
        return self._run.failure

    @property
    def progress(self) -> Progress | None:
        """A function to call with (done, total) and optionally a text; None if no progress is shown."""
        return self._run.progress


@dataclass(frozen=True)
class Stage(Generic[T]):
    """One step of a pipeline.

    Attributes
    ----------
    makes : RecordKey
        Key of the record that ``make`` returns. Its name is the name of the stage in ``pipelines/*.yaml`` and
        in the log.
    make : callable
        Function from :class:`StageInputs` to the record. It imports slow packages in its body.
    needs : tuple of RecordKey
        Records that earlier stages must have made.
    uses : tuple of RecordKey
        Records that are used if they exist.
    stream : str or None
        Name of the random stream of a stage that draws random numbers; another name gives other numbers.
    writes : tuple of str
        Files of the record in the results directory: the same settings give the same bytes, except in columns
        of seconds. ``*`` is a wildcard.
    shows : tuple of str
        Files for people, figures and texts, which may contain times of computation.
    codec : str
        ``module:NAME``: functions ``write_NAME(directory, record)`` and ``read_NAME(place)`` of the module
        write the record into a directory and read it back, from the directory or from its only file. The
        record is there if the first of ``writes`` is. Empty if ``make`` writes the files itself, or there
        are none.
    """

    makes: RecordKey[T]
    make: Callable[[StageInputs], T]
    needs: tuple[RecordKey[Any], ...] = ()
    uses: tuple[RecordKey[Any], ...] = ()
    stream: str | None = None
    writes: tuple[str, ...] = ()
    shows: tuple[str, ...] = ()
    codec: str = ""

    @property
    def name(self) -> str:
        """The name of the stage and of its record."""
        return self.makes.name

    def save(self, directory: Path, record: T) -> None:
        """Write ``record`` into ``directory`` if it has a codec."""
        if self.codec:
            self._coder("write")(directory, record)

    def load(self, place: Path | str) -> T:
        """The record in a directory or a file, as :meth:`save` wrote it; DataError if it cannot be read."""
        record: T = self._coder("read")(place)
        return record

    def _coder(self, action: str) -> Callable[..., Any]:
        module, _, name = self.codec.partition(":")
        function: Callable[..., Any] = getattr(import_module(module), f"{action}_{name}")
        return function


def stage_seeds(seed: int, stream: str) -> SeedSequence:
    """The random stream ``stream`` of a run with ``seed``; a new object each time: spawning changes it."""
    from numpy.random import SeedSequence

    return SeedSequence(seed, spawn_key=(crc32(stream.encode()),))


def named_child(seeds: SeedSequence, name: str) -> SeedSequence:
    """A child of ``seeds`` that ``spawn`` never makes; it does not depend on earlier use of ``seeds``."""
    from numpy.random import SeedSequence

    return SeedSequence(seeds.entropy, spawn_key=(*seeds.spawn_key, crc32(name.encode())))


class StageTable:
    """Stages by name, in order."""

    __slots__ = ("_stages", "known")

    def __init__(self, stages: Iterable[Stage[Any]], known: Iterable[str] = ()) -> None:
        self._stages: dict[str, Stage[Any]] = {}
        for stage in stages:
            if stage.name in self._stages:
                raise ValueError(f"two stages have the name {stage.name!r}")
            self._stages[stage.name] = stage
        self.known = tuple(dict.fromkeys((*self._stages, *known)))  # with names of stages that are not loaded

    def __getitem__(self, name: str) -> Stage[Any]:
        return self._stages[name]

    def __contains__(self, name: str) -> bool:
        return name in self._stages

    @property
    def files(self) -> tuple[str, ...]:
        """Patterns of all files that the stages write or show."""
        return tuple(name for stage in self._stages.values() for name in (*stage.writes, *stage.shows))

    def maker_of(self, key: RecordKey[T]) -> Stage[T]:
        """The stage that makes ``key``; ``KeyError`` if there is none."""
        if key.name not in self:
            raise KeyError(f"no stage makes {key.name!r}")
        return self[key.name]


def with_extension_stages(own: Iterable[Stage[Any]], listed: Iterable[str]) -> StageTable:
    """The table of ``own`` stages and of those among ``listed`` that other packages add.

    Raises
    ------
    ConfigError
        If an added stage has the name of one of ``own``, does not load, or is no :class:`Stage`.
    """
    stages = list(own)
    added = extension_names(STAGE_GROUP, [stage.name for stage in stages])
    for name in dict.fromkeys(listed):
        if name in added:
            stage = load_extension(STAGE_GROUP, name, lambda loaded: isinstance(loaded, Stage))
            if stage.name != name:
                raise ConfigError(
                    f"entry point {name!r} in {STAGE_GROUP} is the stage {stage.name!r}; give both one name"
                )
            stages.append(stage)
    return StageTable(stages, known=added)
