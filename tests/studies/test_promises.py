"""``pareto-ltl scores``: diagrams of a forecast test, and two tests compared."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from figure_texts import labels_without_unit, texts_of, texts_outside, wrong_texts
from pareto_ltl.support.arrays import FloatArray
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.studies import calibration
from pareto_ltl_apps.studies import promises as study
from pareto_ltl_apps.view import style
from pareto_ltl_apps.view.study_forecast_test import promises_figure

Table = list[dict[str, object]]


def table(promised: FloatArray, realised: FloatArray, fidelity: str = "full") -> Table:
    """Missions of six situations with ten each, in hourly departures."""
    law = {"full": "coherent", "paper": "independent"}[fidelity]
    return [
        {
            "mission": k, "formula": "F a", "departure": f"2018-10-{9 + k // 24:02d}T{k % 24:02d}:00:00Z",
            "latitude": 40.0, "longitude": -100.0, "kind": "chosen", "fidelity": fidelity,
            "situation": f"s{k // 10}", f"simulated_{law}": p, "failure": f,
        }
        for k, (p, f) in enumerate(zip(promised.tolist(), realised.tolist(), strict=True))
    ]  # fmt: skip


def written(folder: Path, rows: Table) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / study.TABLE).open("w") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return folder


def truth(seed: int = 0, count: int = 60) -> tuple[FloatArray, FloatArray]:
    """Chances, and what came with these chances."""
    rng = np.random.default_rng(seed)
    chances = rng.beta(0.8, 0.8, count)
    return chances, (rng.random(count) < chances).astype(float)


@pytest.fixture
def honest(tmp_path: Path) -> Path:
    return written(tmp_path / "honest", table(*truth()))


@pytest.fixture
def bold(tmp_path: Path) -> Path:
    chances, came = truth()
    return written(tmp_path / "bold", table(0.3 * chances, came))


def test_plans_are_read_in_the_order_of_departure(tmp_path: Path) -> None:
    chances, came = truth()
    found = study.read_promises(written(tmp_path / "turned", table(chances, came)[::-1]))
    assert list(found.departures) == sorted(found.departures)
    np.testing.assert_allclose(found.promised, chances)
    np.testing.assert_allclose(found.realised, came)
    assert (found.name, found.fidelity, found.situations[0]) == ("turned", "full", "s0")


def test_the_area_below_the_murphy_curve_is_the_brier_score_of_rates(tmp_path: Path) -> None:
    chances, _ = truth()
    rates = np.random.default_rng(1).random(60)  # shares of flights, not outcomes
    found = study.read_promises(written(tmp_path / "rates", table(chances, rates)))
    assert study.murphy_curve(found).mean() == pytest.approx(found.brier().mean(), abs=3e-3)
    assert found.brier().mean() == pytest.approx(calibration.brier_score(chances, rates))


def test_the_band_holds_the_isotonic_rates_of_exact_promises_and_not_those_of_bold_ones() -> None:
    inside, beyond = [], []
    for seed in range(12):
        chances, came = truth(seed)
        order = np.argsort(chances)
        p, f = chances[order], came[order]
        low, high = study.consistency_band(p, seed)
        rates = calibration.isotonic_rates(p, f)
        inside.append(np.mean((low - 1e-9 <= rates) & (rates <= high + 1e-9)))
        low, high = study.consistency_band(0.3 * p, seed)
        beyond.append(np.mean(rates > high + 1e-9))
    assert np.mean(inside) > 0.85
    assert np.mean(beyond) > 0.5


def test_the_better_promises_win_and_equal_ones_do_not(honest: Path, bold: Path) -> None:
    mine, other = study.read_promises(honest), study.read_promises(bold)
    found = study.compared(mine, other)
    assert (found.missions, found.situations) == (60, 6)
    assert found.mean == pytest.approx(mine.brier().mean() - other.brier().mean())
    assert found.low < found.mean < found.high < 0
    assert found.p_value < 0.05
    assert found.situation_low < found.mean < found.situation_high
    back = study.compared(other, mine)
    assert (back.mean, back.low) == (pytest.approx(-found.mean), pytest.approx(-found.high))
    same = study.compared(mine, mine)
    assert same.mean == 0.0
    assert np.isnan(same.p_value)


@pytest.mark.statistical
def test_missions_of_one_weather_are_not_counted_as_independent() -> None:
    """Differences that last for ten missions: the interval covers 0 far more often than that of a mean."""
    rng, covered, naive = np.random.default_rng(3), 0, 0
    series = np.repeat(rng.normal(size=(200, 12)), 10, axis=1) + 0.3 * rng.normal(size=(200, 120))
    _, low, high, _ = study.diebold_mariano(series)
    covered = np.mean((low <= 0) & (high >= 0))
    naive = np.mean(np.abs(series.mean(axis=1)) <= 1.96 * series.std(axis=1) / np.sqrt(120))
    assert naive < 0.6
    assert covered > naive + 0.2


def test_only_missions_that_both_planned_are_compared(tmp_path: Path, honest: Path) -> None:
    chances, came = truth()
    fewer = study.read_promises(written(tmp_path / "fewer", table(chances, came)[:25]))
    found = study.compared(study.read_promises(honest), fewer)
    assert found.missions == 25
    assert found.mean == pytest.approx(0.0)
    few = study.read_promises(written(tmp_path / "few", table(chances, came)[:9]))
    with pytest.raises(DataError, match="for 9 common missions, which is too few"):
        study.compared(study.read_promises(honest), few)


def test_the_figure_lies_on_its_page_and_names_what_it_compares(honest: Path, bold: Path) -> None:
    mine, other = study.read_promises(honest), study.read_promises(bold)
    shown = study.diagrams(mine, [*study.references(mine), other], study.compared(mine, other))
    assert list(shown.curves) == ["honest", "best constant", "persistence", "bold"]
    assert shown.curves["best constant"].mean() == pytest.approx(shown.parts["uncertainty"], abs=3e-3)
    assert np.all(np.diff(shown.isotonic) >= 0)
    with style.report_style():
        figure: Figure = promises_figure(shown)
    assert texts_outside(figure) == []
    assert wrong_texts(texts_of(figure)) == []
    assert labels_without_unit(figure) == []
    assert "(c) honest minus bold" in texts_of(figure)
    assert [len(ax.lines) for ax in figure.axes] == [3, 4, 2]


def test_the_command_draws_and_answers(
    honest: Path, bold: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["scores", str(honest), str(bold), "--names", "new", "old", "--out", str(tmp_path / "drawn")]
    assert run_command_line([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in told["compared"]] == ["best constant", "persistence", "old"]
    assert told["brier"] == pytest.approx(
        told["miscalibration"] - told["discrimination"] + told["uncertainty"]
    )
    assert told["floor"] == pytest.approx(1 / 7)
    assert {path.name for path in (tmp_path / "drawn").iterdir()} == {"scores_full.png", "scores_full.svg"}
    assert run_command_line(["scores", str(honest)]) == 0
    text = capsys.readouterr().out
    assert "No calibrated rate below 1/(6 + 1) = 14.3 % can be claimed" in " ".join(text.split())
    assert all(len(line) <= 80 for line in text.splitlines() if "wrote" not in line)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"situation": None}, "has no column situation"),
        ({"failure": "1.5"}, "column failure must hold rates from 0 to 1"),
        ({"failure": "x"}, "column failure must hold rates from 0 to 1"),
        ({"simulated_coherent": ""}, "column simulated_coherent must hold rates"),
        ({"kind": "front"}, "has no chosen plans with fidelity 'full'; it has none"),
        ({"fidelity": "paper"}, "column simulated_independent must hold rates"),
    ],
)
def test_a_damaged_table_is_one_line(
    tmp_path: Path, change: dict[str, str | None], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [{k: v for k, v in (row | change).items() if v is not None} for row in table(*truth())]
    assert run_command_line(["scores", str(written(tmp_path / "spoilt", rows))]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_what_the_command_cannot_do_is_one_line(
    honest: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for words, message in (
        ([str(tmp_path / "nowhere")], "give the results directory of a forecast test"),
        ([str(honest), "--fidelity", "paper"], "no chosen plans with fidelity 'paper'; it has plans of full"),
        ([str(honest), "--names", "a", "b"], "--names names two tests; give OTHER too"),
    ):
        assert run_command_line(["scores", *words]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert message in line
    monkeypatch.setitem(sys.modules, "scores", None)
    assert run_command_line(["scores", str(honest)]) == 2
    assert 'pip install "pareto-ltl[scores]"' in capsys.readouterr().err
