"""A coarser refinement, for comparisons of many plans or for a plan that is needed soon."""

from __future__ import annotations

from dataclasses import replace

from pareto_ltl.settings import Settings

QUICK = {"points": 8, "flights": 500, "classes": 2}  # upper limits for section refine


def quick_settings(settings: Settings) -> Settings:
    """``settings`` with section ``refine`` limited to :data:`QUICK`: half the time, slightly worse plans."""
    coarse = {name: min(getattr(settings.refine, name), most) for name, most in QUICK.items()}
    return replace(settings, refine=replace(settings.refine, **coarse))
