"""The commands of ``pareto-ltl``, in one table, which imports no other module of the command line."""

from __future__ import annotations

from dataclasses import dataclass

from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.messages import shown_value


@dataclass(frozen=True, slots=True)
class Command:
    """A command: the function ``NAME_command`` of the module ``NAME_command`` in ``cli``.

    The function takes the other words of the command line and returns an
    :class:`~pareto_ltl.cli.output.Answer`;
    :func:`~pareto_ltl.cli.arguments.run_reported` reports its errors.
    """

    name: str
    meaning: str


@dataclass(frozen=True, slots=True)
class StreamingCommand(Command):
    """A command that prints while it works: its function also takes the output, and returns the exit code."""


@dataclass(frozen=True, slots=True)
class PipelineCommand(Command):
    """A command that runs the pipeline of its name; its help explains ``sections`` of the settings first."""

    sections: tuple[str, ...]


PIPELINE_COMMANDS = (
    PipelineCommand(
        "plan", "plan a mission, simulate the plan and draw it", ("mission", "planner", "selection")
    ),
    PipelineCommand("compare", "several planners in the same winds", ("compare", "evaluation")),
    PipelineCommand(
        "convergence", "bound and simulated failure as the trees grow", ("convergence", "evaluation")
    ),
    PipelineCommand("ablation", "one setting changed at a time", ("ablation", "evaluation")),
    PipelineCommand(
        "hindcast",
        "a test of interpolation: plans from few readings, flown in full fields",
        ("hindcast", "evaluation"),
    ),
    PipelineCommand(
        "forecast_test", "plans made hours ahead, flown through later winds", ("forecast_test", "evaluation")
    ),
    PipelineCommand(
        "departure",
        "the mission planned for many departure times, which are compared",
        ("departure", "evaluation"),
    ),
    PipelineCommand(
        "replanning",
        "a plan flown in true winds, with and without replanning at each fix",
        ("replanning", "evaluation"),
    ),
    PipelineCommand(
        "replan_test",
        "random missions flown through later winds, with and without replanning",
        ("replanning", "forecast_test", "evaluation"),
    ),
    PipelineCommand("sitl", "a plan flown by an independent aircraft, JSBSim, in the same winds", ("sitl",)),
    PipelineCommand(
        "wind", "the wind over a map and its standard deviation, without a plan", ("wind", "scene")
    ),
    PipelineCommand("ingest", "wind files to one small table of readings", ("ingest", "wind")),
)
COMMANDS = (
    *PIPELINE_COMMANDS,
    StreamingCommand("sweep", "many runs and one table; with a folder, its summary written again"),
    Command("formula", "the meaning of a mission formula"),
    Command("front", "the paths of the front: failure rate, length and the other costs"),
    Command("choose", "another path of the front as the plan, without planning again"),
    Command("export", "the plan for autopilots, maps and navigators: KML, GPX, MAVLink and others"),
    StreamingCommand("serve", "the planning desk: draw a mission in a browser, plan it, take the plan"),
    Command("show", "the page of a result, in a browser"),
    Command("explain", "a plan leg by leg, in the terminal"),
    Command("replan", "the rest of a flight planned again, from a position fix or in a new forecast"),
    StreamingCommand(
        "follow", "a flight watched: where the robot is, what the rest of the plan promises, alarms"
    ),
    Command("beacons", "where a beacon would reduce the failure of a plan most"),
    Command("rerun", "make a result again and compare it byte by byte"),
    Command("verify", "derive every claim of a result again, without the planner"),
    Command("scores", "the promises of a forecast test against what came, or two tests compared"),
    Command("wind-error", "the law of forecast errors, from past forecasts and analyses"),
    Command("warmup", "compile what a kind of run needs, before its first run"),
    Command("cache", "folder and size of the cache; cache clear empties it"),
)


def command_named(name: str) -> Command:
    """The command of that name; raises ConfigError with the closest name if there is none."""
    from difflib import get_close_matches

    table = {command.name: command for command in COMMANDS}
    if name not in table:
        near = get_close_matches(name, table, n=1)
        hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(table)}"
        raise ConfigError(f"unknown command {shown_value(name)}; {hint} (a setting is written key=value)")
    return table[name]
