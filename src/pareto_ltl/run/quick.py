"""A coarser refinement, for comparisons of many plans or for a plan that is needed soon."""

from __future__ import annotations

from dataclasses import replace

from pareto_ltl.settings import Settings


def quick_settings(settings: Settings) -> Settings:
    """``settings`` with a coarse search only: half the time, slightly worse plans."""
    from pareto_ltl.planning.refine.front_sweep import coarse

    return replace(settings, refine=coarse(settings.refine))
