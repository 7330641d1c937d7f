"""An example of every extension: stage, settings, wind, pattern, rule, cost, export, choices in ``conf/``.

``pyproject.toml`` names them as entry points. Large packages are imported inside the functions, so that the
program can report a wrong setting before it imports them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from pareto_ltl import ConfigError, ExportFormat, InfeasibleError, Run
from pareto_ltl.extend import CheckedSettings, MissionConfig, SelectionConfig, WindConfig, record, setting


@dataclass
class BriefingConfig(CheckedSettings, section="briefing"):
    """The text for the crew."""

    minutes: bool = setting(False, "whether the flight time is in minutes, not in hours")


SECTIONS = (BriefingConfig,)


@record()
def briefing(run: Run) -> Path:
    """A text file with the formula, the regions and the flight time."""
    hours = len(run.plan.path.u) * run.settings.robot.dt / 3600
    time = f"{60 * hours:.0f} min" if run.settings[BriefingConfig].minutes else f"{hours:.1f} h"
    path = run.place / "briefing.txt"
    regions = ", ".join(run.scene.regions)
    path.write_text(f"{run.plan.formula}\nregions: {regions}\nflight time: {time}\n")
    return path


def legs(exported) -> bytes:
    """True course over ground [deg] and length [km] of each leg, as a table for a notebook on a kneeboard."""
    log = exported.log
    rows = zip(log.track, log.distance, strict=True)
    return "".join(f"{track % 360:05.1f} {metres / 1e3:7.1f}\n" for track, metres in rows).encode()


LEGS = ExportFormat("legs.txt", legs)


def read_steady(cfg: WindConfig, wanted):
    """5 m/s towards the east with noise of 1 m/s, at 49 places every six hours of 9 October 2018."""
    import numpy as np

    from pareto_ltl import Readings

    places = np.array([[lon, lat] for lon in range(-96, -88, 1) for lat in range(34, 41)], float)
    times = [f"2018-10-{9 + hour // 24:02}T{hour % 24:02}:00:00Z" for hour in range(0, 49, 6)]
    noise = np.random.default_rng(0).standard_normal((len(times), len(places), 2))
    return Readings.of_arrays(times, places, np.array([5.0, 0.0]) + noise, leads=np.zeros(len(times)))


def _steady_wind():
    from pareto_ltl.extend import WindSource

    return WindSource(read=read_steady, files=lambda cfg, wanted: ())


def distance_from_home(problem, positions, velocities) -> float:
    """The largest distance of the expected path from the start [m]; ``positions`` (T+1, 2) [m]."""
    import numpy as np

    return float(np.linalg.norm(positions - positions[0], axis=1).max())


def _from_home():
    from pareto_ltl.extend import Cost

    return Cost(
        name="from_home",
        column="from_home_m",
        of=distance_from_home,
        text=lambda metres: f"{metres / 1000:.1f} km",
        note="largest distance from the start",
        label="largest distance from the start [km]",
        scale=1e-3,
    )


MADE = {"STEADY_WIND": _steady_wind, "FROM_HOME": _from_home}


def __getattr__(name: str):
    """Make ``STEADY_WIND`` and ``FROM_HOME`` at their first use: their modules import numerical packages."""
    if name in MADE:
        return MADE[name]()
    raise AttributeError(name)


def all_but_one(mission: MissionConfig) -> str:
    """All goals except one, in any order: ``F a & F b | F a & F c | F b & F c``."""
    choices = combinations(mission.goals, max(1, len(mission.goals) - 1))
    return " | ".join(" & ".join(f"F {goal}" for goal in goals) for goals in choices)


def shortest_path(cfg: SelectionConfig, front) -> int:
    """The number of the shortest path of the front, whatever its risk."""
    lengths = [path.objectives.length for path in front.paths]
    return lengths.index(min(lengths))


def safest_within(cfg: SelectionConfig, front) -> int:
    """The safest path that takes at most ``selection.options.hours``; a front lists the safest first."""
    hours = cfg.options.get("hours")
    if isinstance(hours, bool) or not isinstance(hours, int | float) or hours <= 0:
        raise ConfigError(f"selection.options.hours must be a positive number [h], got {hours!r}")
    times = [path.t[-1] / 3600 for path in front.paths]
    for number, time in enumerate(times):
        if time <= hours:
            return number
    raise InfeasibleError(
        f"no path takes at most selection.options.hours = {hours:g}; the quickest takes {min(times):.1f} h"
    )
