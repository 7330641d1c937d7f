"""The figure of a front of failure rates: what is drawn where, and what tells orders apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_hex

from drawn_world import front_of, plan_of, scene_of
from figure_texts import texts_of, texts_outside, wrong_texts
from pareto_ltl.extend import FailureRate
from pareto_ltl.planning.rates import Promise
from pareto_ltl.planning.records import Front, Plan
from pareto_ltl.settings import preset
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.front import flown_front_figure, order_looks, rate_ends
from pareto_ltl_apps.view.records import DrawnRun

COUNTS, ORDERS = (40, 80, 160, 320), ("a>b>c", "a>b>c", "a>d>c", "b>a>c")


def flown_front(counts=COUNTS, orders=ORDERS, law: str = "coherent") -> Front:
    """Paths of 2,000 km, 1,900 km, ... whose flights fail so often."""
    base = front_of(scene_of()).paths[0]
    paths = tuple(
        replace(
            base,
            origin=str(k),
            order=order,
            objectives=replace(base.objectives, costs={"length": 2e6 - 1e5 * k}),
        )
        for k, order in enumerate(orders)
    )
    rates = tuple(FailureRate.counted(law, count, 4000) for count in counts)
    failed = np.zeros((len(counts), 4000), bool)
    raw = (replace(base.objectives, costs={"length": 2.2e6}),)
    return Front(
        paths, raw, 0.5, np.ones(2), rates, (FailureRate.counted(law, 100, 500),), failed, preset("full")
    )


def plan_on(front: Front, k: int) -> Plan:
    promise = Promise(FailureRate.counted("coherent", 380, 20_000), front.rates[k], 0.4, 0.1, True)
    return replace(plan_of(front.paths[k]), promise=promise)


def drawn(front: Front, plan: Plan | None = None):
    with style.report_style():
        figure = flown_front_figure(DrawnRun(scene_of(), plan=plan), front)
        figure.canvas.draw()
    return figure


def lines_at(figure, x: float):
    """The lines of the axes that stand at ``x``, upright."""
    return [
        line for line in figure.axes[0].lines if len(line.get_xdata()) == 2 and (line.get_xdata() == x).all()
    ]


def test_every_path_is_a_point_at_its_length_and_rate_with_its_interval() -> None:
    front = flown_front()
    figure = drawn(front)
    for rate, path in zip(front.rates, front.paths, strict=True):
        x = 1e-3 * path.objectives.length
        points = [
            line for line in figure.axes[0].lines
            if len(line.get_xdata()) == 1 and line.get_xdata()[0] == x and line.get_ydata()[0] == rate.failure
        ]  # fmt: skip
        assert len(points) == 1
        (bar,) = lines_at(figure, x)
        assert bar.get_ydata().tolist() == [rate.low, rate.high]
    assert figure.axes[0].get_yscale() == "log"


def test_the_front_is_one_line_from_the_shortest_path_on() -> None:
    front = flown_front()
    (line,) = [line for line in drawn(front).axes[0].lines if len(line.get_xdata()) == 4]
    assert line.get_xdata().tolist() == sorted(1e-3 * p.objectives.length for p in front.paths)
    assert line.get_ydata().tolist() == [rate.failure for rate in front.rates[::-1]]


def test_the_ring_is_about_the_claim_and_the_promise_at_the_length_of_the_plan() -> None:
    front = flown_front()
    plan = plan_on(front, 1)
    figure = drawn(front, plan)
    marked = [line for line in figure.axes[0].lines if to_hex(line.get_color()) == style.VERMILLION.lower()]
    bar = next(line for line in marked if len(line.get_xdata()) == 3)
    assert plan.promise is not None
    rate = plan.promise.rate
    assert bar.get_ydata().tolist() == [rate.low, rate.failure, rate.high]
    assert set(bar.get_xdata()) == {1900.0}
    assert bar.get_transform() == figure.axes[0].transData
    rings = [line for line in figure.axes[0].lines if line.get_markerfacecolor() == "none"]
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in rings] == [(1900.0, 0.02)]
    said = texts_of(figure)
    assert "its 20,000 fresh flights" in said
    assert "chosen plan" not in texts_of(drawn(front))


def test_mission_orders_have_colours_and_marks_of_their_own() -> None:
    front = flown_front()
    figure = drawn(front)
    looks = order_looks(ORDERS[::-1])  # from the shortest path on
    assert len(set(looks.values())) == 3
    for path in front.paths:
        (point,) = [
            line for line in figure.axes[0].lines
            if len(line.get_xdata()) == 1 and line.get_xdata()[0] == 1e-3 * path.objectives.length
        ]  # fmt: skip
        assert (point.get_markerfacecolor(), point.get_marker()) == looks[path.order]
    assert {"a → b → c", "a → d → c", "b → a → c"} <= set(texts_of(figure))


def test_orders_beyond_the_fifth_share_a_look() -> None:
    orders = [f"a>{letter}" for letter in "bcdefgh"]
    front = flown_front(range(10, 80, 10), orders)
    said = texts_of(drawn(front))
    assert said.count("other orders") == 1
    assert "a → h" in said  # the shortest path
    assert "a → b" not in said


@pytest.mark.parametrize("law", ["coherent", "independent"])
@pytest.mark.parametrize(
    "counts", [COUNTS, (0, 0, 1, 2), (0, 0, 0, 0), (4000, 4000, 4000, 4000), (0, 1, 2000, 4000)]
)
def test_texts_name_the_law_and_stay_on_the_page(counts: tuple[int, ...], law: str) -> None:
    long = ("a>b>c", ">".join("a_region_with_a_long_name" for _ in range(9)), "", "$x$>_y_")
    front = flown_front(counts, long, law)
    figure = drawn(front, plan_on(front, 0))
    assert f"failed flights, {law} winds [%]" in texts_of(figure)
    assert wrong_texts(texts_of(figure)) == []
    assert texts_outside(figure) == []
    low, high = figure.axes[0].get_ylim()
    assert low <= min((r.failure for r in front.rates if r.failure), default=1.0)
    assert high >= max(r.high for r in front.rates)
    assert any(text.startswith("≤ ") for text in texts_of(figure)) == (min(counts) == 0)


@given(st.lists(st.integers(0, 4000), min_size=1, max_size=6))
def test_the_axis_holds_all_rates(counts: list[int]) -> None:
    rates = [FailureRate.counted("coherent", count, 4000) for count in counts]
    rows = np.array([[rate.failure, rate.low, rate.high] for rate in rates])
    low, high, hidden = rate_ends(rows)
    assert 0.0 < low < high <= 1.0
    assert hidden == (0 in counts)
    assert low <= min([row[1] for row in rows if row[1] >= 1e-6], default=1.0)
    assert high >= rows[:, 2].max()


def test_the_line_of_a_front_with_a_further_cost_has_no_comb() -> None:
    front = flown_front()
    (line,) = [line for line in drawn(front).axes[0].lines if to_hex(line.get_color()) == style.STONE.lower()]
    assert (np.diff(line.get_xdata()) > 0).all()
    assert (np.diff(line.get_ydata()) < 0).all()
    worse = replace(front.rates[0], failure=0.9, low=0.8, high=0.95)
    mixed = replace(front, rates=(worse, *front.rates[1:]))
    (line,) = [line for line in drawn(mixed).axes[0].lines if to_hex(line.get_color()) == style.STONE.lower()]
    assert len(line.get_xdata()) == len(front.paths) - 1


def test_points_of_the_trees_do_not_widen_the_axis_of_lengths() -> None:
    front = flown_front()
    ends = drawn(front).axes[0].get_xlim()
    far = [replace(cost, costs={"length": 9e9}) for cost in front.raw]
    figure = drawn(replace(front, raw=tuple(far)))
    assert figure.axes[0].get_xlim() == ends
    assert f"trees alone: all {len(front.raw_rates)} are longer" in texts_of(figure)
