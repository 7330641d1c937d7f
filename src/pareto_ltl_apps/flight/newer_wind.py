"""A finished plan in a newer forecast: the records of its run, with another wind."""

from __future__ import annotations

from dataclasses import replace

from pareto_ltl import Run
from pareto_ltl_apps.flight.rest_of_flight import (
    NewWind,
    field_alarms,
    newer_field,
    require_known_law,
    warn_of_use,
    wind_hashes,
)


def in_newer_wind(run: Run, wind: NewWind) -> tuple[Run, list[str]]:
    """The map and mission of ``run`` in a newer forecast, and the alarms about it.

    The wind is fitted for as long as the plan lasts. An alarm says that the law of the plan gives the newer
    forecast a probability of less than 1e-4; none for a robot with feedback, whose deviations stay small.

    Raises
    ------
    ConfigError
        If the plan has no departure in UTC, or the file does not exist.
    DataError
        If the forecast cannot be read, or does not cover the time or the map.
    """
    path, problem = run.plan.path, run.problem
    if run.read is not None:
        require_known_law(run.settings, run.read, wind)
    settings = replace(run.settings, robot=replace(run.settings.robot, dt=problem.motion.dt))
    cfg, field = newer_field(settings, wind, run.scene, len(path.u))
    warn_of_use(run.wind, field, 0.0, float(path.t[-1]))
    records = {"scene": run.scene, "cells": run.cells, "automaton": run.automaton, "wind": field}
    read = None if run.read is None else {**run.read, **wind_hashes(settings, cfg)}
    newer = Run(replace(settings, wind=cfg), records, read=read)
    return newer, field_alarms(problem, newer.problem, path)
