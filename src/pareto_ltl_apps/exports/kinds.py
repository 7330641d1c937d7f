"""The table of export formats: a format is one row here, or an :class:`ExportFormat` of another package.

Another package adds a format by an entry point in the group ``pareto_ltl.exports``; its name is then a value
of ``exports.formats``, ``--formats`` and ``pareto_ltl.export``. A row names the function that makes the file,
so that help and a wrong setting import no format.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from typing import TYPE_CHECKING

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.extensions import EXPORTS

if TYPE_CHECKING:
    from pareto_ltl_apps.exports.exported import ExportedPlan


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """A format of exports.

    Attributes
    ----------
    file : str
        The name of its file, without a folder.
    maker : callable or str
        Function from an ``ExportedPlan`` to the content of the file, or ``module:function``.
    timed : bool
        It needs times in UTC, so that a plan without them is not written.
    areas : bool
        It has areas in degrees, which cannot contain a pole.
    """

    file: str
    maker: Callable[[ExportedPlan], bytes] | str
    timed: bool = False
    areas: bool = False

    def __post_init__(self) -> None:
        if not self.file or {*self.file} & {*"/\\*?["}:
            raise ConfigError(f"ExportFormat.file must be the name of a file in no folder, got {self.file!r}")

    def content(self, exported: ExportedPlan) -> bytes:
        """The content of the file; DataError or InfeasibleError if the plan cannot be written in it."""
        if callable(self.maker):
            return self.maker(exported)
        module, _, name = self.maker.partition(":")
        found: bytes = getattr(import_module(module), name)(exported)
        return found


def _ours(file: str, maker: str, *, timed: bool = False, areas: bool = False) -> ExportFormat:
    return ExportFormat(file, f"{__package__}.{maker}", timed, areas)


FORMATS = {
    "dead_reckoning": _ours("dead_reckoning.csv", "tables:dead_reckoning_csv"),
    "card": _ours("flight_card.csv", "tables:flight_card"),
    "geojson": _ours("plan.geojson", "geojson:plan_geojson", areas=True),
    "kml": _ours("plan.kml", "xml_files:plan_kml", areas=True),
    "gpx": _ours("plan.gpx", "xml_files:plan_gpx"),
    "fpl": _ours("plan.fpl", "xml_files:plan_fpl"),
    "qgc": _ours("mission.plan", "qgc:mission_plan"),
    "mavlink": _ours("mavlink_script.json", "mavlink:mavlink_script"),
    "lua": _ours("plan.lua", "mavlink:plan_lua"),
    "corridor": _ours("corridor.geojson", "geojson:corridor_geojson", areas=True),
    "netcdf": _ours("trajectory.nc", "tables:trajectory_netcdf", timed=True),
    "f3548": _ours("operational_intent.json", "geojson:operational_intent", timed=True),
}
BRANCH_FILES = (  # of plans that branch, the second pair after a second fix
    "branch_?.csv", "branch_?_card.csv", "branch_??.csv", "branch_??_card.csv", "branch_cards.html",
)  # fmt: skip


def format_names() -> tuple[str, ...]:
    """The names of all formats; formats of other packages come last."""
    return (*FORMATS, *EXPORTS.names(FORMATS))


def format_named(name: str) -> ExportFormat:
    """The format ``name``; ConfigError if another package's cannot be loaded, KeyError if there is none."""
    found = EXPORTS.kind(FORMATS, name, lambda loaded: isinstance(loaded, ExportFormat))
    if name not in FORMATS and found.file in _taken():
        raise ConfigError(f"{name!r} in {EXPORTS.name} writes {found.file}, which is another file of a run")
    return found


@lru_cache
def _taken() -> frozenset[str]:
    """Files of a plan's records and of the formats above."""
    from pareto_ltl import Run
    from pareto_ltl.extend import Record

    records = (row for row in vars(Run).values() if isinstance(row, Record))
    own = (one.file for one in FORMATS.values())
    return frozenset([*own, *(name for row in records for name in row.writes)])


def format_files() -> tuple[str, ...]:
    """The files of all formats; a format of another package that cannot be loaded has none."""
    found = [one.file for one in FORMATS.values()]
    for name in EXPORTS.names(FORMATS):
        try:
            found.append(format_named(name).file)
        except ConfigError:  # said when the format is used
            continue
    return tuple(found)
