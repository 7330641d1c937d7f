"""The judge's own wind law against the planner's: two roads, one answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pareto_ltl.planning import pack
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl.wind.named_laws import law_of_parts_named
from pareto_ltl.wind.netcdf import write_netcdf
from pareto_ltl.wind.records import WindField, WindObservations
from pareto_ltl_verify import wind_fit, wind_law
from pareto_ltl_verify.claims import wind_modes
from pareto_ltl_verify.wind_law import HOUR, error_law
from pareto_ltl_verify.wind_tables import clock, read_wind_file
from wind_laws import gp
from wind_laws.documents import first_law
from wind_laws.error_law import PART_NAMES, ErrorLaw, LawPart
from wind_laws.forecast_error import ForecastError
from wind_laws.law_of_parts import LawOfParts
from wind_laws.modes import error_persistence
from wind_laws.records import FORECAST_PARTS, SPACE, TIME, WindModes
from wind_laws.tables import time_variances

DT = 1800.0
PARTS_OF_MODES = np.array([SPACE, FORECAST_PARTS["lasting"], TIME, -1])
tables = st.integers(1, 5).flatmap(
    lambda n: st.tuples(
        *(st.lists(st.floats(0.5, 20.0), min_size=n, max_size=n) for _ in range(2)),
        *(st.lists(st.floats(0.1, 9.0), min_size=n, max_size=n) for _ in range(2)),
    )
)


@st.composite
def first_laws(draw: st.DrawFn) -> ForecastError:
    """Any law of forecast errors of version 1, whose tables need not even grow."""
    steps, lags, sd, change = map(np.array, draw(tables))
    leads = HOUR * np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    return replace(
        first_law(), leads=leads, forecast_sd=sd, lags=HOUR * np.cumsum(lags),
        change_sd=change, persistence=draw(st.floats(0.0, 1.0)),
    )  # fmt: skip


@st.composite
def laws_of_parts(draw: st.DrawFn) -> LawOfParts:
    """Any law of parts, whose tables and memories need not even grow."""
    parts = []
    for name in draw(st.lists(st.sampled_from(PART_NAMES), min_size=1, max_size=4, unique=True)):
        steps, sd, memory, _ = map(np.array, draw(tables))
        leads = HOUR * np.concatenate([[0.0], np.cumsum(steps)[:-1]])
        lasts = np.array(draw(st.lists(st.booleans(), min_size=len(leads), max_size=len(leads))))
        memory = np.where(lasts, np.inf, HOUR * memory)
        parts.append(LawPart(name, leads, sd, memory, draw(st.floats(2e4, 1e6))))
    return replace(law_of_parts_named("gfs"), parts=tuple(parts))


def laws() -> st.SearchStrategy[ForecastError | LawOfParts]:
    """Any law of forecast errors, of both versions."""
    return first_laws() | laws_of_parts()


def field(
    law: ErrorLaw | None, times: FloatArray, until: float, leads: FloatArray | None = None
) -> WindField:
    """A field without readings that changes under ``law``."""
    rng = np.random.default_rng(1)
    mean = rng.normal(size=(len(times), 3, 3, 2))
    modes = WindModes(
        np.zeros(2), 5e5, rng.normal(size=(len(times), 2, 2, 2, 4)).astype(np.float32),
        PARTS_OF_MODES, 0.7, 10_800.0, np.full((len(times), 2), 4e5), np.ones((len(times), 2)),
        rest_length=4e4,
    )  # fmt: skip
    gust = np.ones((len(times), 2))
    known = {} if leads is None else {"leads": leads}
    return WindField(np.zeros(2), 5e5, times, mean, mean**2, gust, until, modes=modes, error=law, **known)


def judged(law: ErrorLaw) -> wind_law.ErrorLaw:
    return error_law(law.document())


@given(laws(), st.just(0.0) | st.floats(1e-3, 1e6), st.floats(0.0, 1.0), st.floats(1.0, 1e6))
@settings(deadline=None)
def test_the_judge_has_the_planners_law_of_errors(
    law: ErrorLaw, time: float, share: float, gap: float
) -> None:
    own = judged(law)
    assert own.shortest_length == law.shortest_length
    pairs = [
        (own.forecast_variance(np.array([time, np.nan])), law.forecast_variance(np.array([time, np.nan]))),
        (own.change_variance(time), law.change_variance(np.array([time]))[0]),
        (own.change_correlation(time, gap), law.change_correlation(time, gap)),
    ]
    for found, wanted in pairs:
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-9)
    between = law.between_variance(np.array([share]), np.array([gap]))[0]
    size = law.change_variance(np.array([gap, share * gap, (1 - share) * gap])).sum()
    assert own.between_variance(share * gap, gap) == pytest.approx(between, abs=1e-9 + 1e-6 * size)
    for mine, part in zip(own.parts, law.parts, strict=True):
        for lead in (time, np.nan):
            kept = float(part.persistence(np.array(lead), np.array(gap)))
            assert mine.kept(lead, gap) == pytest.approx(kept, rel=1e-6, abs=1e-9)


@given(
    laws(), st.lists(st.sampled_from([1.0, 3.0, 5.5, 6.0]), max_size=5), st.sampled_from([0.0, 3.0, 7.5]),
    st.sampled_from([None, 0.0, 9.0]),
)  # fmt: skip
@settings(deadline=None, max_examples=30)
def test_the_judge_has_the_planners_clock(
    tmp_path_factory: pytest.TempPathFactory, law: ErrorLaw, gaps: list[float], held: float,
    first_lead: float | None,
) -> None:  # fmt: skip
    times = HOUR * np.concatenate([[-1.0], np.cumsum(gaps)])
    leads = None if first_lead is None else times - times[0] + HOUR * first_lead
    told = field(law, times, float(times[-1]) + HOUR * held, leads)
    if told.known_until < DT:
        return
    wind = pack.pack_wind(told, DT, 40)
    modes = pack.pack_modes(told, wind, DT, 30.0)
    steps = len(wind.slot)
    path = write_netcdf(told, tmp_path_factory.mktemp("wind") / "wind.nc")
    own = clock(read_wind_file(path), DT, steps, 40)
    assert own.known == steps
    assert own.nearest[:steps].tolist() == modes.slot.tolist()
    np.testing.assert_allclose(own.between[:steps], wind.between, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(own.keep[:steps], modes.keep[:steps], rtol=1e-6, atol=1e-9)


def test_a_plan_that_outlasts_the_wind_has_no_clock(tmp_path: Path) -> None:
    wind = read_wind_file(write_netcdf(field(None, np.array([0.0, 3600.0]), 3600.0), tmp_path / "wind.nc"))
    assert len(clock(wind, DT, 3, 99).slot) == 4
    with pytest.raises(DataError, match="until 3600 s after departure, but the plan needs it at 5400 s"):
        clock(wind, DT, 4, 99)


@pytest.mark.parametrize("same_places", [True, False])
@pytest.mark.parametrize("kernel", ["matern12", "matern32", "rbf"])
def test_the_judge_has_the_planners_factor_and_persistence(kernel: str, same_places: bool) -> None:
    rng = np.random.default_rng(4)
    times = 10_800.0 * np.arange(6)
    first = rng.uniform(-5e5, 5e5, (30, 2))
    points = [first if same_places or k % 2 else first[: 20 + k] for k in range(len(times))]
    steady = rng.normal(size=(30, 2))
    winds = [3 * steady[: len(p)] + rng.normal(size=p.shape) for p in points]
    hyper, means = gp.Hyper(3.0, 4e5, 0.8), np.stack([w.mean(axis=0) for w in winds])
    residuals = gp.leave_one_out(kernel, points, winds, hyper, means)
    anchors, squares = gp.squared_residuals(points, residuals)
    posterior = gp.WindPosterior(
        times,
        tuple(points),
        tuple(winds),
        kernel,
        hyper,
        means,
        {},
        residuals,
        anchors,
        squares,
    )
    table = np.concatenate([means[..., None], np.broadcast_to(hyper, (*means.shape, 3))], axis=-1)
    own = wind_fit.Fit(points, winds, table, kernel)
    places = rng.uniform(-7e5, 7e5, (50, 2))
    np.testing.assert_allclose(own.factor(places), posterior.variance_factor(places), rtol=1e-5)
    _, wanted = posterior.at(places)
    _, V = wind_fit.posterior(own, 2, 1, places)
    latent = wind_fit.scaled(9.0 - (V * V).sum(axis=0), 0.8, own.factor(places))
    np.testing.assert_allclose(latent, wanted[2, :, 1], rtol=1e-5, atol=1e-6)
    assert 0.3 < error_persistence(posterior) < 1.0
    assert wind_fit.persistence(own, times) == pytest.approx(error_persistence(posterior), rel=1e-5)


@pytest.mark.parametrize(("until", "horizon"), [(75_600.0, 1e9), (97_200.0, 1e9), (97_200.0, 90_000.0)])
def test_the_judge_averages_interpolation_in_time_as_the_planner(
    until: float, horizon: float, tmp_path: Path
) -> None:
    law = first_law()
    times = np.array([0.0, 10_800.0, 32_400.0, 54_000.0, 75_600.0])
    nothing = (np.empty((0, 2)),) * len(times)
    wanted = time_variances(WindObservations(times, nothing, nothing, "", until=until, error=law), horizon)
    wind = read_wind_file(write_netcdf(field(law, times, until), tmp_path / "wind.nc"))
    own = wind_modes.time_variances(wind, judged(law), horizon)
    np.testing.assert_allclose(own, wanted, rtol=5e-3)
    assert (own > 0).all()
