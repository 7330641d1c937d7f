"""Colours that stand together in one figure, told apart by people who see no red or no green."""

from __future__ import annotations

import re

import matplotlib
import numpy as np
import pytest

from colour_vision import VISIONS, lab, least_distance
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.components import STYLE, component
from pareto_ltl_apps.view.front import LOOKS, OTHERS
from pareto_ltl_apps.view.sweep_figures import SERIES_COLOURS, SERIES_MARKS

LEAST = 15.0  # in CIELAB: 2.3 is just noticeable between large fields, thin lines need several times that


def causes_of_the_page(dark: bool) -> list[str]:
    """Colours of the lines of the risk along the way, as the page has them on light and on dark paper."""
    style_sheet = component(STYLE)
    failed = re.findall(r"--failed: (#[0-9a-f]{6})", style_sheet)
    causes = re.findall(r"--cause-\d: (#[0-9a-f]{6})", style_sheet)
    assert (len(failed), len(causes)) == (2, 8)
    return [failed[dark], *causes[4 * dark : 4 * dark + 4]]


TOGETHER = {
    "flights of both laws, those that failed, the plan": [
        style.law_colour("independent"), style.law_colour("coherent"), style.FAILED, style.BLACK,
    ],
    "mission orders of a front": [*(colour for colour, _ in LOOKS), OTHERS[0]],
    "series of a sweep": list(SERIES_COLOURS),
    "regions, landmarks and wind arrows": [style.GREEN, style.PURPLE, style.SKY, style.BLACK],
    "wind along a route": [style.SKY, style.BLUE, style.VERMILLION],
    "causes of failure on the page": causes_of_the_page(dark=False),
    "causes of failure on the dark page": causes_of_the_page(dark=True),
}  # fmt: skip


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("figure", TOGETHER)
def test_colours_of_one_figure_look_different(figure: str, vision: str) -> None:
    assert least_distance(TOGETHER[figure], vision) > LEAST


def test_colours_that_differ_in_red_and_green_alone_are_found() -> None:
    assert least_distance([style.GREEN, style.STONE], "normal") > 2 * LEAST
    assert least_distance([style.GREEN, style.STONE], "deuteranopia") < LEAST


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("name", ["viridis", "cividis"])
def test_a_colour_map_becomes_lighter_all_the_way(name: str, vision: str) -> None:
    lightness = lab(matplotlib.colormaps[name](np.linspace(0.0, 1.0, 65))[:, :3], vision)[:, 0]
    assert np.diff(lightness).min() > 0.5
    assert np.ptp(lightness) > 60.0


def test_marks_tell_series_apart_without_any_colour() -> None:
    assert len(set(SERIES_MARKS)) == len(SERIES_COLOURS)
    marks = [mark for _, mark in (*LOOKS, OTHERS)]
    assert len(set(marks)) == len(marks)
