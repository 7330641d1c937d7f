"""Parts of the law of errors and their sum, against plain loops over leads and lags."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from careful_io.times import HOUR
from wind_laws.documents import packaged_law
from wind_laws.error_law import GROWING, LASTING, LOCAL, SHORT_TIME_POWER, LawPart

LEADS, SD, MEMORY = (0.0, 6.0, 24.0, 48.0), (0.5, 0.8, 1.5, 1.9), (4.0, 10.0, 30.0, 60.0)  # [h], [m/s], [h]
GFS = packaged_law("gfs")
hours = st.floats(0.0, 100.0)


def part(name: str = GROWING, **changed: object) -> LawPart:
    values = {
        "leads": HOUR * np.array(LEADS),
        "sd": np.array(SD),
        "memory": HOUR * np.array(MEMORY),
        "length": 2e5,
    }
    return LawPart(name, **values | changed)  # type: ignore[arg-type]


def line(x: float, ends: tuple[float, float], values: tuple[float, float]) -> float:
    """The straight line through two points, at x."""
    share = (x - ends[0]) / (ends[1] - ends[0])
    return (1.0 - share) * values[0] + share * values[1]


def passed(lead: float) -> float:
    """∫ dL / memory over leads from 0 on [h], where the memory is that of the nearest lead of the table."""
    total = 0.0
    for k, memory in enumerate(MEMORY):
        begin = 0.0 if k == 0 else (LEADS[k - 1] + LEADS[k]) / 2.0
        end = math.inf if k == len(LEADS) - 1 else (LEADS[k] + LEADS[k + 1]) / 2.0
        total += max(min(lead, end) - begin, 0.0) / memory
    return total


@given(hours)
def test_the_variance_of_a_part_is_linear_between_its_leads_and_beyond(lead: float) -> None:
    k = max(i for i in range(len(LEADS) - 1) if LEADS[i] <= lead)
    expected = line(lead, (LEADS[k], LEADS[k + 1]), (SD[k] ** 2, SD[k + 1] ** 2))
    assert part().variance(np.array(HOUR * lead)) == pytest.approx(expected)


def test_beyond_its_leads_a_variance_does_not_fall_and_a_table_of_one_lead_is_constant() -> None:
    falling = part(sd=np.array([0.5, 0.8, 1.5, 1.0]))
    np.testing.assert_allclose(falling.variance(HOUR * np.array([48.0, 90.0])), 1.0)
    np.testing.assert_allclose(falling.variance(HOUR * np.array([36.0])), (1.5**2 + 1.0) / 2.0)
    single = part(leads=np.zeros(1), sd=np.array([0.7]), memory=np.array([HOUR]))
    np.testing.assert_allclose(single.variance(np.array([0.0, 1e6])), 0.49)
    np.testing.assert_allclose(single.clock(np.array([0.0, 5 * HOUR])), [0.0, 5.0])


@given(hours, hours)
def test_the_correlation_of_a_part_falls_by_the_memory_of_the_nearest_lead(
    begin: float, later: float
) -> None:
    one = part()
    assert one.clock(np.array(HOUR * begin)) == pytest.approx(passed(begin))
    kept = one.persistence(np.array(HOUR * begin), np.array(HOUR * later))
    assert kept == pytest.approx(math.exp(passed(begin) - passed(begin + later)))
    unknown = one.persistence(np.array(np.nan), np.array(HOUR * later))
    assert unknown == pytest.approx(math.exp(-passed(later)))


@given(st.lists(hours, min_size=1, max_size=4), st.floats(0.1, 9.0))
def test_the_covariance_of_a_part_is_made_of_deviations_and_correlations(
    leads: list[float], most: float
) -> None:
    variance = most / (1.0 + np.arange(len(leads)))
    found = part().covariance(HOUR * np.array(leads), variance)
    for i, a in enumerate(leads):
        for j, b in enumerate(leads):
            expected = math.sqrt(variance[i] * variance[j]) * math.exp(-abs(passed(a) - passed(b)))
            assert found[i, j] == pytest.approx(expected)


@pytest.mark.parametrize(
    "changed",
    [
        {"leads": HOUR * np.array([1.0, 6.0, 24.0, 48.0])}, {"leads": HOUR * np.array([0.0, 6.0, 6.0, 48.0])},
        {"sd": np.array([0.5, -0.1, 1.5, 1.9])}, {"sd": np.zeros(4)},
        {"sd": np.array([0.5, np.inf, 1.5, 1.9])},
        {"memory": np.array([1.0, 0.0, 1.0, 1.0])}, {"length": 0.0}, {"sd": np.ones(3)}, {"name": "other"},
    ],
)  # fmt: skip
def test_a_part_that_is_none_is_refused(changed: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"part|memory|sd"):
        part(**changed)  # type: ignore[arg-type]
    part(sd=np.array([0.0, 0.0, 0.0, 0.1]))
    part("forecast")


@given(st.floats(0.01, 500.0))
def test_the_change_is_a_power_of_time_between_the_lags_of_its_table_and_beyond(lag: float) -> None:
    lags, sd = (3.0, 6.0, 24.0), (1.0, 1.5, 4.0)
    law = replace(GFS, lags=HOUR * np.array(lags), change_sd=np.array(sd))
    if lag < lags[0]:
        expected = sd[0] ** 2 * (lag / lags[0]) ** SHORT_TIME_POWER
    else:
        k = 0 if lag < lags[1] else 1
        power = math.log(sd[k + 1] ** 2 / sd[k] ** 2) / math.log(lags[k + 1] / lags[k])
        expected = sd[k] ** 2 * (lag / lags[k]) ** power
    assert law.change_variance(np.array(HOUR * lag)) == pytest.approx(expected)
    falling = replace(law, change_sd=np.array([1.0, 4.0, 2.0]))
    assert falling.change_variance(np.array(HOUR * 400.0)) == pytest.approx(4.0)
    assert law.change_variance(np.array(0.0)) == 0.0


def test_the_shortest_length_is_of_the_change_and_of_all_parts_but_the_local_one() -> None:
    parts = (part(LASTING, length=3e5), part(LOCAL, length=1e4), part(GROWING, length=2e5))
    for change, expected in ((9e5, 2e5), (1e5, 1e5)):
        assert replace(GFS, parts=parts, change_length=change).shortest_length == expected
    total = replace(GFS, parts=parts).forecast_variance(HOUR * np.array([6.0, np.nan]))
    np.testing.assert_allclose(total, [3 * SD[1] ** 2, 0.0])
    for count, floor in ((1, 1 / 2), (64, 1 / 65)):
        assert replace(GFS, situations=count).floor == pytest.approx(floor)
