"""What limits a plan: the same rows in text, page and figure, from the numbers of the plan."""

from __future__ import annotations

import html
import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection

import pareto_ltl
from careful_io.texts import probability_text
from drawn_world import path_of, plan_of, run_records, scene_of
from figure_texts import labels_without_unit, texts_of, texts_outside, wrong_texts
from flight_quantities.medium import AIR, WATER, Medium
from pareto_ltl.planning.limits import Price, SegmentLimits
from pareto_ltl.planning.records import Plan
from pareto_ltl.support.display import allowed_text
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.figures import draw_run_figures
from pareto_ltl_apps.view.limits import (
    NO_PRICES,
    NO_SEGMENTS,
    PlanLimits,
    priced_obstacles,
    saving_of,
    small_change,
    speed_change,
)
from pareto_ltl_apps.view.page.content import page_bytes, page_content
from pareto_ltl_apps.view.plan_maps import BARS, limits_figure
from pareto_ltl_apps.view.records import DrawnRun, ShownRun
from pareto_ltl_apps.view.settings import ReportConfig
from quick_plan import QUICK_SEARCH

HOSTILE = "<img src=x onerror=alert(1)>&\"' $x_1$"
PRICES = (
    Price("obstacle", "obstacle 6", 18, 2.7e-6), Price("obstacle", "obstacle 3", 18, 2.1e-6),
    Price("border", "the eastern border", 32, 5e-7), Price("region", "b", 26, 3.7e-7),
    Price("avoided", "a and c", 14, 3e-7), Price("obstacle", "obstacle 1", 6, 4e-8),
    Price("airspeed", "largest airspeed", None, 0.008), Price("length", "length", None, 1e-7),
)  # fmt: skip


def limits_of_steps(steps: int) -> SegmentLimits:
    """Probabilities that fall from 4.8 % to a negligible number, and prices at a few of the segments."""
    probability = 0.048 * 10.0 ** -np.linspace(0.0, 30.0, steps)
    price = np.zeros(steps)
    price[[0, 7, 20]] = [1e-6, 1e-8, 3e-7]
    names = tuple("obstacle 6" if k % 2 else "the eastern border" for k in range(steps))
    return SegmentLimits(names, np.linspace(1.7, 40.0, steps), probability, price)


def limited_plan(**changes: Any) -> Plan:
    plan = plan_of(path_of(scene_of()))
    return replace(plan, **({"limits": limits_of_steps(len(plan.path.u)), "prices": PRICES} | changes))


def told(plan: Plan, medium: Medium = AIR) -> PlanLimits:
    return PlanLimits(scene_of(), plan, medium)


def places_of(limits: PlanLimits) -> dict[int, list[str]]:
    return {place["step"]: place["lines"] for place in limits.places()}


class Cells(HTMLParser):
    """The text of each cell of the bodies of the tables with an id, row by row."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: dict[str, list[list[str]]] = {}
        self.images = 0
        self._row: list[str] | None = None
        self._name = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.images += tag == "img"
        if tag == "table":
            self._name = dict(attrs).get("id") or ""
        if tag == "tr":
            self._row = []
            self.rows.setdefault(self._name, []).append(self._row)
        if tag in ("td", "th") and self._row is not None:
            self._row.append("")

    def handle_data(self, data: str) -> None:
        if self._row:
            self._row[-1] += data

    def handle_endtag(self, tag: str) -> None:
        if tag == "tr":
            self._row = None


def page_of(run: ShownRun) -> str:
    return page_bytes(page_content(run)).decode()


def places_in(page: str) -> list[dict[str, Any]]:
    found = re.findall(r'<script type="application/json" id="page-data">(.*?)</script>', page, re.DOTALL)
    places: list[dict[str, Any]] = json.loads(found[0])["places"]
    return places


# --- rows ---------------------------------------------------------------------------------------


def test_a_small_change_is_a_power_of_ten_that_is_small_on_the_map() -> None:
    for scale, change in ((1e5, 1000.0), (1e4, 100.0), (25.0, 0.1)):
        assert small_change(scene_of(scale=scale)) == pytest.approx(change)


def test_prices_are_listed_by_what_a_small_change_saves() -> None:
    rows = told(limited_plan()).prices()
    wanted = [
        ("obstacle 6", "09:00Z", "1 km smaller on every side", 2.7e-3),
        ("largest airspeed", "", "1 km/h more", 0.008 / 3.6),
        ("obstacle 3", "09:00Z", "1 km smaller on every side", 2.1e-3),
        ("the eastern border", "16:00Z", "1 km farther out", 5e-4),
        ("region b", "13:00Z", "1 km larger on every side", 3.7e-4),
        ("region a and c", "07:00Z", "1 km smaller on every side", 3e-4),
        ("length", "", "1 km more", 1e-4),
        ("obstacle 1", "03:00Z", "1 km smaller on every side", 4e-5),
    ]
    assert [(row.limit, row.time, row.change) for row in rows] == [row[:3] for row in wanted]
    np.testing.assert_allclose([row.saving for row in rows], [row[3] for row in wanted])


def test_the_segments_with_the_largest_probabilities_are_listed() -> None:
    plan = limited_plan()
    assert plan.limits is not None
    turned = replace(plan.limits, probability=plan.limits.probability[::-1])
    rows = told(replace(plan, limits=turned)).segments(3)
    assert [row.step for row in rows] == [44, 43, 42]
    assert (rows[0].begin, rows[0].end) == ("22:00Z", "22:30Z")
    assert rows[0].barrier == turned.nearest[44]


def test_a_place_is_tight_by_its_price_or_by_its_probability() -> None:
    plan = limited_plan()
    assert plan.limits is not None
    risk = plan.limits.probability
    assert risk[1] > 0.1 * plan.epsilon > risk[2]
    places = places_of(told(plan))
    assert list(places) == [0, 1, 20]
    assert places[0] == [
        "the eastern border, 00:00Z to 00:30Z",
        "collides 4.8 % of 5.0 % allowed, independent winds",
        "all barriers 1 km farther: 0.10 points fewer failures",
    ]
    assert len(places[1]) == 2
    unlimited = places_of(told(replace(plan, epsilon=1.0)))
    assert list(unlimited) == [0, 20]
    assert unlimited[0][1] == "collides 4.8 %, without a limit, independent winds"


def test_obstacles_with_a_price_are_known_by_their_number() -> None:
    assert priced_obstacles(limited_plan()) == [6, 3, 1]


def test_a_price_with_a_large_error_is_counted_and_not_shown(shown: ShownRun) -> None:
    plan, scene = limited_plan(), scene_of()
    errors = [0.26 * row.saving if row.name == "obstacle 3" else 0.24 * row.saving for row in PRICES]
    prices = tuple(replace(row, error=error) for row, error in zip(PRICES, errors, strict=True))
    unsure = replace(plan, prices=prices)
    assert [row.limit for row in told(unsure).prices()] == [
        row.limit for row in told(plan).prices() if row.limit != scene.barrier_title("obstacle 3")
    ]
    assert [row.error / row.saving for row in told(unsure).prices()] == pytest.approx([0.24] * 7)
    assert priced_obstacles(unsure) == [6, 1]
    text = "not shown, with a standard error above a quarter of the price: 1 of 8"
    assert list(told(unsure).lines())[-1] == text
    assert text not in list(told(plan).lines())
    assert text[1:] in page_of(replace(shown, plan=unsure))
    none = replace(plan, prices=tuple(replace(row, error=row.saving) for row in PRICES))
    assert list(told(none).lines())[-1] == text.replace("1 of", "8 of")
    assert list(told(none).lines())[-2] == ""


def test_text_says_what_the_rows_say_and_what_is_missing() -> None:
    plan = limited_plan()
    lines = list(told(plan).lines())
    assert "independent winds: 4.8 % of 5.0 % allowed (planner.epsilon)" in lines[0]
    closest = "0  00:00Z - 00:30Z; the eastern border, 1.7 standard deviations away; 4.8 %"
    assert lines[1].strip() == closest
    assert lines[-5].strip() == "obstacle 6 at 09:00Z: 1 km smaller on every side, 0.27 points fewer failures"
    assert list(told(replace(plan, limits=None, prices=())).lines()) == [NO_SEGMENTS, "", NO_PRICES]
    assert "without a limit (planner.epsilon)" in next(told(replace(plan, epsilon=1.0)).lines())


# --- page ---------------------------------------------------------------------------------------


def test_both_tables_of_the_page_have_the_numbers_of_the_plan(shown: ShownRun) -> None:
    plan = shown.plan
    assert plan is not None
    assert plan.limits is not None
    cells, unit = Cells(page_of(shown)), small_change(shown.scene)
    prices = [price for price in plan.prices if price.significant]
    savings = sorted((saving_of(price, unit) for price in prices), reverse=True)
    rows = cells.rows["prices"][1:]
    assert [row[3] for row in rows] == [probability_text(saving)[:-2] for saving in savings]
    assert {row[0].removeprefix("region ") for row in rows} == {price.name for price in prices}
    for row in rows:
        price = next(p for p in prices if p.name == row[0].removeprefix("region "))
        assert row[1] == ("–" if price.step is None else f"{plan.navigation.time_utc[price.step][11:16]}Z")
        assert ("km/h" in row[2]) == (price.kind == "airspeed")
    largest = np.sort(plan.limits.probability)[::-1][:5]
    segments = cells.rows["segments"][1:]
    assert [row[3:] for row in segments] == [[probability_text(p), "5.0 %"] for p in largest]
    step = int(plan.limits.probability.argmax())
    assert segments[0][1] == plan.limits.nearest[step]
    assert segments[0][2] == f"{plan.limits.deviations[step]:.1f}"
    assert cells.rows["segments"][0][3] == f"collides, {plan.models.law} winds"


def test_tight_places_of_the_page_are_those_of_the_plan(shown: ShownRun) -> None:
    assert shown.plan is not None
    places = places_in(page_of(shown))
    assert places == PlanLimits(shown.scene, shown.plan, AIR).places()
    assert places


def test_a_page_without_limits_says_so(shown: ShownRun) -> None:
    assert shown.plan is not None
    page = page_of(replace(shown, plan=replace(shown.plan, limits=None, prices=())))
    assert "What limits it" in page
    assert {"prices", "segments"}.isdisjoint(Cells(page).rows)
    for sentence in (NO_SEGMENTS, NO_PRICES):
        assert f"{sentence[0].upper()}{sentence[1:]}." in html.unescape(page)
    assert places_in(page) == []
    assert "limits-title" not in page_of(replace(shown, plan=None))


def test_names_in_limits_are_never_markup(shown: ShownRun) -> None:
    assert shown.plan is not None
    assert shown.plan.limits is not None
    limits = replace(shown.plan.limits, nearest=(HOSTILE,) * len(shown.plan.path.u))
    prices = (Price("region", HOSTILE, 3, 1e-6),)
    page = page_of(replace(shown, plan=replace(shown.plan, limits=limits, prices=prices)))
    cells = Cells(page)
    assert "<img" not in page
    assert cells.images == 0
    assert cells.rows["prices"][1][0] == f"region {HOSTILE}"
    assert cells.rows["segments"][1][1] == HOSTILE
    assert places_in(page)[0]["lines"][0].startswith(HOSTILE)


# --- figure -------------------------------------------------------------------------------------


def figure_of(plan: Plan, **changes: Any) -> Any:
    with style.report_style():
        return limits_figure(DrawnRun(**(run_records() | {"plan": plan} | changes)), plan)


def test_bars_have_the_savings_and_the_names_of_the_largest_prices() -> None:
    figure = figure_of(limited_plan())
    bars = figure.axes[-1].patches
    rows = told(limited_plan()).prices(BARS)
    assert len(bars) == len(rows) == BARS
    np.testing.assert_allclose([bar.get_width() for bar in bars], [100.0 * row.saving for row in rows])
    heights = [bar.get_y() for bar in bars]
    assert heights == sorted(heights, reverse=True)
    texts = texts_of(figure)
    for row in rows:
        assert row.change in texts
        assert f"{row.limit.removeprefix('the ')}" + f", {row.time}" * bool(row.time) in texts


def test_the_path_has_the_colours_of_its_probabilities_between_the_ends_of_the_scale() -> None:
    plan = limited_plan()
    assert plan.limits is not None
    figure = figure_of(plan)
    coloured = [
        layer for layer in figure.axes[0].collections
        if isinstance(layer, LineCollection) and layer.get_array() is not None
    ]  # fmt: skip
    (segments,) = coloured
    wanted = np.clip(plan.limits.probability, 1e-3 * plan.epsilon, plan.epsilon)
    lines = np.array(segments.get_segments())
    for line, value in zip(lines, segments.get_array(), strict=True):
        step = int(np.argmin(np.abs(plan.path.x[:-1] - line[0]).sum(axis=1)))
        assert value == pytest.approx(wanted[step])
    texts = texts_of(figure)
    assert {"≤ 0.005", "0.05", "0.5", "5 (limit)"} <= set(texts)
    assert {"6", "3", "1"} <= set(texts)  # obstacles with a price
    assert {"2", "4", "5"}.isdisjoint(texts)
    above = replace(plan, limits=replace(plan.limits, probability=2.0 * plan.limits.probability))
    assert "≥ 5 (limit)" in texts_of(figure_of(above))


def test_a_plan_far_from_its_limits_has_a_sentence_in_place_of_a_scale() -> None:
    plan = limited_plan()
    assert plan.limits is not None
    far = replace(plan, prices=(), limits=replace(plan.limits, probability=1e-9 * plan.limits.probability))
    figure = figure_of(far)
    assert len(figure.axes) == 1
    text = " ".join(" ".join(texts_of(figure)).split())
    most = allowed_text(1e-9 * plan.limits.probability.max(), plan.epsilon).partition(" of")[0]
    assert f"No segment comes near its limit: likeliest collision {most}" in text


LONG = Price("region", "a_region_with_a_very_long_name_indeed", 40, 3e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {}, {"fidelity": "full"}, {"limits": None}, {"prices": ()}, {"epsilon": 1.0},
        {"prices": (LONG, *PRICES)}, {"prices": (Price("region", HOSTILE, 40, 1e-12),)},
        {"formula": "F(" + "a" * 200 + ")"},
    ],
    ids=["paper", "full", "no segments", "no prices", "no epsilon", "long name", "markup", "long formula"],
)  # fmt: skip
def test_every_text_of_the_figure_names_its_law_and_stays_on_the_page(changes: dict[str, Any]) -> None:
    figure = figure_of(limited_plan(**changes))
    assert wrong_texts(texts_of(figure)) == []
    assert texts_outside(figure) == []
    assert labels_without_unit(figure) == []
    assert figure.get_figwidth() == style.COLUMN_WIDTH


def test_texts_beside_bars_do_not_overlap() -> None:
    figure = figure_of(limited_plan(prices=(LONG, *PRICES), fidelity="full"), scene=scene_of(crs=None))
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    boxes = [text.get_window_extent(renderer) for text in figure.axes[-1].texts]
    assert len(boxes) == 3 * BARS
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_only_a_plan_with_limits_or_prices_has_the_figure(tmp_path: Path) -> None:
    records = run_records()
    cases = {
        "both": (limited_plan(), True), "prices": (limited_plan(limits=None), True),
        "limits": (limited_plan(prices=()), True), "neither": (records["plan"], False), "none": (None, False),
    }  # fmt: skip
    for name, (plan, wanted) in cases.items():
        files = draw_run_figures(
            tmp_path / name, ReportConfig(dpi=40), DrawnRun(**(records | {"plan": plan}))
        )
        assert ("limits.png" in {file.name for file in files}) == wanted
        assert (tmp_path / name / "limits.png").exists() == wanted


def test_the_change_of_airspeed_is_one_kilometre_per_hour() -> None:
    assert math.isclose(saving_of(Price("airspeed", "largest airspeed", None, 3.6), 1000.0), 1.0)


@pytest.mark.parametrize(
    ("u_max", "change", "words"),
    [
        (20.0, 1 / 3.6, "1 km/h"),
        (0.35, 0.01, "0.01 m/s"),
        (1.0, 0.01, "0.01 m/s"),
        (0.25, 0.001, "0.001 m/s"),
    ],
)
def test_the_change_of_a_slow_robot_is_small_for_its_speed(u_max: float, change: float, words: str) -> None:
    assert speed_change(u_max) == (pytest.approx(change), words)
    assert change <= 0.1 * u_max
    plan = replace(limited_plan(), u_max=u_max)
    (row,) = [row for row in told(plan, WATER).prices() if row.kind == "airspeed"]
    assert row.limit == "largest speed through the water"
    assert row.change == f"{words} more"
    assert math.isclose(row.saving, 0.008 * change)
    lines = "\n".join(told(plan, WATER).lines())
    assert "currents" in lines
    assert not any(word in lines for word in ("wind", "airspeed"))


OPEN = {
    "bounds": [[0, 0], [1e6, 1e6]],
    "start": [1e5, 1e5],
    "regions": {"a": [[4e5, 4e5], [7e5, 4e5], [7e5, 7e5], [4e5, 7e5]]},
}


def test_a_run_on_an_open_map_without_obstacles_has_a_page_and_no_figure_of_limits(tmp_path: Path) -> None:
    few = {"planner": {"trees": 1, "n_max": 400}, "deployment": {"runs": 5}, "report": {"dpi": 30}}
    few |= QUICK_SEARCH
    fidelity = {"border": "open"}
    exact = dict.fromkeys(("airspeed_sd", "heading_sd", "clock_sd"))
    made = pareto_ltl.plan(
        OPEN, "F a", out=tmp_path / "run", wind="calm", fidelity=fidelity, robot=exact, **few
    )
    assert (made.plan.limits, made.plan.prices) == (None, ())
    assert "No segment is limited" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    names = {path.name for path in (tmp_path / "run" / "figures").iterdir()}
    assert names == {"plan.png", "front.png", "wind.png"}
