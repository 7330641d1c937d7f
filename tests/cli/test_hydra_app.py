"""The command line: what it composes, what it refuses, and how it ends."""

from __future__ import annotations

import json
import logging
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pytest
from hydra.types import RunMode

from careful_io import machine
from careful_io.error_lines import one_line
from pareto_ltl.run import pipeline
from pareto_ltl.run.plan_run import Run
from pareto_ltl.run.record import Record
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.cli import composition
from pareto_ltl_apps.cli import hydra_app as app
from pareto_ltl_apps.cli.output import output_of
from pareto_ltl_apps.cli.setting_keys import settings_from
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.exports.settings import ON_REQUEST
from unmeasured import untraced

SECTIONS = ("scene", "mission", "robot", "wind", "planner", "fidelity", "selection", "deployment", "report")
NEEDS_A_FILE = ("csv", "currents", "ensemble", "grib", "netcdf", "stations")
FILES = {name: [f"wind.path=wind.{name}"] for name in NEEDS_A_FILE} | {
    "selection=length": ["selection.length=2e6"]
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Adds a stage, which has the name of its function, for the duration of a test."""

    def add(make: Callable[[Run], Any], **files: tuple[str, ...]) -> None:
        added = Record(make, **files)
        listed = (*pipeline.known_stages(), added)
        monkeypatch.setattr(pipeline, "known_stages", lambda: listed)

    return add


def validated(*argv: str) -> Settings:
    """The settings of one run, composed and checked; nothing runs."""
    arguments = composition.parse_flags(argv)
    with composition.opened_hydra(arguments) as hydra:
        prepared = composition.prepare(hydra, arguments)
    assert prepared.pipeline is not None
    return prepared.pipeline.settings


def composed(*argv: str) -> Settings:
    """The settings that a command line comes to, without a check that they can run."""
    arguments = composition.parse_flags(argv)
    with composition.opened_hydra(arguments) as hydra:
        return settings_from(composition.composed_config(hydra, arguments, RunMode.RUN))


BAD = {
    "planner.typo=3": "unknown setting planner.typo",
    "+planner.typo=3": "unknown setting planner.typo",
    "++planner.n_maxx=3": "did you mean planner.n_max?",
    "typo=3": "unknown setting typo",
    "+typo=3": "unknown setting typo",
    "planner.n_max=many": "planner.n_max",
    "planner.n_max=2.5": "planner.n_max",
    "planner.n_max=1": "planner.n_max must lie in [2, 1e8], got 1",
    "seed=-1": "seed must lie in [0, 9.22337e18], got -1",
    "seed=???": "seed",
    "seed=" + "9" * 5000: "too many digits",
    "robot.dt=" + "9" * 400: "robot.dt has a number with",
    "planner.n_max=1e7": "write it in digits, 10000000",
    "planner.trees=null": "planner.trees must be a whole number, got None",
    "scene.regions.z=[[1,1],[2,1],[2,2]]": "scene.regions.z is not there yet; write +scene.regions.z=...",
    "ingest.out=table.json": "ingest.out must end in .csv",
    "planner=null": "planner must be one of default, dense, quick (a choice), got None",
    "planner=3": "planner must be one of default, dense, quick (a choice), got 3",
    "scene.regions=[]": "scene.regions must be a mapping of names to values",
    "mission.order=[a,b]": "mission.order must be a list",
    "mission.start_time=yesterday": "mission.start_time 'yesterday' is not an ISO 8601 time",
    "name=CON": "name must not begin with 'CON', a device on Windows",
    "name=x" + "x" * 300: "name must be at most 100 letters",
    "scene.obstacles=" + "[" * 5000 + "]" * 5000: "nested too deeply",
    "planner=" + "x" * 5000: "File name too long",
    "pipelines.stages=[" + "x" * 5000 + "]": "there is no stage 'xxx",
    "wind.path=größe.csv": "letters beyond ASCII need two pairs of quotes: \"wind.path='größe.csv'\"",
    "hydra.run.dir=": "hydra.run.dir is empty",
    "planner.n_max=100000000": "planner.n_max=100000000 needs",
    "robot.a=[[1.0]]": "robot.a must be a 2 x 2 matrix",
    "selection.rule=best": "worth, priority, weighted, threshold",
    "selection.weights=[1.0]": "selection.weights must be three numbers",
    "wind.source=csv": "wind.path is missing",
    "+experiment=phi9": "there is no experiment 'phi9'; there are hop, phi1, ",
    "wind=storm": "there is no wind 'storm'; there are aifs, ",
    "wind=grib": "wind.path",
    "pipelines=plans": "there is no pipeline 'plans'; there are ",
    "pipelines.stages=[]": "pipelines.stages is empty",
    "pipelines.stages=[winds]": "there is no stage 'winds'; there are ",
    "pipelines.stages=[readings,readings]": "twice",
    "seed=1,2": "add -m to run each",
    "mission.formula=F(a & F c)": "needs two pairs of quotes: \"mission.formula='F(a & F c)'\"",
    'mission.formula=F("a b" & c)': "needs two pairs of quotes: \"mission.formula='F(a & F b)'\"",
    "mission.formula=''": "mission.formula is missing",
    "mission.formula='F(a & '": "column",
    "mission.formula='G a'": "G a",
    "name=../elsewhere": "name must be",
    "hydra.typo=3": "hydra.typo",
    "~planner.trees": "planner.trees",
    "--typo": "--typo",
}


@pytest.mark.parametrize("argument", BAD)
def test_a_wrong_argument_costs_one_line_and_no_directory(
    argument: str, here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "available_memory", lambda: 1e9)
    experiment = [] if "experiment" in argument else ["+experiment=phi1"]
    assert app.run_hydra([*experiment, argument]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert BAD[argument] in err
    assert len(err) < 500
    assert err.strip().isprintable()
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    "values", ["seed=x,1", "seed=1,x", "seed=range(3,-2,-1)", "planner.epsilon=0.1,1.5", "planner=null,quick"]
)
def test_both_ends_of_a_sweep_are_checked_before_its_first_job(
    values: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run_hydra(["-m", "+experiment=phi1", values]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    "values", ["seed=range(0,1000000000)", "seed=range(0,1000) scene.random.seed=range(0,1000)"]
)
def test_a_sweep_that_nobody_waits_for_is_refused(
    values: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run_hydra(["-m", "+experiment=phi1", *values.split()]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "expected at most 100000" in err
    assert list(here.iterdir()) == []


def test_results_go_where_they_are_said_to_be_when_a_job_changes_its_folder(
    here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def idle(run: Run) -> int:
        return 0

    stage(idle)
    assert app.run_hydra(["pipelines.stages=[idle]", "hydra.job.chdir=true"]) == 0
    place = only("outputs/plan/*").absolute()
    assert Path.cwd() == here
    told = capsys.readouterr().out.split("results in ")[1].strip()
    assert told == str(place)
    assert json.loads((place / "metrics.json").read_text())["completed"] == 0.0
    assert not list(place.glob("outputs*"))


@pytest.mark.parametrize("flags", [[], ["--json"], ["--quiet"]])
def test_the_answer_is_printed_before_figures_and_once(
    flags: list[str], here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    before = list[str]()

    def drawn(run: Run) -> int:
        before.append(capsys.readouterr().out)
        logging.getLogger("pareto_ltl").warning("a thin line")
        raise ValueError("no ink")

    stage(drawn, shows=("d.png",))
    output, words = output_of([*flags, "pipelines.stages=[drawn]", "hydra.run.dir=there"])
    assert app.run_hydra(words, output=output) == 1
    assert before[0].splitlines()[-1].count("there") == 1
    out, err = capsys.readouterr()
    assert out == ""
    place = "there/run.log"
    assert err == f"pareto-ltl: ValueError: no ink (this is a bug; the traceback is in {place})\n"
    assert json.loads(Path("there/run.json").read_text())["status"] == "failed"


def test_a_folder_with_spaces_and_other_letters_holds_results(
    here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def idle(run: Run) -> int:
        return 0

    stage(idle)
    place = Path("Ergebnis Größe 風")
    assert app.run_hydra(["pipelines.stages=[idle]", f"hydra.run.dir='{place}'"]) == 0
    assert f"results in {place}" in capsys.readouterr().out
    assert (place / "metrics.json").is_file()


def test_files_differ_by_more_than_case_where_regions_do_not(here: Path) -> None:
    names = "+scene.regions={a:[[1,1],[2,1],[2,2]],A:[[4,4],[5,4],[5,5]]}"
    words = [
        "scene.bounds=[[0,0],[9,9]]",
        "scene.start=[0,0]",
        "scene.unit=1000",
        "mission.formula='F a & F A'",
    ]
    stages = "pipelines.stages=[readings,scene,decomposition,automaton,observations,wind]"
    assert app.run_hydra([names, *words, stages, "wind=calm", "name=Aa"]) == 0
    place = only("outputs/Aa/*")
    assert Run.open(place).scene.regions.keys() == {"a", "A"}
    files = [str(path.relative_to(place)) for path in place.rglob("*")]
    assert len({name.lower() for name in files}) == len(files)


def test_without_a_map_the_ready_missions_are_named(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert app.run_hydra([]) == 2
    err = capsys.readouterr().err
    assert all(name in err for name in CONF.names("experiment"))


@pytest.mark.parametrize("experiment", CONF.names("experiment"))
def test_every_experiment_composes(experiment: str) -> None:
    assert validated(f"+experiment={experiment}").scene.regions


def choices_together() -> Iterator[tuple[str, ...]]:
    """Every choice of every section, of several sections at once: a composition takes half a second."""
    alone = [f"{section}={name}" for section in ("scene", "mission", "robot") for name in CONF.names(section)]
    yield from ((choice,) for choice in alone)
    others = [[f"{section}={name}" for name in CONF.names(section)] for section in SECTIONS[3:]]
    for row in zip_longest(*others):
        yield tuple(choice for choice in row if choice)


@pytest.mark.parametrize("together", list(choices_together()), ids=" ".join)
def test_every_choice_composes_with_a_mission(together: tuple[str, ...]) -> None:
    more = [word for choice in together for word in FILES.get(choice.removeprefix("wind="), [])]
    more += ["robot=fixed_wing"] * ("selection=energy" in together)
    assert validated("+experiment=phi1", *together, *more).name == "phi1"


def test_ingest_needs_no_mission() -> None:
    assert validated("pipelines=ingest", "wind=grib", "wind.path=folder").pipelines.stages == [
        "readings",
        "table",
    ]


def test_an_experiment_changes_only_what_it_names() -> None:
    plain = composed()
    mission = composed("+experiment=phi2")
    assert mission.scene.regions.keys() == {"a", "b", "c", "d"}
    mission.scene, mission.mission, mission.name = plain.scene, plain.mission, plain.name
    mission.robot.dt = plain.robot.dt
    assert mission == plain


def test_the_shipped_configuration_is_the_default_of_the_schema_with_errors_of_the_robot() -> None:
    settings = composed()
    settings.pipelines.stages = []
    assert settings == replace(Settings(), robot=Settings.of_section("robot", "airframe"))
    exact = dict.fromkeys(("airspeed_sd", "heading_sd", "clock_sd"))
    assert replace(settings.robot, **exact) == Settings().robot


def test_a_key_that_only_a_file_adds_is_refused_too(
    here: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str]
) -> None:
    extra = tmp_path_factory.mktemp("conf")
    (extra / "planner").mkdir()
    (extra / "planner" / "mine.yaml").write_text("treez: 3\n")
    assert app.run_hydra(["--config-dir", str(extra), "+experiment=phi1", "planner=mine"]) == 2
    assert "treez" in capsys.readouterr().err
    assert list(here.iterdir()) == []


def test_a_configuration_of_ones_own_is_found_beside_the_shipped_one(tmp_path: Path) -> None:
    (tmp_path / "planner").mkdir()
    (tmp_path / "planner" / "mine.yaml").write_text("trees: 3\n")
    assert validated("--config-dir", str(tmp_path), "+experiment=phi1", "planner=mine").planner.trees == 3


# --- how runs end ----------------------------------------------------------------------------


def only(pattern: str) -> Path:
    (found,) = Path().glob(pattern)
    return found


def test_a_finished_run_leaves_its_settings_its_record_and_metrics_last(
    here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def probe(run: Run) -> int:
        directory = run.directory
        assert not (directory / "metrics.json").exists()
        assert json.loads((directory / "run.json").read_text())["status"] == "running"
        return run.settings.seed

    stage(probe)
    assert app.run_hydra(["pipelines.stages=[probe]", "seed=7", "name=trial"]) == 0
    place = only("outputs/trial/*")
    record = json.loads((place / "run.json").read_text())
    assert record["status"] == "ok"
    assert record["seed"] == 7
    assert record["argv"] == ["pipelines.stages=[probe]", "seed=7", "name=trial"]
    assert record["seconds"].keys() == {"probe"}
    assert json.loads((place / "metrics.json").read_text())["completed"] == 0.0
    assert "seed: 7" in (place / "config_resolved.yaml").read_text()
    assert "probe done" in (place / "run.log").read_text()
    assert f"results in {place}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "code", "status"),
    [
        (DataError("the file\nis broken"), 2, "failed"),
        (ConfigError("no such thing"), 2, "failed"),
        (OSError(28, "No space left on device"), 2, "failed"),
        (InfeasibleError("no way; raise planner.n_max"), 2, "infeasible"),
        (RuntimeError("oops"), 1, "failed"),
        (AssertionError(), 1, "failed"),
        (KeyboardInterrupt(), 130, "stopped"),
    ],
)
def test_a_failure_is_one_line_an_exit_code_and_a_record(
    error: BaseException, code: int, status: str, here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def burst(run: Run) -> None:
        raise error

    stage(burst)
    assert app.run_hydra(["pipelines.stages=[burst]", "hydra.run.dir=outputs/plan/named"]) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "Traceback" not in err
    place = only("outputs/plan/*")
    record = json.loads((place / "run.json").read_text())
    assert (record["status"], record["error"]) == (status, one_line(error))
    assert not (place / "metrics.json").exists()
    if code == 1:  # a bug: the line says where the traceback is
        assert str(place / "run.log") in err
        assert "Traceback" in (place / "run.log").read_text()


def test_a_run_that_fails_before_its_first_tree_leaves_no_folder(
    here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(run: Run) -> None:
        raise DataError("the wind file is empty")

    stage(refused)
    assert app.run_hydra(["pipelines.stages=[readings,scene,refused]", "+experiment=phi1"]) == 2
    assert capsys.readouterr().err == "pareto-ltl: the wind file is empty\n"
    assert not (here / "outputs").exists()


def test_a_formula_over_an_unknown_region_leaves_no_folder(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert app.run_hydra(["+experiment=phi1", "mission.formula='F nowhere'", "wind=calm"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("pareto-ltl: unknown region 'nowhere'")
    assert "[" not in err
    assert not (here / "outputs").exists()


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_run_that_is_asked_to_end_notes_it_and_ends_with_the_code_of_the_signal(
    name: str, here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    number = signal.Signals[name]

    def busy(run: Run) -> None:
        os.kill(os.getpid(), number)

    stage(busy)
    assert app.run_hydra(["pipelines.stages=[busy]"]) == 128 + number
    out, err = capsys.readouterr()
    assert (out, err) == ("", f"pareto-ltl: stopped by {name}\n")
    place = only("outputs/plan/*")
    record = json.loads((place / "run.json").read_text())
    assert (record["status"], record["error"]) == ("stopped", f"stopped by {name}")
    assert f"ERROR pareto_ltl: stopped by {name}" in (place / "run.log").read_text()


def test_a_log_that_cannot_be_written_is_one_line(
    here: Path, stage: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python would keep half a module

    def chatty(run: Run) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
        for _ in range(1000):
            logging.getLogger("pareto_ltl").info("a line of the log")

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    stage(chatty)
    try:
        assert app.run_hydra(["pipelines.stages=[chatty]"]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "File too large" in err
    assert json.loads((only("outputs/plan/*") / "run.json").read_text())["status"] == "failed"


def test_a_disk_that_is_full_is_one_line_whatever_file_fills_it(here: Path) -> None:
    """In processes of their own: a library that writes to the disk itself could end the process.

    Python would keep half a compiled module, so it writes none.
    """
    words = [
        "+experiment=phi1_calm",
        "pipelines.stages=[readings,scene,observations,wind]",
        "hydra.run.dir=out",
    ]
    for limit in (500, 5_000, 50_000):
        code = (
            "import resource, sys; from pareto_ltl_apps.cli.commands import run_command_line as run;"
            f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY));"
            f"sys.exit(run({words!r}))"
        )
        command = [sys.executable, "-B", "-c", code]
        done = subprocess.run(command, env=untraced(), capture_output=True, text=True, check=False)
        assert done.returncode == 2, done.stderr
        assert done.stderr.count("\n") == 1
        assert "File too large" in done.stderr
        assert not list(here.glob("out/.[0-9]*"))


def test_a_sweep_goes_on_after_a_failed_job_and_keeps_all_in_one_folder(
    here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def picky(run: Run) -> int:
        if run.settings.seed == 2:
            raise DataError("two is not to my taste")
        return run.settings.seed

    stage(picky)
    assert app.run_hydra(["-m", "pipelines.stages=[picky]", "seed=1,2,3", "name=x,y"]) == 2
    (folder,) = Path("multirun").glob("*")
    jobs = [point["job"] for point in json.loads((folder / "sweep.json").read_text())["points"]]
    states = [json.loads((folder / job / "run.json").read_text()) for job in jobs]
    assert [s["status"] for s in states] == ["ok", "ok", "failed", "failed", "ok", "ok"]
    assert [s["name"] for s in states] == ["x", "y"] * 3
    assert capsys.readouterr().err.count("two is not to my taste") == 2


def test_an_unwritable_place_is_one_line(here: Path, stage: Any, capsys: pytest.CaptureFixture[str]) -> None:
    def idle(run: Run) -> int:
        return 0

    stage(idle)
    Path("outputs").write_text("a file where the folder should be")
    assert app.run_hydra(["pipelines.stages=[idle]"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_module_ends_with_the_exit_code_of_the_run(here: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pareto_ltl", "typo=1"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1


def test_warnings_go_to_the_log_of_the_run(
    here: Path, stage: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    def uneasy(run: Run) -> int:
        import warnings

        warnings.showwarning("the ice is thin", UserWarning, "lake.py", 1)
        return 1

    stage(uneasy)
    assert app.run_hydra(["pipelines.stages=[uneasy]"]) == 0
    assert "the ice is thin" in only("outputs/plan/*/run.log").read_text()
    assert capsys.readouterr().err == ""


# --- the whole of it -------------------------------------------------------------------------

SMALL = (
    "+experiment=phi1",
    "planner.trees=2",
    "planner.n_max=800",
    "deployment.runs=50",
    "refine.flights=60",
    "refine.sweep_flights=20",
    "refine.classes=1",
    "refine.points=5",
    "selection.draws=200",
    "selection.runs=200",
    "report=none",
)
MADE = {
    *("run.json", "run.log", "config_resolved.yaml", ".hydra", "metrics.json"),
    *("scene.json", "wind.nc", "automaton.hoa", "automaton.json", "cells.json"),
    *("trees.npz", "front.csv", "front.npz", "plan.json", "plan.csv", "deployments.npz"),
    *(one.file for kind, one in FORMATS.items() if kind not in ON_REQUEST),
}
TIMED = {"run.json", "run.log", "metrics.json", ".hydra"}
NUMBERS = {
    *("completed", "length_m", "mission_risk_paper", "mission_risk", "collision_risk", "nodes"),
    *("growth_seconds", "nodes_per_second", "front_size", "hypervolume", "run_seconds"),
    *("gp_z_sd", "gp_coverage_90", "runs_independent", "failure_independent", "failure_independent_low"),
    *("failure_independent_high", "mission_failure_independent", "collision_independent"),
}


def test_the_same_command_gives_the_same_files_with_any_number_of_threads(here: Path) -> None:
    results = []
    for threads in (1, 2):
        place = f"hydra.run.dir=outputs/threads{threads}/run"  # files name the run
        assert app.run_hydra([*SMALL, f"planner.threads={threads}", place]) == 0
        results.append(Run.open(only(f"outputs/threads{threads}/*")))
    one, two = (result.directory for result in results)
    assert {path.name for path in one.iterdir()} == MADE
    for name in sorted(MADE - TIMED - {"config_resolved.yaml"}):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name

    metrics = results[0].metrics
    assert set(metrics) >= NUMBERS
    assert metrics["completed"] == 1.0
    assert metrics["nodes"] == sum(len(tree) for tree in results[0].forest.trees)
    assert metrics["length_m"] == results[0].plan.path.objectives.length
    assert metrics["front_size"] == len(results[0].front.paths)
    flights = results[0].deployments["independent"]
    assert metrics["runs_independent"] == len(flights.accepted) == 50
    assert metrics["failure_independent"] == flights.failed.mean()
    assert set(results[0].provenance["inputs"].values())  # the packaged wind, by hash


def test_trees_that_find_no_way_are_kept_with_their_picture(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ["+experiment=phi1", "fidelity=paper", "planner.trees=1", "planner.n_max=20", "report.dpi=50"]
    assert app.run_hydra(few) == 2
    err = capsys.readouterr().err
    place = only("outputs/phi1/*")
    assert err.count("\n") == 1
    assert str(place) in err
    assert len(Run.open(place).forest.trees[0]) == 20
    assert Run.open(place).provenance["status"] == "infeasible"
    assert Run.open(place).metrics["completed"] == 0.0
    assert (place / "figures" / "plan.png").stat().st_size > 0
    assert not (place / "plan.json").exists()
