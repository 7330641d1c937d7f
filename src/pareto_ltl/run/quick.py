"""A coarser refinement, where many plans are compared or one is needed soon."""

from __future__ import annotations

from dataclasses import replace

from pareto_ltl.settings import Settings

QUICK = {"points": 8, "flights": 500, "sweep_flights": 200, "classes": 2}  # at most, of section refine


def quick_settings(settings: Settings) -> Settings:
    """``settings`` with a refinement of at most :data:`QUICK`: half of the time, a little less good."""
    coarse = {name: min(getattr(settings.refine, name), most) for name, most in QUICK.items()}
    return replace(settings, refine=replace(settings.refine, **coarse))


__all__ = ["QUICK", "quick_settings"]
