"""The forecast test: what planning knows, what it is flown through, and what is made of both."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from careful_io.times import seconds
from figure_texts import labels_without_unit, texts_of, texts_outside, wrong_texts
from flight_quantities import frames
from forecast_winds import AREA, HOUR, NODES, calm, context_of, settings, snapshots
from noaa import NOAA, needs_noaa
from pareto_ltl.extend import Frame, Study
from pareto_ltl.support.errors import DataError, InfeasibleError
from pareto_ltl_apps.cli import hydra_app as app
from pareto_ltl_apps.studies import forecast_test as study
from pareto_ltl_apps.studies.known_winds import DepartureWinds
from pareto_ltl_apps.studies.random_missions import Mission, mission
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.study_forecast_test import forecast_test_figure


def study_of(told: list[dict[str, object]], **changes: object) -> Study:
    return study.missions_study(context_of(snapshots(calm), settings(**changes)), told)


def task_of(context: DepartureWinds, number: int = 0) -> Mission:
    return mission(context.cfg, context.settings.seed, number, context.spells)


# --- what is known ---------------------------------------------------------------------------


@pytest.mark.parametrize("number", range(10))
@pytest.mark.parametrize("delay", [0.0, 4.0, 7.5])
def test_planning_knows_no_cycle_younger_than_the_delay(number: int, delay: float) -> None:
    context = context_of(snapshots(calm), settings(delay=delay))
    task = task_of(context, number)
    departure = seconds(str(task.scene.time_zero))
    known = context.readings(task)
    cycles = known.times - known.leads
    assert cycles.max() <= departure - delay * HOUR
    assert cycles.max() > departure - (delay + 6) * HOUR  # and the newest of those
    assert known.times[-1] == cycles.max() + 3 * HOUR  # with its forecast
    assert departure + 10 * HOUR <= context.truth.times[-1]


def test_of_one_time_planning_knows_the_newest_cycle_and_truth_the_analysis() -> None:
    context = context_of(snapshots(calm, leads=(0, 3, 6, 9)), settings())
    known = context.readings(task_of(context, 3))
    young = known.leads[known.times <= known.times[-1] - 9 * HOUR]
    assert set(young.tolist()) == {0.0, 3 * HOUR}
    assert known.leads[-1] == 9 * HOUR
    assert set(context.truth.leads[:-2].tolist()) == {0.0, 3 * HOUR}


def test_readings_are_thinned_to_the_same_nodes_or_are_every_node() -> None:
    few = context_of(snapshots(calm), settings())
    every = context_of(snapshots(calm), settings(points=None))
    for context, count in ((few, 40), (every, len(NODES))):
        known = context.readings(task_of(context))
        assert {len(points) for points in known.points} == {count}
        table = {
            tuple(node): wind for node, wind in zip(NODES.tolist(), snapshots(calm)[0].winds, strict=True)
        }
        expected = np.array([table[tuple(node)] for node in known.points[0].tolist()])
        np.testing.assert_array_equal(known.winds[0], expected)


@pytest.mark.parametrize("corner", range(4))
def test_the_fields_that_are_read_cover_a_scene_at_the_edge_of_the_area(corner: int) -> None:
    cfg = settings(side=[800e3, 800e3])
    east, north = AREA[corner]
    half = 400e3 + cfg.wind.padding
    outline = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    lon, lat = Frame(frames.local_plane(north, east)).to_geographic(outline)
    assert study.needed_area(cfg, cfg.forecast_test).contains(np.column_stack([lon, lat])).all()


def test_a_period_that_is_too_short_for_the_delay_is_refused() -> None:
    with pytest.raises(DataError, match=r"forecast_test\.truth holds no period of 40 h .* has 33 h"):
        context_of(snapshots(calm), settings(delay=30.0))


# --- what becomes of plans -------------------------------------------------------------------


def test_a_wind_that_stays_as_it_was_keeps_the_promise_and_one_that_turns_breaks_it() -> None:
    def turning(hour: float) -> tuple[float, float]:  # steady as far as the cycle at hour 0 can tell
        return (3.0, 1.0) if hour <= 3 else (18.0, -14.0)

    cfg = settings(delay=6.0, hours=21.0)  # so that every departure is at hour 6
    outcomes = {}
    for name, wind in (("steady", calm), ("turning", turning)):
        context = context_of(snapshots(wind, hours=24), cfg)
        result = study.mission_part(context, 0)
        (plan,) = result["plans"]
        outcomes[name] = plan
        assert plan["promised"].keys() == {"simulated_coherent", "bound_coherent"}
        assert result["known_hours"] == -3.0
    steady, turned = outcomes["steady"], outcomes["turning"]
    assert steady["failure"] <= steady["promised"]["simulated_coherent"] + 0.05
    assert turned["failure"] > 0.95
    assert turned["promised"]["simulated_coherent"] < 0.9


# --- tables ----------------------------------------------------------------------------------


def result(longitude: float, promised: float, failure: float, fidelity: str = "full") -> dict[str, object]:
    law = {"full": "coherent", "paper": "independent"}[fidelity]
    plan = {
        "fidelity": fidelity, "kind": "chosen", "steps": 9, "hours": 4.5, "objectives": {"length": 1e5},
        "promised": {f"simulated_{law}": promised, f"bound_{law}": min(1.0, 2 * promised)},
        "failure": failure, "missed": failure, "collided": 0.0, "off_map": 0.0, "miss_m": 1e3, "sd_m": 1e3,
    }  # fmt: skip
    place = {
        "departure": "2018-10-09T12:00:00Z", "latitude": 40.0, "longitude": longitude, "known_hours": -3.0,
        "cycle_hours": -6.0,
    }  # fmt: skip
    return {"formula": "F a", **place, "plans": [plan]}


def results() -> list[dict[str, object]]:
    """Sixty missions: honest in the west, twice as bold in the east."""
    rng = np.random.default_rng(5)
    promised = rng.beta(0.8, 2.0, 60)
    places = np.tile([-110.0, -97.0, -80.0], 20)
    failure = np.where(places > -90, np.minimum(1.0, promised + 0.5), promised)
    return [result(*map(float, row)) for row in zip(places, promised, failure, strict=True)]


def test_regions_bins_and_verdicts_are_told() -> None:
    found = study_of(results(), bins=3)
    assert [group["missions"] for group in found.tables["reliability"]] == [20] * 6  # two promises
    regions = [row for row in found.tables["regions"] if row["promise"] == "simulated_coherent"]
    assert [(row["region"], row["missions"], row["kept"]) for row in regions] == [
        ("west of 105 W", 20, True),
        ("105 to 90 W", 20, True),
        ("east of 90 W", 20, False),
    ]
    assert found.numbers["full_bins"] == 3.0
    assert "of 3 bins of at least 20 missions keep their promise" in found.text
    assert "Not covered" in found.text
    assert wrong_texts(found.text.splitlines()) == []


@pytest.mark.parametrize(
    ("known", "cycle", "lead"),
    [(-3.0, -6.0, "held field"), (4.0, -5.0, "held field"), (4.5, -1.0, "0 to 6 h"), (5.0, -1.5, "0 to 6 h"),
     (5.0, -1.6, "6 to 12 h"), (12.0, -12.0, "12 to 24 h"), (90.0, -60.0, "above 48 h")],
)  # fmt: skip
def test_a_flight_is_covered_where_the_last_known_field_is_not_before_its_end(
    known: float, cycle: float, lead: str
) -> None:
    assert study.lead_of(4.5, known, cycle) == lead


def test_the_table_is_by_season_and_lead() -> None:
    assert [study.season_of(f"2018-{month:02d}-09T12:00:00Z") for month in (12, 1, 3, 8, 11)] == [
        "Dec to Feb", "Dec to Feb", "Mar to May", "Jun to Aug", "Sep to Nov",
    ]  # fmt: skip
    told = results()
    for row in told[:20]:
        row |= {"departure": "2019-01-09T12:00:00Z", "known_hours": 9.0, "cycle_hours": -4.0}
    found = study_of(told)
    own = [row for row in found.tables["leads"] if row["promise"] == "simulated_coherent"]
    groups = {(row["season"], row["lead"]): row["missions"] for row in own}
    assert groups == {("Dec to Feb", "6 to 12 h"): 20, ("Sep to Nov", "held field"): 40}
    assert "By season, and lead at the end of the flight" in found.text


def test_plans_of_two_fidelities_share_a_table() -> None:
    told = [result(-100.0, 0.1, 0.2), result(-100.0, 0.1, 0.2, "paper")]
    rows = study_of(told, fidelities=["full", "paper"]).tables["forecast_test"]
    assert len({tuple(row) for row in rows}) == 1  # the same columns
    assert np.isnan(rows[0]["simulated_independent"])


def test_missions_without_a_plan_are_told_with_their_reason() -> None:
    lost = result(-100.0, 0.1, 0.1) | {"plans": [], "reason_full": "no way"}
    found = study_of([*results(), lost])
    assert found.tables["no_plan"] == [{"mission": 60, "reason": "no way"}]
    with pytest.raises(InfeasibleError, match=r"none of 1 random missions has a plan \(no way\)"):
        study_of([lost])


def test_the_figure_shows_every_bin_and_region_within_its_page() -> None:
    found = study_of(results(), bins=3)
    own = [
        [row for row in found.tables[name] if row["promise"] == "simulated_coherent"]
        for name in ("reliability", "regions")
    ]
    with style.report_style():
        figure: Figure = forecast_test_figure(*own, found.tables["forecast_test"], "simulated_coherent")
    assert texts_outside(figure) == []
    assert wrong_texts(texts_of(figure)) == []
    assert labels_without_unit(figure) == []
    marks = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    assert len(marks) == 3
    hollow = [line for line in figure.axes[1].lines if line.get_markerfacecolor() == "white"]
    assert len(hollow) == 1
    assert sum(patch.get_height() for patch in figure.axes[2].patches) == 60  # type: ignore[attr-defined]


@needs_noaa
def test_a_forecast_test_of_real_fields_from_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = [
        "pipelines=forecast_test",
        "forecast_test.missions=2",
        "forecast_test.side=[300000.0,400000.0]",
        "planner.trees=2",
        "planner.n_max=1000",
        "fidelity.refine=none",
        "planner.epsilon=0.25",
        "selection.runs=200",
        "selection.draws=100",
        "deployment.runs=50",
        "evaluation.jobs=1",
        "report.dpi=40",
        f"forecast_test.truth={NOAA / 'gfs_1p00_10m'}",
        "hydra.run.dir=out",
    ]
    assert app.run_hydra(command) == 0
    metrics = json.loads(Path("out/metrics.json").read_text())
    assert metrics["missions"] == 2.0
    assert 0 <= metrics["full_realised"] <= 1
    rows = list(csv.DictReader(Path("out/forecast_test.csv").read_text().splitlines()))
    assert all(float(row["known_hours"]) < 0 for row in rows)  # f003 of a cycle 4 h old has passed
    assert {row["lead"] for row in rows} == {"held field"}
    for name in (
        "reliability.csv",
        "leads.csv",
        "regions.csv",
        "scorecard.csv",
        "figures/forecast_test_full.png",
    ):
        assert (Path("out") / name).stat().st_size > 0
