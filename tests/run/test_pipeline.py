"""The runner: stages in order, streams by name, checks before anything is made."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import small_study
from pareto_ltl.planning.records import Forest, Front, Plan
from pareto_ltl.run import front_stage
from pareto_ltl.run.pipeline import Pipeline, Run, check_pipeline, make_all, run_pipeline
from pareto_ltl.run.records import (
    FOREST,
    FRONT,
    PLAN,
    RecordKey,
    Records,
)
from pareto_ltl.run.stage_table import Stage, StageInputs, StageTable, stage_seeds
from pareto_ltl.run.stages import PLAN_STAGES, PLAN_TABLE
from pareto_ltl.settings import (
    DeploymentConfig,
    IngestConfig,
    MissionConfig,
    PlannerConfig,
    RefineConfig,
    ReportConfig,
    SceneConfig,
    SelectionConfig,
    Settings,
    SmoothingConfig,
    WindConfig,
    preset,
)
from pareto_ltl.studies.stages import STUDY_STAGES
from pareto_ltl.support.errors import ConfigError, InfeasibleError
from pareto_ltl.support.resources import choice_file
from quick_wind import QUICK_WIND

FLOUR = RecordKey[str]("flour")
DOUGH = RecordKey[str]("dough")
BREAD = RecordKey[str]("bread")
CRUMBS = RecordKey[str]("crumbs")


def listing(*names: str, **changes: Any) -> Settings:
    """Settings whose pipeline lists ``names``."""
    settings = Settings(**changes)
    settings.pipelines.stages = list(names)
    return settings


def phi1() -> SceneConfig:
    """The map of phi1, in the area of the packaged wind."""
    return SceneConfig(**yaml.safe_load(choice_file("scene", "phi1").read_text()))


def kitchen(made: list[str]) -> StageTable:
    """Three stages that note what they make."""

    def flour(inputs: StageInputs) -> str:
        made.append("flour")
        return "flour"

    def dough(inputs: StageInputs) -> str:
        made.append("dough")
        return inputs[FLOUR] + " dough"

    def bread(inputs: StageInputs) -> str:
        made.append("bread")
        return f"bread of {inputs[DOUGH]} on {inputs[FLOUR]} with {inputs.get(CRUMBS)}"

    return StageTable(
        [
            Stage(makes=FLOUR, make=flour),
            Stage(makes=DOUGH, make=dough, needs=(FLOUR,)),
            Stage(makes=BREAD, make=bread, needs=(DOUGH, FLOUR), uses=(CRUMBS,)),
        ]
    )


# --- checks ------------------------------------------------------------------------------------


def test_stages_run_in_the_order_of_the_list(tmp_path: Path) -> None:
    made: list[str] = []
    table = kitchen(made)
    run_pipeline(check_pipeline(listing("flour", "dough", "bread"), table), tmp_path / "out")
    assert made == ["flour", "dough", "bread"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "pipelines.stages is empty: list at least one of flour, dough, bread"),
        (("flour", "cake"), "there is no stage 'cake'; there are flour, dough, bread"),
        (("flour", "flour"), "lists 'flour' twice; list it once"),
        (("bread", "dough"), "'bread' needs dough, flour, which no earlier stage makes; list them before"),
        (("flour", "bread"), "'bread' needs dough, which no earlier stage makes; list it before 'bread'"),
    ],
)
def test_a_list_that_cannot_run_is_refused_before_anything_is_made(
    names: tuple[str, ...], message: str
) -> None:
    made: list[str] = []
    with pytest.raises(ConfigError, match=message):
        check_pipeline(listing(*names), kitchen(made))
    assert made == []


def test_the_formula_is_parsed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from pareto_ltl.logic import formula

    parsed: list[str] = []
    original = formula.FormulaParser.__init__

    def counted(self: Any, text: str) -> None:
        parsed.append(text)
        original(self, text)

    formula._parsed.cache_clear()  # noqa: SLF001
    monkeypatch.setattr(formula.FormulaParser, "__init__", counted)
    cfg = small_study.settings()
    cfg.scene.bounds = [[0, 0], [1, 1]]
    cfg.pipelines.stages = ["readings", "scene", "decomposition", "automaton"]
    check_pipeline(cfg, PLAN_TABLE)
    small_study.world(cfg)
    assert parsed == ["F(a & F b)"]


def test_each_wind_file_is_opened_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pareto_ltl.wind.sources import csv_files

    opened: list[Path] = []
    original = csv_files.read_csv_file

    def counted(file: Path, *more: Any) -> Any:
        opened.append(file)
        return original(file, *more)

    monkeypatch.setattr(csv_files, "read_csv_file", counted)
    settings = listing("readings", "scene", "decomposition", "observations", "wind")
    settings.scene = phi1()
    run_pipeline(check_pipeline(settings, PLAN_TABLE), tmp_path)
    assert len(opened) == 1


# --- what a stage declares ---------------------------------------------------------------------


@dataclass
class Asked:
    """What a stage asked for."""

    needed: set[RecordKey[Any]] = field(default_factory=set)
    used: set[RecordKey[Any]] = field(default_factory=set)
    drew: bool = False


class Recorder(StageInputs):
    """Inputs that note what a stage asks for."""

    def __init__(self, stage: Stage[Any], run: Run, asked: Asked) -> None:
        super().__init__(stage, run)
        self.asked = asked

    def __getitem__(self, key: RecordKey[Any]) -> Any:
        self.asked.needed.add(key)
        return super().__getitem__(key)

    def get(self, key: RecordKey[Any]) -> Any:
        self.asked.used.add(key)
        return super().get(key)

    @property
    def seeds(self) -> Any:
        self.asked.drew = True
        return super().seeds


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Asked]:
    """What every stage of a plan asks for: paper, full, and a mission without an answer, on phi1's map."""
    place = tmp_path_factory.mktemp("out")
    settings = Settings(
        scene=phi1(),
        fidelity=preset("paper"),
        mission=MissionConfig(formula="F a"),
        planner=PlannerConfig(trees=2, n_max=600),
        smoothing=SmoothingConfig(candidates=1, rounds=1, weights=[10.0]),
        refine=RefineConfig(flights=100, sweep_flights=40, points=3),
        wind=WindConfig(**QUICK_WIND),
        selection=SelectionConfig(draws=50, runs=50),
        deployment=DeploymentConfig(runs=20),
        ingest=IngestConfig(out=str(place / "table.csv"), points=20),
        report=ReportConfig(dpi=30),
    )
    full = replace(settings, fidelity=preset("full"))
    hopeless = replace(settings, planner=PlannerConfig(trees=1, n_max=2))
    seen = {stage.name: Asked() for stage in PLAN_STAGES}
    for each in (settings, full, hopeless):
        run = Run(each, directory=place)
        for stage in PLAN_STAGES:
            with suppress(InfeasibleError, KeyError):  # no front, and then no record of it
                run.records[stage.makes] = stage.make(Recorder(stage, run, seen[stage.name]))
    return seen


@pytest.mark.parametrize("stage", PLAN_STAGES, ids=lambda stage: stage.name)
def test_a_stage_asks_for_exactly_what_it_declares(stage: Stage[Any], recorded: dict[str, Asked]) -> None:
    asked = recorded[stage.name]
    assert asked.needed == set(stage.needs)
    assert asked.used == set(stage.uses)
    assert asked.drew == (stage.stream is not None)


def test_a_record_that_is_not_declared_is_refused() -> None:
    def greedy(inputs: StageInputs) -> str:
        return inputs[FLOUR]

    def curious(inputs: StageInputs) -> str:
        return str(inputs.get(FLOUR))

    def random(inputs: StageInputs) -> str:
        return str(inputs.seeds)

    run = Run(Settings(), records=Records({FLOUR: "flour"}))
    for make, message in ((greedy, "add its key to needs"), (curious, "to uses"), (random, "a stream")):
        with pytest.raises(ValueError, match=message):
            run.perform(Stage(makes=BREAD, make=make))


@pytest.mark.parametrize("stage", [*PLAN_STAGES, *STUDY_STAGES], ids=lambda stage: stage.name)
def test_a_stage_says_what_it_makes(stage: Stage[Any]) -> None:
    assert stage.make.__doc__


# --- streams -----------------------------------------------------------------------------------


def test_a_stage_draws_the_same_numbers_in_every_pipeline() -> None:
    key = {name: RecordKey[list[int]](name) for name in ("dice", "other")}

    def dice(inputs: StageInputs) -> list[int]:
        return [int(n) for n in inputs.seeds.generate_state(4)]

    table = StageTable(
        [
            Stage(makes=key["dice"], make=dice, stream="dice"),
            Stage(makes=key["other"], make=dice, stream="other"),
        ]
    )
    drawn = []
    for listed in (["dice"], ["other", "dice"]):
        checked = check_pipeline(listing(*listed, seed=5), table)
        run = Run(checked.settings, table)
        make_all(run, checked.stages)
        drawn.append(run.records)
    assert drawn[0][key["dice"]] == drawn[1][key["dice"]]
    assert drawn[1][key["other"]] != drawn[1][key["dice"]]


def test_the_streams_of_a_plan_are_those_of_the_first_version() -> None:
    from zlib import crc32

    assert {stage.name: stage.stream for stage in PLAN_STAGES if stage.stream} == {
        name: name for name in ("forest", "front", "plan", "deployment", "export")
    } | {"page": "deployment"}  # points of the front are flown in the winds of the plan
    assert stage_seeds(7, "forest").spawn_key == (crc32(b"forest"),)
    assert stage_seeds(7, "forest").entropy == 7


# --- runs in memory ----------------------------------------------------------------------------


def test_a_record_is_made_on_demand_with_all_that_it_needs_and_once() -> None:
    made: list[str] = []
    run = Run(Settings(), kitchen(made))
    assert run.make(BREAD) == "bread of flour dough on flour with None"
    assert run.make(DOUGH) == "flour dough"
    assert made == ["flour", "dough", "bread"]
    assert list(run.seconds) == made


def test_a_record_that_was_given_is_not_made() -> None:
    made: list[str] = []
    run = Run(Settings(), kitchen(made), Records({DOUGH: "my dough"}))
    assert run.make(BREAD).startswith("bread of my dough")
    assert made == ["flour", "bread"]
    other = run.with_record(DOUGH, "rye")
    assert (other[DOUGH], run[DOUGH]) == ("rye", "my dough")
    with pytest.raises(KeyError, match="no record 'crumbs'; there are"):
        run[CRUMBS]


def test_another_seed_keeps_the_records_and_leaves_the_first_run_alone() -> None:
    made: list[str] = []
    run = Run(Settings(), kitchen(made))
    run.make(FLOUR)
    other = run.with_seed(9)
    other.make(BREAD)
    assert other.settings.seed == 9
    assert BREAD not in run.records
    assert made == ["flour", "dough", "bread"]


def test_a_run_without_a_directory_writes_nothing_and_says_so() -> None:
    def writer(inputs: StageInputs) -> str:
        return str(inputs.directory)

    with pytest.raises(ConfigError, match="'bread' writes files: run it with a results directory"):
        Run(Settings()).perform(Stage(makes=BREAD, make=writer))


# --- how runs end ------------------------------------------------------------------------------


def test_an_infeasible_mission_still_gets_its_trees_its_figure_and_metrics(tmp_path: Path) -> None:
    drawn: list[object] = []

    def forest(inputs: StageInputs) -> Forest:
        return Forest((), np.empty((0, 2), np.int64), 0.1)

    def front(inputs: StageInputs) -> Front:
        raise InfeasibleError("no path")

    def plan(inputs: StageInputs) -> Plan:
        raise AssertionError("a plan without a front")

    def report(inputs: StageInputs) -> str:
        drawn.append(inputs.get(PLAN))
        return "drawn"

    stages = (
        Stage(makes=FOREST, make=forest, codec=PLAN_TABLE["forest"].codec),
        Stage(makes=FRONT, make=front, needs=(FOREST,)),
        Stage(makes=PLAN, make=plan, needs=(FRONT,)),
        Stage(makes=BREAD, make=report, needs=(FOREST,), uses=(PLAN,)),
    )
    settings = listing(*(stage.name for stage in stages))
    with pytest.raises(InfeasibleError, match="no path"):
        run_pipeline(Pipeline(settings, StageTable(stages), stages), tmp_path)
    assert drawn == [None]
    assert (tmp_path / "trees.npz").is_file()
    assert json.loads((tmp_path / "metrics.json").read_text())["completed"] == 0.0
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "infeasible"


def test_numbers_of_a_record_of_ones_own_are_metrics(tmp_path: Path) -> None:
    class Loaf:
        numbers = {"crust_mm": 4.0}  # noqa: RUF012

    def bake(inputs: StageInputs) -> Loaf:
        return Loaf()

    stages = (Stage(makes=RecordKey[Loaf]("bake"), make=bake),)
    table = run_pipeline(Pipeline(listing("bake"), StageTable(stages), stages), tmp_path)
    assert table["crust_mm"] == 4.0
    assert table["completed"] == 0.0


@pytest.mark.parametrize("fidelity", ["paper", "full"])
def test_where_refinement_finds_nothing_that_can_be_flown_the_paths_of_the_trees_stay(
    fidelity: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object) -> tuple[()]:
        raise InfeasibleError("the nearest line cannot be flown")

    models = preset(fidelity)
    monkeypatch.setitem(front_stage.REFINERS, models.refine, refuse)
    settings = Settings(
        scene=phi1(), fidelity=models, mission=MissionConfig(formula="F a"),
        planner=PlannerConfig(trees=2, n_max=600, epsilon=0.5), selection=SelectionConfig(draws=50, runs=50),
    )  # fmt: skip
    assert Run(settings).make(FRONT).paths
    assert "only paths of the search trees are left: the nearest line cannot be flown" in caplog.text
    none = replace(settings, planner=PlannerConfig(trees=1, n_max=2))
    if models.judge == "flights":
        assert all("line" in path.origin for path in Run(none).make(FRONT).paths)
        return
    with pytest.raises(InfeasibleError) as told:
        Run(none).make(FRONT)
    assert "the nearest line cannot be flown" not in str(told.value)
