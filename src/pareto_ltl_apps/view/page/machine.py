"""The automaton of the mission as shapes of an SVG drawing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from careful_io.times import hours_text
from pareto_ltl.extend import Automaton
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl_apps.view.automaton_picture import MAX_DRAWN, STATE_RADIUS, drawn_edges, state_positions

SCALE = 62.0  # of the drawing, in pixels per unit of the picture
LEFT, ABOVE, RIGHT, BELOW = 1.15, 1.35, 0.9, 0.8  # margins, in units


def shown_automaton(automaton: Automaton) -> dict[str, Any]:
    """States, edges and their labels in pixels; without shapes if there are too many states to draw."""
    roles = ["goal" if automaton.accepting[q] else "lost" if q == automaton.trap else "open"
             for q in range(automaton.n_states)]  # fmt: skip
    document: dict[str, Any] = {"initial": automaton.initial, "roles": roles, "states": automaton.n_states}
    if automaton.n_states > MAX_DRAWN:
        return document | {"shapes": None}
    place = state_positions(automaton)
    edges = list(drawn_edges(place, automaton.edge_labels()))
    low = place.min(axis=0) - np.array([LEFT, BELOW])
    high = place.max(axis=0) + np.array([RIGHT, ABOVE])

    def pixels(points: FloatArray) -> FloatArray:
        flipped = np.array([[1.0, -1.0]]) * (np.atleast_2d(points) - [[low[0], high[1]]])
        return np.asarray(np.round(SCALE * flipped, 1), float)

    shapes = {
        "width": round(SCALE * float(high[0] - low[0])),
        "height": round(SCALE * float(high[1] - low[1])),
        "radius": SCALE * STATE_RADIUS,
        "states": [
            {"number": q, "role": role, "at": pixels(place[q])[0].tolist()} for q, role in enumerate(roles)
        ],
        "edges": [
            {
                "start": edge.start, "end": edge.end, "d": _curve(pixels(edge.curve)),
                "lines": told_clocks(automaton, edge.text).split("\n"), "at": pixels(edge.spot)[0].tolist(),
                "lost": edge.end == automaton.trap,
            }
            for edge in edges
        ],
        "entry": pixels(place[automaton.initial])[0].tolist(),
    }  # fmt: skip
    return document | {"shapes": shapes}


def told_clocks(automaton: Automaton, text: str) -> str:
    """``text`` with the clocks of the automaton as times t after departure: ``(t ≤ 8 h)``."""
    clocks = automaton.clocks
    for name in sorted(clocks, key=len, reverse=True):
        begin, end = clocks[name].begin, clocks[name].end
        if math.isinf(end):
            reported = f"t > {hours_text(round(begin))}"
        else:
            reported = f"{hours_text(begin)} ≤ " * (begin > 0.0) + f"t ≤ {hours_text(end)}"
        text = text.replace(name, f"({reported})")
    return text


def _curve(points: FloatArray) -> str:
    """Control points as an SVG path: a quadratic or a cubic curve."""
    first, *rest = (f"{x:g} {y:g}" for x, y in points)
    return f"M{first} {'Q' if len(rest) == 2 else 'C'}{' '.join(rest)}"
