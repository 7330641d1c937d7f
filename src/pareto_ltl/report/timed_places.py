"""Regions and obstacles that are active for a limited time, and the text of their times on a map."""

from __future__ import annotations

import math

from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.windows import Window, hours_text


def timed_obstacles(scene: Scene) -> tuple[FloatArray, ...]:
    """Outlines of all regions that are forbidden for a limited time."""
    return tuple(
        outline for name, outlines in scene.regions.items() if _forbidden(scene, name) for outline in outlines
    )


def visited_outlines(scene: Scene) -> tuple[FloatArray, ...]:
    """Outlines of the regions that a mission can visit: all that are not forbidden for a limited time."""
    return tuple(
        outline
        for name, outlines in scene.regions.items()
        if name not in scene.forbidden
        for outline in outlines
    )


def time_lines(scene: Scene, region: str) -> list[str]:
    """When ``region`` is active or forbidden, one line for each window.

    Examples are ``until 6 h`` and ``forbidden 3 to 5 h``. The line of a window that makes a proposition of
    another name begins with that name.
    """
    lines = []
    for name, window in scene.windows.items():
        if window.region == region:
            use = "forbidden" if name in scene.forbidden else name if name != region else ""
            lines.append(f"{use} {short_span(window)}".strip())
    return lines


def short_span(window: Window) -> str:
    """The times of a window after departure, abbreviated: ``3 to 5 h``, ``until 6 h``, ``from 90 min``."""
    if window.begin <= 0.0 and math.isinf(window.end):
        return "at any time"
    if window.begin <= 0.0:
        return f"until {hours_text(window.end)}"
    if math.isinf(window.end):
        return f"from {hours_text(window.begin)}"
    first, last = hours_text(window.begin), hours_text(window.end)
    unit = last.rpartition(" ")[2]
    return f"{first.removesuffix(f' {unit}')} to {last}"


def _forbidden(scene: Scene, region: str) -> bool:
    return any(scene.windows[name].region == region for name in scene.forbidden)
