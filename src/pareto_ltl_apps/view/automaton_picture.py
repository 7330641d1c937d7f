"""Drawings of automata: Graphviz text, and figures without Graphviz."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from careful_io.names import quoted_text
from pareto_ltl.extend import Automaton
from pareto_ltl.support.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path as Curve

MAX_DRAWN = 40  # states; figures with more are not readable
STATE_RADIUS = 0.32
EDGE_SPOTS, LOOP_SPOTS = (0.5, 0.4, 0.6, 0.3, 0.7, 0.22, 0.78), (0.5,)  # shares of an edge, the best first
STATE_COLOUR, TRAP_COLOUR, GOAL_COLOUR = "#222222", "#999999", "#0072b2"  # acceptance: blue of Okabe and Ito


@dataclass(frozen=True, slots=True)
class DrawnEdge:
    """An edge of a picture.

    Attributes
    ----------
    start, end : int
        States.
    curve : (3, 2) or (4, 2) float
        Control points of a Bezier curve; four for a loop.
    text : str
        Label, with line breaks.
    spot : (2,) float
        Centre of the label.
    """

    start: int
    end: int
    curve: FloatArray
    text: str
    spot: FloatArray


def dot_text(automaton: Automaton) -> str:
    """Graphviz text; accepting states have two circles, the trap is dashed."""
    lines = [
        "digraph mission {",
        "  rankdir=LR;",
        f"  label={quoted_text(automaton.formula)}; labelloc=t;",
        "  node [shape=circle];",
        "  start [shape=point];",
        f"  start -> {automaton.initial};",
    ]
    for q in range(automaton.n_states):
        if automaton.accepting[q]:
            lines.append(f"  {q} [shape=doublecircle];")
        elif q == automaton.trap:
            lines.append(f"  {q} [style=dashed];")
    for (p, q), label in automaton.edge_labels().items():
        lines.append(f"  {p} -> {q} [label={quoted_text(label)}];")
    return "\n".join([*lines, "}", ""])


def save_picture(automaton: Automaton, path: str | Path, dpi: int = 150) -> None:
    """Draw the automaton into a file (png, svg, pdf); ValueError for more than ``MAX_DRAWN`` states."""
    automaton_figure(automaton).savefig(path, dpi=dpi)


def automaton_figure(automaton: Automaton) -> Figure:
    """States as circles and letters on arrows; ValueError for more than ``MAX_DRAWN`` states."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    draw_automaton(axes, automaton)
    figure.set_size_inches(0.85 * np.ptp(axes.get_xlim()), 0.85 * np.ptp(axes.get_ylim()))
    axes.set_title(_wrapped_formula(automaton.formula, 90), fontsize=10)
    return figure


def draw_automaton(axes: Axes, automaton: Automaton) -> None:
    """Draw states as circles and letters on arrows; ValueError for more than ``MAX_DRAWN`` states."""
    from matplotlib.patches import Circle, FancyArrowPatch

    if automaton.n_states > MAX_DRAWN:
        raise ValueError(
            f"{automaton.n_states} states make no readable picture ({MAX_DRAWN} are the limit); write them "
            "as HOA or DOT, or give only the letters that can occur"
        )
    place, texts = state_positions(automaton), automaton.edge_labels()
    low = place.min(axis=0) - np.array([1.1, 0.9])
    high = place.max(axis=0) + np.array([0.9, 1.3])
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.set_axis_off()
    head: dict[str, Any] = {"arrowstyle": "-|>", "mutation_scale": 11, "lw": 1.0}
    for q, (x, y) in enumerate(place):
        colour = (
            GOAL_COLOUR if automaton.accepting[q] else TRAP_COLOUR if q == automaton.trap else STATE_COLOUR
        )
        style = "--" if q == automaton.trap else "-"
        axes.add_patch(Circle((x, y), STATE_RADIUS, fill=False, ec=colour, ls=style, lw=1.3))
        if automaton.accepting[q]:
            axes.add_patch(Circle((x, y), STATE_RADIUS - 0.06, fill=False, ec=colour, lw=1.0))
        axes.text(x, y, str(q), ha="center", va="center", color=colour, fontsize=10)
    x, y = place[automaton.initial]
    entry = (x - STATE_RADIUS - 0.6, y), (x - STATE_RADIUS, y)
    axes.add_patch(FancyArrowPatch(*entry, color=STATE_COLOUR, shrinkA=0, shrinkB=0, **head))
    for edge in drawn_edges(place, texts):
        colour = TRAP_COLOUR if edge.end == automaton.trap else STATE_COLOUR
        axes.add_patch(FancyArrowPatch(path=_curve_path(edge.curve), color=colour, **head))
        font = {"ha": "center", "va": "center", "fontsize": 7.5, "color": colour}
        box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none"}
        axes.text(edge.spot[0], edge.spot[1], edge.text, font, bbox=box)


def drawn_edges(place: FloatArray, texts: dict[tuple[int, int], str]) -> Iterator[DrawnEdge]:
    """Curves and label positions of the edges with ``texts``, between states at ``place`` (Q, 2).

    A label stands where it covers the least area of states and earlier labels, in the middle if that is free.
    """
    boxes, count = np.zeros((len(place) + len(texts), 4)), len(place)  # centres and half sizes
    boxes[:count] = np.hstack([place, np.full_like(place, STATE_RADIUS)])
    for (p, q), text in texts.items():
        curve = _loop_edge(place[p]) if p == q else _bent_edge(place, p, q, (q, p) in texts)
        label = _wrapped_formula(text, 22)
        lines = label.split("\n")
        half = np.array([0.04 * max(map(len, lines)), 0.1 * len(lines)])  # for text of 7.5 pt
        spots = [_bezier_point(curve, t) for t in (LOOP_SPOTS if p == q else EDGE_SPOTS)]
        spot = spots[int(np.argmin([_covered_area(boxes[:count], spot, half) for spot in spots]))]
        boxes[count], count = [*spot, *half], count + 1
        yield DrawnEdge(p, q, curve, label, spot)


def state_positions(automaton: Automaton) -> FloatArray:
    """Positions of the states, shape (Q, 2): columns by the longest path from the start, the trap below.

    States of a cycle are placed side by side in the order of their numbers.
    """
    import networkx as nx

    parts = nx.condensation(automaton.graph)  # strongly connected states are one node
    column, x = np.zeros(automaton.n_states, int), 0
    for generation in nx.topological_generations(parts):
        wide = 1
        for part in generation:
            members = sorted(parts.nodes[part]["members"] - {automaton.trap})
            column[members] = x + np.arange(len(members))
            wide = max(wide, len(members))
        x += wide
    place = np.zeros((automaton.n_states, 2))
    alive = [q for q in range(automaton.n_states) if q != automaton.trap]
    for depth in sorted(set(column[alive].tolist())):
        row = [q for q in alive if column[q] == depth]
        for k, q in enumerate(row):
            place[q] = 3.2 * depth, 2.2 * ((len(row) - 1) / 2 - k)
    if automaton.trap >= 0 and alive:
        others = place[alive]
        place[automaton.trap] = others[:, 0].mean(), others[:, 1].min() - 2.6
    return place


def _covered_area(boxes: FloatArray, spot: FloatArray, half: FloatArray) -> float:
    """Area of ``boxes`` (N, 4), centres and half sizes, that a label at ``spot`` covers."""
    sides = np.maximum(0.0, half + boxes[:, 2:] - np.abs(spot - boxes[:, :2]))
    return float((sides[:, 0] * sides[:, 1]).sum())


def _bent_edge(place: FloatArray, p: int, q: int, both: bool) -> FloatArray:
    """Control points (3, 2) of an edge, bent if states lie between its ends."""
    start, end = place[p], place[q]
    along = (end - start) / np.linalg.norm(end - start)
    side = np.array([-along[1], along[0]])
    t = (place - start) @ along
    off = (place - start) @ side
    blocked = ((t > 0.1) & (t < np.linalg.norm(end - start) - 0.1) & (np.abs(off) < 0.8)).any()
    bend = 0.45 * both + (0.9 + 0.12 * np.linalg.norm(end - start)) * blocked
    middle = (start + end) / 2 + side * bend
    leave, arrive = middle - start, end - middle
    return np.array(
        [
            start + STATE_RADIUS * leave / np.linalg.norm(leave),
            middle,
            end - STATE_RADIUS * arrive / np.linalg.norm(arrive),
        ]
    )


def _loop_edge(centre: FloatArray) -> FloatArray:
    """Control points (4, 2) of a loop above a state."""
    angle = math.radians(28)
    foot = STATE_RADIUS * np.array([math.sin(angle), math.cos(angle)])
    corners: FloatArray = np.array([[-foot[0], foot[1]], [-0.55, 1.0], [0.55, 1.0], foot])
    return corners + centre


def _curve_path(curve: FloatArray) -> Curve:
    from matplotlib.path import Path as Curve

    code = Curve.CURVE3 if len(curve) == 3 else Curve.CURVE4
    return Curve(curve, [Curve.MOVETO, *[code] * (len(curve) - 1)])


def _bezier_point(curve: FloatArray, t: float) -> FloatArray:
    while len(curve) > 1:
        curve = (1 - t) * curve[:-1] + t * curve[1:]
    return np.asarray(curve[0], float)


def _wrapped_formula(text: str, width: int) -> str:
    """``text`` with line breaks after ``|`` and ``&``."""
    lines, line = [], ""
    for word in text.replace(" & ", " &\x00").replace(" | ", " |\x00").split("\x00"):
        if line and len(line) + len(word) > width:
            lines.append(line.strip())
            line = ""
        line += f"{word} " if word.endswith(("&", "|")) else word
    return "\n".join([*lines, line.strip()])
