"""The table at the end of a run."""

from __future__ import annotations

import io
import logging
from pathlib import Path

from rich.console import Console

from flight_quantities.medium import WATER
from pareto_ltl import Run
from pareto_ltl.settings import Settings, preset
from pareto_ltl_apps.cli.output import collected_warnings
from pareto_ltl_apps.cli.summary import (
    answer_line,
    fitting_columns,
    run_answer,
    shown_markdown,
    summary_rows,
    warning_paragraphs,
)

METRICS = {
    "length_m": 1.5e6, "duration_s": 90_000.0, "dt_s": 1800.0,
    "mission_risk_paper": 0.01234567, "mission_risk": 0.5, "mission_risk_ordered": 3.21e-5,
    "collision_risk": 0.0,
    "promise_runs": 20_000.0, "promise_failure": 0.0015, "promise_low": 0.0010, "promise_high": 0.0021,
    "promise_bound": 0.0321,
    "mission_risk_coherent": 0.9, "collision_risk_coherent": 0.3,
    "runs_coherent": 500.0, "failure_coherent": 0.0, "failure_coherent_low": 0.0,
    "failure_coherent_high": 0.00735,
    "seconds_forest": 0.25, "run_seconds": 1.5,
}  # fmt: skip


def test_every_probability_stands_beside_its_wind_law() -> None:
    rows = dict(summary_rows(METRICS, "coherent"))
    assert rows == {
        "length": "1,500.0 km",
        "flight time": "25.00 h in steps of 1,800 s",
        "mission risk f_o (paper), independent winds": "1.2 %",
        "mission risk V, coherent winds": "0.0032 %",
        "collision risk R, coherent winds": "0 %",
        "fails, coherent winds, 20,000 fresh flights": "0.15 % (95 %: 0.10 to 0.21 %)",
        "bound V + R, coherent winds": "3.2 %",
        "V + R of the controls, coherent winds": "100 %",
        "failed of 500 simulated, coherent winds": "0 % (95 %: 0 to 0.73 %)",
        "  forest": "0.25 s",
        "in all": "1.50 s",
    }


def test_a_rate_in_a_wind_of_another_level_is_named_so() -> None:
    rows = dict(summary_rows(METRICS, "coherent", verbose=True, fails="fails in a wind of another level"))
    assert "fails in a wind of another level, coherent winds, 20,000 fresh flights" in rows
    assert not any(name.startswith("fails,") for name in rows)
    assert answer_line(METRICS, "coherent", gap="the robot flies at 925 hPa") == (
        "15 of 10,000 flights fail (10 to 21), in winds of another level than the robot's (no promise)."
    )


def test_a_rate_below_the_floor_of_its_law_is_said_to_be_below_it() -> None:
    shown, floor = "fails, coherent winds, 20,000 fresh flights", {"promise_floor": 1 / 65}
    assert answer_line(METRICS | floor, "coherent") == (
        "Fewer than 1.5 of 100 flights fail, in winds of this forecast: the law's data cannot say less."
    )
    rows = dict(summary_rows(METRICS | floor, "coherent", verbose=True))
    assert rows[shown] == (
        "below 1.5 %: the law's data cannot say less; simulated: 0.15 % (95 %: 0.10 to 0.21 %)"
    )
    above = dict(summary_rows(METRICS | {"promise_floor": 1e-3}, "coherent", verbose=True))
    assert above[shown] == "0.15 % (95 %: 0.10 to 0.21 %)"


def test_a_plan_that_branches_fails_as_it_is_flown_with_its_fixes_and_the_rate_without_follows() -> None:
    tree = {"branches": 4.0, "branches_failure": 4e-4, "branches_low": 2e-4, "branches_high": 8e-4}
    assert answer_line(METRICS | tree, "coherent") == (
        "4.0 of 10,000 flights fail (2.0 to 8.0), in winds of this forecast, with its branches; "
        "15.0 of 10,000 without a fix."
    )
    below = answer_line(METRICS | tree | {"promise_floor": 1e-3}, "coherent")
    assert below.endswith("cannot say less, with its branches; 15.0 of 10,000 without a fix.")
    assert dict(summary_rows(METRICS | tree, "coherent", verbose=False))["branches"] == "4"


def test_a_newcomer_reads_one_answer_and_no_other_failure() -> None:
    assert answer_line(METRICS, "coherent") == (
        "15 of 10,000 flights fail (10 to 21), in winds of this forecast."
    )
    rows = dict(summary_rows(METRICS, "coherent", verbose=False))
    assert rows == {
        "length": "1,500.0 km",
        "flight time": "25.00 h in steps of 1,800 s",
        "in all": "1.50 s",
    }
    bounded = {key: value for key, value in METRICS.items() if not key.startswith("promise")}
    assert answer_line(bounded, "coherent") == ""
    assert len(dict(summary_rows(bounded, "coherent", verbose=False))) > 4  # there the bounds judge


def test_times_of_stages_are_printed_on_request_also_where_bounds_judge() -> None:
    bounded = {key: value for key, value in METRICS.items() if not key.startswith("promise")}
    for metrics in (METRICS, bounded):
        assert "  forest" in dict(summary_rows(metrics, "independent", verbose=True))
        assert "  forest" not in dict(summary_rows(metrics, "independent", verbose=False))


def test_a_summary_of_a_robot_in_the_water_names_currents() -> None:
    for metrics, verbose in ((METRICS, True), (METRICS, False)):
        rows = dict(summary_rows(metrics, "coherent", WATER, verbose=verbose))
        assert rows["time under way"] == "25.00 h in steps of 1,800 s"
        assert answer_line(METRICS, "coherent", WATER).endswith("in currents of this forecast.")
        assert ("fails, coherent currents, 20,000 fresh flights" in rows) == verbose
        assert not any(word in name for name in rows for word in ("wind", "flight time", "airspeed"))


def test_the_warnings_of_a_run_are_printed_each_once(tmp_path: Path) -> None:
    log, python = logging.getLogger("pareto_ltl.planning"), logging.getLogger("py.warnings")
    with collected_warnings() as warnings:
        log.info("run %s", "a")
        for _ in range(2):
            log.warning("low %s", "wind")
        python.warning("file.py:3: UserWarning: no. 0\n  code")
        log.error("an error has its own line")
        for number in range(1, 6):
            log.warning("no. %d", number)
    log.warning("after the run")
    told = list(warning_paragraphs(warnings, tmp_path))
    assert told[:3] == ["Warning: low wind", "Warning: file.py:3: UserWarning: no. 0", "Warning: no. 1"]
    assert told[5:] == [f"Warning: 2 more in {tmp_path / 'run.log'}"]
    assert not list(warning_paragraphs([], tmp_path))


def test_the_law_is_that_of_the_settings(tmp_path: Path) -> None:
    page = io.StringIO()
    settings = Settings(name="trial", fidelity=preset("full"))
    answer = run_answer(Run(settings), tmp_path, METRICS, [], verbose=True)
    for line in answer.lines:
        Console(file=page, width=80).print(line)
    assert "mission risk V, coherent winds" in page.getvalue()
    assert "trial" in page.getvalue()
    assert "0.0000" not in page.getvalue()
    assert answer.document["law"] == "coherent"
    assert answer.document["metrics"] == METRICS


def test_tables_of_a_study_fit_a_terminal_and_lose_no_column_without_a_word() -> None:
    rows = ["| start | ratio | why |", "|---|---|---|", f"| 00Z | 1.5 | {'x' * 50} |", "| 06Z | 2 | - |"]
    text = "\n".join(["**Leave at 00Z**.", "", *rows, "", "## Why", "- one"])
    page = io.StringIO()
    console = Console(file=page, width=80, highlight=False, markup=False)
    for part in shown_markdown(text, "tables.md"):
        console.print(part)
    lines = page.getvalue().splitlines()
    assert all(len(line) <= 80 for line in lines)
    assert not any(mark in page.getvalue() for mark in ("**", "##", "|"))
    assert sum("x" * 50 in line for line in lines) == 1  # not broken
    wide = [row + f" {'y' * 70} |" for row in rows]
    shown = [part for part in shown_markdown("\n".join(wide), "tables.md") if isinstance(part, str)]
    assert shown == [f"1 more column in tables.md: {'y' * 70}"]


def test_a_table_that_is_too_wide_has_its_failures() -> None:
    header = ["method", "winds", "x" * 30, "failed", "collided", "y" * 30]
    assert fitting_columns([header], 60) == [0, 1, 2, 3]
    assert fitting_columns([header], 25) == [0, 1, 3]
    assert fitting_columns([["x" * 100, "failed", "failed at 2 km"]]) == [0]
    assert fitting_columns([header], 200) == [0, 1, 2, 3, 4, 5]


def test_a_run_that_only_fits_the_wind_prints_what_it_found() -> None:
    fitted = {
        "gp_coverage_90": 0.914, "gp_nlpd": 1.8, "gp_z_sd": 0.972, "wind_speed_m_s": 4.3, "wind_sd_m_s": 1.6,
        "wind_modes": 32, "wind_energy": 0.573, "run_seconds": 1.0,
    }  # fmt: skip
    rows = dict(summary_rows(fitted, "coherent"))
    assert rows == {
        "expected wind speed, mean of the map": "4.3 m/s",
        "standard deviation of a component": "1.6 m/s",
        "held-out readings in 90 % intervals": "91 %",
        "their residuals (1: as predicted)": "0.97 standard deviations",
        "modes of the error": "32, 57 % of its variance",
        "in all": "1.00 s",
    }
    unscored = dict(summary_rows(fitted | {"gp_coverage_90": float("nan")}, "coherent"))
    assert "held-out readings in 90 % intervals" not in unscored
    assert not any(name.startswith("expected wind") for name, _ in summary_rows(METRICS | fitted, "coherent"))


def test_a_study_that_delivers_a_plan_has_no_length_of_its_own():
    """Departures: the metrics have the promise of the recommended start, whose plan is in its own folder."""
    study = {"promise_failure": 0.01, "promise_low": 0.0, "promise_high": 0.02, "run_seconds": 3.0}
    assert dict(summary_rows(study, "coherent", verbose=False)) == {"in all": "3.00 s"}
