"""The records from which figures are drawn: of a run, or of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pareto_ltl.support.medium import Medium, medium_of

if TYPE_CHECKING:
    from pathlib import Path

    from pareto_ltl.planning.evaluate import Forecast
    from pareto_ltl.planning.records import Forest, Front, Plan
    from pareto_ltl.simulation.records import Deployment
    from pareto_ltl.support.arrays import FloatArray
    from pareto_ltl.wind.records import WindField
    from pareto_ltl.world.cells import Decomposition
    from pareto_ltl.world.scene import Scene


@dataclass(frozen=True, slots=True)
class DrawnRun:
    """The records of a run that its figures show.

    Attributes
    ----------
    decomposition, wind : or None
        None in the figure of a single record, which shows neither cells nor wind.
    forest, front, plan : or None
        None if the run did not make it; the map then states that there is no plan.
    deployments : mapping of wind law to Deployment
        Simulated flights; the first ``report.paths`` of each law are drawn.
    forecasts : mapping of wind law to Forecast
        V and R of the plan under each law.
    """

    scene: Scene
    decomposition: Decomposition | None = None
    wind: WindField | None = None
    forest: Forest | None = None
    front: Front | None = None
    plan: Plan | None = None
    deployments: Mapping[str, Deployment] = field(default_factory=dict)
    forecasts: Mapping[str, Forecast] = field(default_factory=dict)

    @property
    def medium(self) -> Medium:
        """Water if the wind is a current, else air."""
        return medium_of(None if self.wind is None else self.wind.level)


@dataclass(frozen=True, slots=True)
class Study:
    """The result of a study.

    Attributes
    ----------
    tables : mapping of name to rows
        Each row maps column to value; a table becomes ``name.csv``.
    numbers : mapping of name to float
        The metrics of the study, for ``metrics.json``.
    text : str
        The main tables as Markdown, for documents and the screen.
    pictures : mapping of name to object
        Further data for figures (paths, flights); not written to disk.
    """

    tables: Mapping[str, Sequence[Mapping[str, Any]]]
    numbers: Mapping[str, float]
    text: str
    pictures: Mapping[str, Any] = field(default_factory=dict)


def write_study(directory: Path, study: Study) -> None:
    """Write every table as CSV, columns in the order of the first row, and the main ones as ``tables.md``."""
    from pareto_ltl.support.files import write_bytes, write_csv

    for name, rows in study.tables.items():
        if rows:
            header = tuple(rows[0])
            write_csv(directory / f"{name}.csv", header, ([row[key] for key in header] for row in rows))
    write_bytes(directory / "tables.md", study.text.encode())


@dataclass(frozen=True, slots=True)
class PromiseDiagrams:
    """The promises of a forecast test against what came, as ``pareto-ltl scores`` draws them.

    Attributes
    ----------
    fidelity : str
        The preset of planning; the promises are made in its wind law.
    promised, realised : (N,) float
        Rates of failure, in the order of the promises.
    isotonic, low, high : (N,) float
        The isotonic rates, and the range in which the isotonic rates of exact promises lie.
    parts : mapping of name to float
        The Brier score and its parts.
    thresholds : (T,) float
        Probabilities above which somebody decides not to fly.
    curves : mapping of name to (T,) float
        Mean elementary scores: of the promises, of simple ones, of another test.
    other : str
        What the promises are compared with.
    difference, difference_low, difference_high : (T,) float
        Elementary scores minus the scores of ``other``, with 95 % intervals; NaN where the scores are equal.
    """

    fidelity: str
    promised: FloatArray
    realised: FloatArray
    isotonic: FloatArray
    low: FloatArray
    high: FloatArray
    parts: Mapping[str, float]
    thresholds: FloatArray
    curves: Mapping[str, FloatArray]
    other: str
    difference: FloatArray
    difference_low: FloatArray
    difference_high: FloatArray
