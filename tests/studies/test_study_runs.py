"""The studies from the command line: what they refuse, what they leave behind, and how they go on."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from careful_io.locks import has_note
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.cli import composition
from pareto_ltl_apps.cli import hydra_app as app
from patience import wait_until
from quick_wind import wind_words
from unmeasured import untraced

STUDIES = ("compare", "convergence", "ablation", "hindcast", "forecast_test")
SMALL = (
    "planner.trees=2",
    "planner.n_max=700",
    "deployment.runs=50",
    "evaluation.seeds=[0,1]",
    "compare.methods=[paper,ml_rrt]",
    "report.dpi=40",
)
QUICK = ("fidelity=paper", "fidelity.refine=none", *wind_words())

BAD = {
    "evaluation.seeds=[]": "evaluation.seeds is empty",
    "evaluation.seeds=[1,1]": "evaluation.seeds lists a value twice",
    "evaluation.seeds=[-1]": "evaluation.seeds must lie in [0, 9.22337e18]",
    "evaluation.laws=[]": "evaluation.laws is empty",
    "evaluation.laws=[windy]": "evaluation.laws must be one of independent, coherent",
    "evaluation.jobs=-1": "evaluation.jobs must lie in [0, 1024]",
    "compare.methods=[]": "compare.methods is empty: list at least one of paper",
    "compare.methods=[astar]": "compare.methods must be one of paper",
    "convergence.sizes=[]": "convergence.sizes is empty",
    "convergence.sizes=[1]": "convergence.sizes must lie in [2, 1e8]",
    "ablation.factors=[]": "ablation.factors is empty",
    "ablation.factors=[luck]": "ablation.factors must be one of trees",
    "ablation.epsilon=[1.5]": "ablation.epsilon must lie between 0 and 1",
    "ablation.dt=[]": "ablation.dt is empty",
    "ablation.parents=[scaled]": "ablation.parents is no setting any more: trees of every preset grow by",
    "ablation.refine=[]": "ablation.refine is empty: list at least one of none, convex",
    "ablation.law=[coherent,coherent]": "ablation.law lists a value twice",
    "hindcast.side=[2,1]": "hindcast.side must be [least, most]",
    "hindcast.missions=0": "hindcast.missions must lie in [1, 1000000]",
    "hindcast.formulas=[]": "hindcast.formulas is empty",
    "hindcast.area=[[0.0,0.0]]": "hindcast.area must be at least three corners",
    "forecast_test.side=[2,1]": "forecast_test.side must be [least, most]",
    "forecast_test.delay=-1": "forecast_test.delay must lie in [0, 100000] [h]",
    "forecast_test.points=3": "forecast_test.points must lie in [5, 10000]",
    "forecast_test.fidelities=[]": "forecast_test.fidelities is empty: list at least one of paper, full",
    "pipelines=comparison": "there is no pipeline 'comparison'; there are ",
}


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("argument", BAD)
def test_a_wrong_argument_costs_one_line_and_no_directory(
    argument: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = [] if argument.startswith("pipelines=") else ["pipelines=compare"]
    assert app.run_hydra(["+experiment=phi1", *study, argument]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert BAD[argument] in err
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_and_every_choice_of_it_composes(study: str) -> None:
    mission = [] if study in ("hindcast", "forecast_test") else ["+experiment=phi2"]
    options = [f"{study}={name}" for name in CONF.names(study)] if study != "compare" else []
    for extra in [
        [],
        *([option] for option in options),
        *([f"evaluation={n}"] for n in CONF.names("evaluation")),
    ]:
        arguments = composition.parse_flags([f"pipelines={study}", *mission, *extra])
        with composition.opened_hydra(arguments) as hydra:
            assert composition.prepare(hydra, arguments).pipeline is not None


def test_a_missing_folder_of_winds_costs_one_line(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run_hydra(["pipelines=hindcast", "hindcast.truth=nowhere"]) == 2
    err = capsys.readouterr().err
    assert "hindcast.truth=nowhere: there is no such folder" in err
    assert err.count("\n") == 1


def test_a_run_to_go_on_with_must_exist(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run_hydra(["pipelines=compare", "+experiment=phi1", "evaluation.resume=nowhere"]) == 2
    err = capsys.readouterr().err
    assert "evaluation.resume=nowhere" in err
    assert err.count("\n") == 1


def finished_parts(place: Path) -> list[Path]:
    """The parts whose process has released them: one that is killed before is made again."""
    parts = place.glob("[!.]*.json")
    return [path for path in parts if not has_note(path.with_name(f".{path.name}.lock"))]


def test_a_killed_run_goes_on_and_ends_as_if_it_had_not_been_stopped(here: Path) -> None:
    """SIGKILL as soon as the first part is on disk; the same command again keeps it and ends the same."""
    command = [sys.executable, "-m", "pareto_ltl", "pipelines=convergence", "+experiment=phi1", *SMALL]
    command += ["convergence.sizes=[200,500]", "evaluation.jobs=1", "report=none", *QUICK]
    run = subprocess.Popen(
        [*command, "hydra.run.dir=one"], env=untraced(), start_new_session=True, stderr=subprocess.DEVNULL
    )
    wait_until(lambda: run.poll() is not None or bool(finished_parts(Path("one/parts"))))
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    kept = finished_parts(Path("one/parts"))
    assert kept
    assert not Path("one/metrics.json").exists()
    stamp = kept[0].stat().st_mtime_ns
    for place in ("one", "two"):
        subprocess.run([*command, f"hydra.run.dir={place}"], env=untraced(), check=True, capture_output=True)
    assert kept[0].stat().st_mtime_ns == stamp
    tables = sorted(path.name for path in Path("two").glob("*.csv"))
    assert tables
    for name in tables:
        one, two = (rows_of(Path(place) / name) for place in ("one", "two"))
        clocks = [key for key in one[0] if "second" in key]
        for row in (*one, *two):
            for key in clocks:
                row.pop(key)
        assert one == two, name


def test_a_study_leaves_tables_figures_and_metrics(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        app.run_hydra(
            [
                "pipelines=compare",
                "+experiment=phi2",
                *SMALL,
                *wind_words(),
                "evaluation.jobs=1",
                "hydra.run.dir=out",
            ]
        )
        == 0
    )
    out = Path("out")
    for name in ("compare.csv", "compare_seeds.csv", "differences.csv", "tables.md", "figures/figure1.png"):
        assert (out / name).stat().st_size > 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["completed"] == 1.0
    rows = rows_of(out / "compare.csv")
    assert {row["method"] for row in rows} == {"paper", "ml_rrt"}
    for row in rows:
        assert metrics[f"{row['method']}_failure_{row['law']}"] == float(row["failure"])
    told = capsys.readouterr().out
    assert "proposed (paper)" in told
    assert "|" not in told


def test_an_error_of_settings_has_its_own_kind() -> None:
    from pareto_ltl_apps.studies.settings import EvaluationConfig

    with pytest.raises(ConfigError):
        EvaluationConfig(seeds=[])
