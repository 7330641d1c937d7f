"""The commands of ``pareto-ltl``, in one table. Without a command, a command line is in the Hydra form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from pareto_ltl import __version__
from pareto_ltl.cli.arguments import run_reported
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value

VALUE_FLAGS = (
    *("--config-dir", "-cd", "--config-path", "-cp", "--config-name", "-cn"),
    *("--cfg", "-c", "--package", "-p", "--info", "-i", "--experimental-rerun"),
)  # flags whose value is the next word


@dataclass(frozen=True, slots=True)
class Command:
    """A command: what it does and the function that does it.

    Attributes
    ----------
    run : callable
        Takes the other words of the command line and returns the exit code.
    sections : tuple of str
        Of a pipeline: the sections of the settings that its help explains first.
    """

    name: str
    meaning: str
    run: Callable[[Sequence[str]], int]
    sections: tuple[str, ...] = ()


def _run_settings(command: str, argv: Sequence[str]) -> int:
    from pareto_ltl.cli.hydra_app import run_hydra

    return run_hydra(argv, command)


def _run_formula(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.formula_command import formula_command

    return formula_command(argv)


def _run_show(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.show_command import show_command

    return show_command(argv)


def _run_explain(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.explain_command import explain_command

    return explain_command(argv)


def _run_replan(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.replan_command import replan_command

    return replan_command(argv)


def _run_rerun(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.rerun_command import rerun_command

    return rerun_command(argv)


def _run_choose(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.choose_command import choose_command

    return choose_command(argv)


def _run_export(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.export_command import export_command

    return export_command(argv)


def _run_verify(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.verify_command import verify_command

    return verify_command(argv)


def _run_wind_error(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.wind_error_command import wind_error_command

    return wind_error_command(argv)


def _run_sweep(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.sweep_command import sweep_command

    return sweep_command(argv)


def _run_cache(argv: Sequence[str]) -> int:
    from pareto_ltl.cli.cache_command import cache_command

    return cache_command(argv)


def _pipeline(name: str, meaning: str, *sections: str) -> Command:
    return Command(name, meaning, partial(_run_settings, name), sections)


PIPELINE_COMMANDS = (
    _pipeline("plan", "plan a mission, simulate the plan and draw it", "mission", "planner", "selection"),
    _pipeline("compare", "several planners in the same winds", "compare", "evaluation"),
    _pipeline("convergence", "bound and simulated failure as the trees grow", "convergence", "evaluation"),
    _pipeline("ablation", "one setting changed at a time", "ablation", "evaluation"),
    _pipeline(
        "hindcast",
        "a test of interpolation: plans from few readings, flown in full fields",
        "hindcast",
        "evaluation",
    ),
    _pipeline(
        "forecast_test", "plans made hours ahead, flown through later winds", "forecast_test", "evaluation"
    ),
    _pipeline(
        "departure",
        "the mission planned for many departure times, which are compared",
        "departure",
        "evaluation",
    ),
    _pipeline(
        "replanning",
        "a plan flown in true winds, with and without replanning at each fix",
        "replanning",
        "evaluation",
    ),
    _pipeline("sitl", "a plan flown by an independent aircraft, JSBSim, in the same winds", "sitl"),
    _pipeline("wind", "the wind over a map and its standard deviation, without a plan", "wind", "scene"),
    _pipeline("ingest", "wind files to one small table of readings", "ingest", "wind"),
)
COMMANDS = (
    *PIPELINE_COMMANDS,
    Command("sweep", "many runs and one table; with a folder, its summary written again", _run_sweep),
    Command("formula", "the meaning of a mission formula", _run_formula),
    Command("choose", "another path of the front as the plan, without planning again", _run_choose),
    Command(
        "export", "the plan for autopilots, maps and navigators: KML, GPX, MAVLink and others", _run_export
    ),
    Command("show", "the page of a result, in a browser", _run_show),
    Command("explain", "a plan leg by leg, in the terminal", _run_explain),
    Command("replan", "the rest of a flight planned again, from a position fix", _run_replan),
    Command("rerun", "make a result again and compare it byte by byte", _run_rerun),
    Command("verify", "derive every claim of a result again, without the planner", _run_verify),
    Command("wind-error", "the law of forecast errors, from past forecasts and analyses", _run_wind_error),
    Command("cache", "folder and size of the cache; cache clear empties it", _run_cache),
)


def run_command_line(argv: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    if list(argv) == ["--version"]:
        print(f"pareto-ltl {__version__}")
        return 0
    place = _command_place(argv)
    if place is None:
        from pareto_ltl.cli.hydra_app import run_hydra

        return run_hydra(argv)
    rest = [*argv[:place], *argv[place + 1 :]]
    return run_reported(lambda: command_named(argv[place]).run(rest))


def _command_place(argv: Sequence[str]) -> int | None:
    """Index of the command: the first word that is not a flag, a value of a flag or a setting."""
    for place, word in enumerate(argv):
        if word.startswith("-") or (place and argv[place - 1] in VALUE_FLAGS):
            continue
        return None if "=" in word or word.startswith(("+", "~")) else place
    return None


def command_named(name: str) -> Command:
    """The command of that name; raises ConfigError with the closest name if there is none."""
    from difflib import get_close_matches

    table = {command.name: command for command in COMMANDS}
    if name not in table:
        near = get_close_matches(name, table, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(table)}"
        raise ConfigError(f"unknown command {shown_value(name)}; {hint} (a setting is written key=value)")
    return table[name]
