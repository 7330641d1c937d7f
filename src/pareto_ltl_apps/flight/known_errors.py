"""Settings of a robot whose own errors are partly known from position fixes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pareto_ltl.extend import RobotConfig
from pareto_ltl_apps.conditioning import Learnt
from pareto_ltl_apps.flight.position_fixes import FAR

NAMES = ("airspeed", "heading", "clock")
UNITS = np.array([1.0, -180.0 / math.pi, 1.0])  # of settings: headings in degrees, clockwise
LEAST = 1e-6  # share of the standard deviation of an error that no fix removes
CORRELATED = 1.0 - 1e-9  # correlations are below it, so that rounding leaves a covariance matrix


def robot_given(robot: RobotConfig, learnt: Learnt) -> RobotConfig:
    """``robot`` with the law of its start and errors given the fixes of ``learnt``.

    A fix to which the law gives less than 1e-4 is not explained by it and says nothing about the errors.
    """
    if not len(learnt.errors) or (learnt.distance > FAR).any():
        return replace(robot, start_sd=learnt.sd)
    before = [getattr(robot, f"{name}_sd") for name in NAMES]
    modelled = np.array([sd is not None for sd in before])
    cov = learnt.errors_cov * np.outer(UNITS, UNITS)
    least = LEAST * np.array([sd or 1.0 for sd in before])
    sd = np.sqrt(np.maximum(np.diag(cov), least**2))
    pairs = np.array([[0, 0, 1], [1, 2, 2]])
    both = modelled[pairs].all(axis=0)
    correlation = np.where(both, cov[tuple(pairs)] / sd[pairs].prod(axis=0), 0.0)
    given: dict[str, Any] = {f"{name}_sd": float(sd[q]) for q, name in enumerate(NAMES) if modelled[q]}
    given |= {f"{name}_bias": float(mean) for name, mean in zip(NAMES, UNITS * learnt.errors, strict=True)}
    shared = UNITS[:, None] * learnt.shared.T * modelled[:, None]
    given |= {"start_sd": learnt.sd_apart, "start_error_covariance": shared.tolist()}
    return replace(robot, **given, error_correlation=(CORRELATED * correlation).tolist())


def settings_of_errors(robot: RobotConfig) -> dict[str, Any]:
    """The settings of ``robot`` about its own errors, by name."""
    names = [f"{name}_{part}" for name in NAMES for part in ("sd", "bias")]
    return {name: getattr(robot, name) for name in (*names, "error_correlation", "start_error_covariance")}


def errors_text(robot: RobotConfig) -> str:
    """What the robot flies beyond what its instruments show: ``airspeed +1.2 % (sd 0.8 %)``; or nothing."""
    shown = ("airspeed", 100.0, " %"), ("heading", 1.0, " deg clockwise"), ("clock", 1.0, " s late")
    parts = [
        f"{name} {scale * getattr(robot, f'{name}_bias'):+.2g}{unit} (sd {scale * sd:.2g})"
        for name, scale, unit in shown
        if (sd := getattr(robot, f"{name}_sd")) is not None
    ]
    return f"the robot flies beyond what its instruments show: {', '.join(parts)}" if parts else ""
