"""Coarser searches, for comparisons of many plans or for a plan that is needed soon."""

from __future__ import annotations

from dataclasses import replace

from pareto_ltl.settings import Settings

PROMPT_TREES, PROMPT_POINTS, PROMPT_FLIGHTS = 5, 6, 300  # upper limits of a plan that is made in the air
PROMPT_SHARE = 0.6  # of planner.n_max


def quick_settings(settings: Settings) -> Settings:
    """``settings`` with a coarse search only: half the time, slightly worse plans."""
    from pareto_ltl.planning.refine.front_sweep import coarse

    return replace(settings, refine=coarse(settings.refine))


def prompt_settings(settings: Settings) -> Settings:
    """``settings`` for a robot that waits for its plan: a smaller search than the quick one.

    The rest of the old plan is a candidate of the front, so that the new plan is not worse.
    """
    coarse = quick_settings(settings)
    refine = replace(
        coarse.refine,
        points=min(coarse.refine.points, PROMPT_POINTS),
        flights=min(coarse.refine.flights, PROMPT_FLIGHTS),
        sweep_flights=min(coarse.refine.sweep_flights, PROMPT_FLIGHTS),
    )
    planner = replace(
        coarse.planner,
        trees=min(coarse.planner.trees, PROMPT_TREES),
        n_max=max(1, int(PROMPT_SHARE * coarse.planner.n_max)),
    )
    return replace(coarse, refine=refine, planner=planner)
