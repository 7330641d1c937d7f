"""Checks of probabilities in figures and pages: each names its wind law, and none is rounded to 0."""

from __future__ import annotations

import re
from collections.abc import Iterable

from matplotlib.figure import Figure
from matplotlib.text import Text

RISK = re.compile(r"risk|fail|promis|missed|collid|touched|bound|% of positions|V \+ R", re.IGNORECASE)
LAW = re.compile(r"independent|coherent|fidelity\.law|full fields|calm air|of this forecast|drawn anew at")
NUMBER = re.compile(r"\d(?![.\d]*\s*(trees|vertices))")
ROUNDED_AWAY = re.compile(r"\b0\.0000")
TICK = re.compile(r"[-−\d.,]+")  # ticks beyond the ends of an axis have a place, but are not drawn
UNITLESS = re.compile(
    r"vertices per tree|plans|hypervolume.*|share.*|correlation|departure, UTC|trees|[βε], .*|"
    r".*elementary scores?"
)
BEYOND_ONE = re.compile(r"\b(?!100 %)[1-9]\d{2,} %")


def texts_of(figure: Figure) -> list[str]:
    """Every text that a figure shows, with plain spaces."""
    figure.canvas.draw()
    shown = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
    return [text.get_text().replace("\N{NO-BREAK SPACE}", " ") for text in shown]


def wrong_texts(texts: Iterable[str]) -> list[str]:
    """Texts with a probability but no wind law, or with one that is rounded away or above 100 %."""
    texts = list(texts)
    lawless = [text for text in texts if RISK.search(text) and NUMBER.search(text) and not LAW.search(text)]
    return lawless + [text for text in texts if ROUNDED_AWAY.search(text) or BEYOND_ONE.search(text)]


def texts_outside(figure: Figure, slack: float = 1.0) -> list[str]:
    """Texts that reach over the edge of the figure by more than ``slack`` pixels."""
    figure.canvas.draw()
    renderer, frame = figure.canvas.get_renderer(), figure.bbox  # type: ignore[attr-defined]
    found = []
    for text in figure.findobj(Text):
        if text.get_visible() and text.get_text().strip() and not TICK.fullmatch(text.get_text()):
            box = text.get_window_extent(renderer)
            within = frame.x0 - slack <= box.x0 and box.x1 <= frame.x1 + slack
            within = within and frame.y0 - slack <= box.y0 and box.y1 <= frame.y1 + slack
            if not within and box.width > 0 and box.x1 > frame.x0 and box.x0 < frame.x1:
                found.append(text.get_text())
    return found


def labels_without_unit(figure: Figure) -> list[str]:
    """Labels of axes and colour bars with numbers that name no unit in brackets."""
    labels = [axis.label.get_text() for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)]
    return [label for label in labels if label and "[" not in label and not UNITLESS.fullmatch(label)]
