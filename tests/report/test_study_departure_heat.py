"""The heat map of departures: numbers, blank cells, the frame of the recommended start."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pareto_ltl_apps.view.study_departure import heat_figure

NAN = float("nan")
LIMITS = np.array([1.0e6, 1.1e6, 1.2e6])
RATES = np.array([[NAN, 0.2, 0.0123], [0.5, 0.3, 0.01], [NAN, NAN, NAN]])


def row(hour: int, **more: Any) -> dict[str, Any]:
    common = {"planned": True, "recommended": False, "as_good": False, "law": "coherent"}
    return {"time": 1539043200.0 + 3600.0 * hour} | common | more


@pytest.fixture(scope="module")
def figure() -> Figure:
    rows = [row(0, recommended=True, as_good=True), row(6, as_good=True), row(30, planned=False, law="")]
    return heat_figure(rows, LIMITS, RATES)


def test_every_cell_with_a_path_has_its_rate_and_the_least_of_a_length_is_bold(figure: Figure) -> None:
    texts = {text.get_position(): text for text in figure.axes[0].texts}
    cells = {place: texts[place].get_text() for place in texts if place[0] in (0, 1) and place[1] >= 1000.0}
    assert cells == {
        (0, 1100.0): "20",
        (0, 1200.0): "1.2",
        (1, 1000.0): "50",
        (1, 1100.0): "30",
        (1, 1200.0): "1.0",
    }
    bold = {place for place in cells if texts[place].get_fontweight() == "bold"}
    assert bold == {(1, 1000.0), (0, 1100.0), (1, 1200.0)}


def test_cells_without_a_path_are_blank(figure: Figure) -> None:
    shown = np.ma.getmaskarray(figure.axes[0].collections[0].get_array())
    np.testing.assert_array_equal(shown.reshape(3, 3), np.isnan(RATES.T))
    assert "no plan" in [text.get_text() for text in figure.axes[0].texts]


def test_the_recommended_start_has_a_frame_and_days_are_named_where_they_change(figure: Figure) -> None:
    (frame,) = [patch for patch in figure.axes[0].patches if isinstance(patch, Rectangle)]
    assert (frame.get_x(), frame.get_width()) == (-0.5, 1.0)
    names = [text.get_text() for text in figure.axes[0].get_xticklabels()]
    assert names == ["00Z\n9 Oct", "06Z", "06Z\n10 Oct"]


def test_many_starts_fit_a_page_without_numbers() -> None:
    rows = [row(3 * k, recommended=k == 4, as_good=k == 4) for k in range(40)]
    figure = heat_figure(rows, LIMITS, np.full((40, 3), 0.1))
    assert figure.get_figwidth() <= 7.17
    assert not [text for text in figure.axes[0].texts if text.get_text() == "10"]
    assert len(figure.axes[0].get_xticklabels()) <= 20
