"""The figure of estimated wind errors: complete, inside its page, the same each time."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure

import forecast_history as history
from figure_texts import labels_without_unit, texts_of, texts_outside
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.wind_error import draw_wind_error, wind_error_figure
from pareto_ltl_apps.wind_errors.error_estimate import ErrorEstimate, estimate_errors, estimated_law
from pareto_ltl_apps.wind_errors.matched_fields import Resampling
from wind_laws.documents import first_law

USUAL = first_law()
HISTORIES = {
    "direct": history.direct_history(1, cycles=14),
    "asymmetric": history.asymmetric_history(1, cycles=14),
    "analyses": [snap for snap in history.direct_history(1, cycles=14) if snap.lead == 0],
}


@pytest.fixture(scope="module", params=HISTORIES)
def estimate(request: pytest.FixtureRequest) -> ErrorEstimate:
    return estimate_errors(HISTORIES[request.param], None, Resampling())


def drawn(estimate: ErrorEstimate) -> Figure:
    with style.report_style():
        return wind_error_figure(estimate, estimated_law(estimate, "made", USUAL), USUAL)


def test_every_text_lies_on_the_page_and_every_estimate_is_drawn(estimate: ErrorEstimate) -> None:
    figure = drawn(estimate)
    assert texts_outside(figure) == []
    assert labels_without_unit(figure) == []
    texts = " ".join(texts_of(figure))
    assert estimate.change_length.length is not None
    assert f"change: {estimate.change_length.length.value / 1e3:.0f} km" in texts
    assert ("no forecast can be" in texts) == (estimate.forecast is None)
    assert ("error: not in the data" in texts) == (estimate.forecast_length.length is None)
    marks = [line for line in figure.axes[1].lines if line.get_marker() == "o" and len(line.get_xdata())]  # type: ignore[arg-type]
    assert len(marks) == len(estimate.change.sd)


def test_equal_estimates_give_equal_files(estimate: ErrorEstimate, tmp_path: Path) -> None:
    law = estimated_law(estimate, "made", USUAL)
    one = draw_wind_error(tmp_path, "one", estimate, law, USUAL)
    two = draw_wind_error(tmp_path, "two", estimate, law, USUAL)
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]
