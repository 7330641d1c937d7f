"""The records of a run: a store with typed keys, and the keys of the records that a plan is made of.

A key gives the type of its record without importing it: ``records[WIND]`` is a ``WindField`` for mypy, and a
wrong setting is reported before any numerical package is loaded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

from pareto_ltl.support.display import Displayed

if TYPE_CHECKING:
    from pathlib import Path

    from pareto_ltl.logic import Automaton
    from pareto_ltl.planning.evaluate import Forecast
    from pareto_ltl.planning.problem import Problem
    from pareto_ltl.planning.records import Forest, Front, Plan, PlannedPath
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.wind.readings import Readings
    from pareto_ltl.wind.records import WindField, WindObservations
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.scene import Scene

T = TypeVar("T")


@dataclass(frozen=True)
class RecordKey(Generic[T]):
    """The key of a record of type ``T``; ``name`` is the name of the stage that makes it."""

    name: str


READINGS: RecordKey[Readings] = RecordKey("readings")
SCENE: RecordKey[Scene] = RecordKey("scene")
DECOMPOSITION: RecordKey[Decomposition] = RecordKey("decomposition")
AUTOMATON: RecordKey[Automaton] = RecordKey("automaton")
OBSERVATIONS: RecordKey[WindObservations] = RecordKey("observations")
WIND: RecordKey[WindField] = RecordKey("wind")
PROBLEM: RecordKey[Problem] = RecordKey("problem")
FOREST: RecordKey[Forest] = RecordKey("forest")
CANDIDATES: RecordKey[tuple[PlannedPath, ...]] = RecordKey("candidates")  # given, to be judged with the front
FRONT: RecordKey[Front] = RecordKey("front")
PLAN: RecordKey[Plan] = RecordKey("plan")
FORECASTS: RecordKey[Mapping[str, Forecast]] = RecordKey("forecasts")  # by wind law
DEPLOYMENTS: RecordKey[Mapping[str, Deployment]] = RecordKey("deployment")  # by wind law
EXPORTS: RecordKey[tuple[Path, ...]] = RecordKey("export")
FIGURES: RecordKey[tuple[Path, ...]] = RecordKey("report")
PAGE: RecordKey[tuple[Path, ...]] = RecordKey("page")
WIND_TABLE: RecordKey[Path] = RecordKey("table")

GROUND: tuple[RecordKey[Any], ...] = (SCENE, DECOMPOSITION, AUTOMATON, WIND)  # of which a problem is made


class Records:
    """Records by key; each value has the type of its key. :meth:`replaced` makes a changed copy.

    Parameters
    ----------
    unread : mapping of key to function
        Records that are on disk: the function reads one when it is asked for, once.
    """

    __slots__ = ("_content", "_unread")

    def __init__(
        self,
        content: Mapping[RecordKey[Any], Any] | None = None,
        unread: Mapping[RecordKey[Any], Callable[[], Any]] | None = None,
    ) -> None:
        self._content = dict(content or {})
        self._unread = dict(unread or {})

    def __getitem__(self, key: RecordKey[T]) -> T:
        if key not in self:
            have = ", ".join(known.name for known in self) or "none"
            raise KeyError(f"there is no record {key.name!r}; there are {have}")
        if key not in self._content:
            self._content[key] = self._unread[key]()
        record: T = self._content[key]
        return record

    def __setitem__(self, key: RecordKey[T], record: T) -> None:
        self._content[key] = record

    def read_later(self, key: RecordKey[T], read: Callable[[], T]) -> None:
        """Let ``read`` read the record of ``key`` when it is asked for."""
        self._unread[key] = read

    def __contains__(self, key: RecordKey[Any]) -> bool:
        return key in self._content or key in self._unread

    def __iter__(self) -> Iterator[RecordKey[Any]]:
        return iter(self._content | self._unread)

    def get(self, key: RecordKey[T]) -> T | None:
        """The record of ``key``, or None if it was not made."""
        if key not in self:
            return None
        return self[key]

    def values(self) -> Iterator[object]:
        """The records that were made, in that order, and those that were read."""
        return iter(self._content.values())

    def copy(self) -> Records:
        """Another store of the same records."""
        return Records(self._content, self._unread)

    def replaced(self, key: RecordKey[T], record: T) -> Records:
        """A copy in which ``key`` has ``record``."""
        return Records(self._content | {key: record}, self._unread)


class RecordOf(Generic[T]):
    """An attribute of a :class:`RecordView`: the record of ``key``."""

    def __init__(self, key: RecordKey[T]) -> None:
        self.key = key

    @overload
    def __get__(self, view: None, kind: type) -> RecordOf[T]: ...

    @overload
    def __get__(self, view: RecordView, kind: type) -> T: ...

    def __get__(self, view: RecordView | None, kind: type) -> RecordOf[T] | T:
        return self if view is None else view[self.key]


class RecordView(Displayed):
    """The records of a run as attributes, or as ``view[KEY]``; a subclass defines where they come from."""

    __slots__ = ()

    def __getitem__(self, key: RecordKey[T]) -> T:
        raise NotImplementedError

    scene = RecordOf(SCENE)
    """The map (``Scene``)."""
    decomposition = RecordOf(DECOMPOSITION)
    """The convex cells of the map (``Decomposition``)."""
    automaton = RecordOf(AUTOMATON)
    """The minimal automaton of the mission (``Automaton``)."""
    wind = RecordOf(WIND)
    """The wind that the plan was made for (``WindField``)."""
    forest = RecordOf(FOREST)
    """The search trees (``Forest``)."""
    front = RecordOf(FRONT)
    """The non-dominated paths (``Front``)."""
    plan = RecordOf(PLAN)
    """The path to fly (``Plan``)."""
    deployments = RecordOf(DEPLOYMENTS)
    """The simulated flights by wind law (``Deployment``)."""
