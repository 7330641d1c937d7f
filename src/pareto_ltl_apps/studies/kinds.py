"""The studies: each is one decorated function here, from which its stages, its command and its files follow.

The function makes the study, of the settings, the records that it needs, the results directory and a function
for the progress. It imports its module when it is called, since the table is read for every help text.
``pipelines/`` has the stages of each command, and ``settings.py`` its numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pareto_ltl.extend import Study

MAP = ("scene", "cells")  # records of figures with a map
WORLD = ("observations", "cells", "automaton", "scene")  # for plans
FIELD_TABLES = ("reliability.csv", "regions.csv", "scorecard.csv", "no_plan.csv")
FLIGHT_TABLES = ("replanning.csv", "replanning_flights.csv")


@dataclass(frozen=True, slots=True)
class StudyKind:
    """A study: the stages ``name`` and ``name_figures``, and a command.

    Attributes
    ----------
    name : str
        The name of its stage.
    make : callable
        Makes the :class:`~pareto_ltl.extend.Study`.
    purpose : str
        What the command does, in one line.
    tables : tuple of str
        The files of the study.
    figures : str
        ``MODULE.FUNCTION`` of ``view``: a function of the settings, the study and the records of ``drawn_on``
        that returns the functions which draw the figures, by name.
    command : str
        The command, and its pipeline.
    sections : tuple of str
        The sections of settings that its help explains.
    many_missions : bool
        It plans in several processes.
    words : str
        What it does, for people who wait; empty: its name.
    sizes : str
        A setting that lists sizes of trees, which must fit into memory; may be empty.
    """

    name: str
    make: Callable[..., Study]
    purpose: str
    tables: tuple[str, ...]
    figures: str
    command: str
    sections: tuple[str, ...]
    needs: tuple[str, ...] = WORLD
    drawn_on: tuple[str, ...] = ()
    many_missions: bool = True
    words: str = ""
    sizes: str = ""


STUDIES: dict[str, StudyKind] = {}


def study(
    purpose: str, *tables: str, figures: str, command: str = "", sections: tuple[str, ...] = (), **more: Any
) -> Callable[[Callable[..., Study]], Callable[..., Study]]:
    """Make the decorated function a study of its name; the arguments are attributes of :class:`StudyKind`.

    The command has the same name, and its help the section of that name and ``evaluation``, unless they are
    given.
    """

    def add(function: Callable[..., Study]) -> Callable[..., Study]:
        name = function.__name__
        shown = sections or (command or name, "evaluation")
        STUDIES[name] = StudyKind(name, function, purpose, tables, figures, command or name, shown, **more)
        return function

    return add


def study_sections() -> Iterator[str]:
    """The sections of settings of the studies."""
    yield from dict.fromkeys(section for kind in STUDIES.values() for section in kind.sections)


@study(
    "several planners in the same winds",
    "compare.csv", "compare_seeds.csv", "differences.csv", "no_plan.csv",
    figures="study_planners.comparison_figures", command="compare", drawn_on=MAP,
)  # fmt: skip
def comparison(*given: Any) -> Study:
    """Planners, each with every seed."""
    from pareto_ltl_apps.studies.compare import run_comparison

    return run_comparison(*given)


@study(
    "bound and simulated failure as the trees grow",
    "convergence.csv", "convergence_seeds.csv", "first_answer.csv",
    figures="study_planners.convergence_figures",
    sizes="convergence.sizes",
)  # fmt: skip
def convergence(*given: Any) -> Study:
    """Trees of several sizes."""
    from pareto_ltl_apps.studies.convergence import run_convergence

    return run_convergence(*given)


@study("one setting changed at a time", "ablation.csv", figures="study_planners.ablation_figures")
def ablation(*given: Any) -> Study:
    """Factors, one at a time."""
    from pareto_ltl_apps.studies.compare import run_ablation

    return run_ablation(*given)


@study(
    "a test of interpolation: plans from few readings, flown in full fields",
    "hindcast.csv", *FIELD_TABLES,
    figures="study_forecast_test.hindcast_figures", needs=(),
)  # fmt: skip
def hindcast(*given: Any) -> Study:
    """Random missions with readings of all times."""
    from pareto_ltl_apps.studies.forecast_test import run_hindcast

    return run_hindcast(*given)


@study(
    "plans made hours ahead, flown through later winds",
    "forecast_test.csv", "leads.csv", "surfaces.csv", "promise_levels.csv", "conformal_limits.csv",
    *FIELD_TABLES,
    figures="study_forecast_test.forecast_test_figures", needs=(),
)  # fmt: skip
def forecast_test(*given: Any) -> Study:
    """Random missions with forecasts."""
    from pareto_ltl_apps.studies.forecast_test import run_forecast_test

    return run_forecast_test(*given)


@study(
    "the mission planned for many departure times, which are compared",
    "departures.csv", "departure_lengths.csv", "departures.json",
    figures="study_departure.departure_figures", needs=("readings", *MAP, "automaton"), drawn_on=MAP,
    words="Comparing departures",
)  # fmt: skip
def departure(*given: Any) -> Study:
    """Departure times."""
    from pareto_ltl_apps.studies.departure import run_departure

    return run_departure(*given)


@study(
    "the mission planned at each level of the wind files, which are compared",
    "levels.csv", "level_lengths.csv", "levels.json",
    figures="study_levels.levels_figures", needs=(*MAP, "automaton"), drawn_on=MAP,
)  # fmt: skip
def levels(*given: Any) -> Study:
    """Levels of the wind."""
    from pareto_ltl_apps.studies.levels import run_levels

    return run_levels(*given)


@study(
    "a plan flown in true winds, with and without replanning at each fix", *FLIGHT_TABLES,
    figures="study_planners.replanning_figures",
)  # fmt: skip
def replanning(*given: Any) -> Study:
    """One mission, replanned in flight."""
    from pareto_ltl_apps.studies.replanning import run_replanning

    return run_replanning(*given)


@study(
    "random missions flown through later winds, with and without replanning", *FLIGHT_TABLES,
    figures="study_planners.replanning_figures", needs=(),
    sections=("replanning", "forecast_test", "evaluation"),
)  # fmt: skip
def replan_test(*given: Any) -> Study:
    """Random missions, replanned in flight."""
    from pareto_ltl_apps.studies.replanning import run_replan_test

    return run_replan_test(*given)


@study(
    "a plan flown by an independent aircraft, JSBSim, in the same winds", "sitl.csv",
    figures="study_planners.sitl_figures", sections=("sitl",),
    needs=("problem", "plan"), drawn_on=MAP, many_missions=False,
)  # fmt: skip
def sitl(*given: Any) -> Study:
    """A plan in software in the loop."""
    from pareto_ltl_apps.studies.sitl import run_sitl

    return run_sitl(*given)
