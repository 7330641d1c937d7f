"""The runner: stages in order, streams by name, checks before anything is made."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import small_study
from pareto_ltl.planning.records import Forest
from pareto_ltl.run import front_stage
from pareto_ltl.run.pipeline import Pipeline, carry_out, known_stages, make_all
from pareto_ltl.run.plan_run import Run
from pareto_ltl.run.record import BaseRun, Record, record
from pareto_ltl.settings import (
    MissionConfig,
    PlannerConfig,
    SceneConfig,
    SelectionConfig,
    Settings,
    WindConfig,
    preset,
)
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.resources import CONF
from pareto_ltl.support.seeds import stage_seeds


def listing(*names: str, **changes: Any) -> Settings:
    """Settings whose pipeline lists ``names``."""
    settings = Settings(**changes)
    settings.pipelines.stages = list(names)
    return settings


def phi1() -> SceneConfig:
    """The map of phi1, in the area of the packaged wind."""
    return SceneConfig(**yaml.safe_load(CONF.file("scene", "phi1").read_text()))


class Kitchen(BaseRun):
    """A run of three records; it notes what it makes, in ``records["made"]``."""

    @record()
    def flour(self) -> str:
        """Flour."""
        self.records["made"].append("flour")
        return "flour"

    @record()
    def dough(self) -> str:
        """Dough."""
        flour = self.flour
        self.records["made"].append("dough")
        return flour + " dough"

    @record(stage="baking")
    def bread(self) -> str:
        """Bread."""
        dough, flour = self.dough, self.flour
        self.records["made"].append("bread")
        return f"bread of {dough} on {flour} with {self.get('crumbs')}"

    @record()
    def crumbs(self) -> str:
        """Crumbs."""
        return self.bread[:3]


STAGES = tuple(Kitchen.rows().values())


def kitchen(**given: str) -> tuple[Kitchen, list[str]]:
    """A run, and what it has made."""
    made: list[str] = []
    return Kitchen(Settings(), {"made": made, **given}), made


# --- checks ------------------------------------------------------------------------------------


@pytest.mark.parametrize("names", [("flour", "dough", "baking"), ("baking", "flour", "dough")])
def test_stages_run_in_the_order_of_the_list_after_what_they_need(names: tuple[str, ...]) -> None:
    run, made = kitchen()
    make_all(run, Pipeline.of(listing(*names), STAGES).stages)
    assert made == ["flour", "dough", "bread"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "pipelines.stages is empty: list at least one of flour, dough, baking"),
        (("flour", "cake"), "there is no stage 'cake'; there are flour, dough, baking"),
        (("flour", "flour"), "lists 'flour' twice; list it once"),
    ],
)
def test_a_list_that_cannot_run_is_refused(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Pipeline.of(listing(*names), STAGES)


@pytest.mark.parametrize(
    ("record_name", "changes", "message"),
    [
        ("scene", {}, "scene is missing: choose a ready mission"),
        ("automaton", {"scene": phi1()}, r"mission\.formula is missing"),
    ],
)
def test_a_map_or_a_formula_that_is_missing_is_named_whatever_asks_for_it(
    record_name: str, changes: dict[str, Any], message: str
) -> None:
    settings = listing(record_name, **changes)
    with pytest.raises(ConfigError, match=message):
        Pipeline.of(settings)
    with pytest.raises(ConfigError, match=message):
        Run(replace(settings, wind=WindConfig(source="calm"))).make("plan")


def test_the_formula_is_parsed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from ltlf import formula

    parsed: list[str] = []
    original = formula.FormulaParser.__init__

    def counted(self: Any, text: str, advice: Any) -> None:
        parsed.append(text)
        original(self, text, advice)

    formula._parsed.cache_clear()  # noqa: SLF001
    monkeypatch.setattr(formula.FormulaParser, "__init__", counted)
    cfg = small_study.settings()
    cfg.scene.bounds = [[0, 0], [1, 1]]
    cfg.pipelines.stages = ["readings", "scene", "decomposition", "automaton"]
    Pipeline.of(cfg)
    small_study.world(cfg)
    assert parsed == ["F(a & F b)"]


def test_each_wind_file_is_opened_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pareto_ltl_apps.formats import csv_files

    opened: list[Path] = []
    original = csv_files.read_csv_file

    def counted(file: Path, *more: Any) -> Any:
        opened.append(file)
        return original(file, *more)

    monkeypatch.setattr(csv_files, "read_csv_file", counted)
    settings = listing("readings", "scene", "decomposition", "observations", "wind")
    settings.scene = phi1()
    Pipeline.of(settings).run(tmp_path)
    assert len(opened) == 1


@pytest.mark.parametrize("stage", known_stages(), ids=lambda stage: stage.stage)
def test_a_stage_says_what_it_makes(stage: Record[Any]) -> None:
    assert stage.__doc__


# --- streams -----------------------------------------------------------------------------------


def test_a_stream_is_the_same_in_every_pipeline_and_from_its_beginning() -> None:
    @record()
    def dice(run: BaseRun) -> list[int]:
        run.seeds("dice").spawn(3)
        return [int(n) for n in run.seeds("dice").generate_state(4)]

    @record()
    def other(run: BaseRun) -> list[int]:
        return [int(n) for n in run.seeds("other").generate_state(4)]

    drawn = []
    for listed in ((dice,), (other, dice)):
        run = Kitchen(Settings(seed=5))
        make_all(run, listed)
        drawn.append(run.records)
    assert drawn[0]["dice"] == drawn[1]["dice"]
    assert drawn[1]["other"] != drawn[1]["dice"]


def test_the_streams_of_a_plan_are_those_of_the_first_version() -> None:
    from zlib import crc32

    assert stage_seeds(7, "forest").spawn_key == (crc32(b"forest"),)
    assert stage_seeds(7, "forest").entropy == 7


# --- runs in memory ----------------------------------------------------------------------------


def test_a_record_is_made_when_asked_for_with_all_that_it_needs_and_once() -> None:
    run, made = kitchen()
    assert run.bread == "bread of flour dough on flour with None"
    assert run.dough == "flour dough"
    assert made == ["flour", "dough", "bread"]
    assert list(run.seconds) == ["flour", "dough", "baking"]


def test_the_time_of_a_record_is_without_those_that_it_waited_for() -> None:
    class Slow(BaseRun):
        @record()
        def first(self) -> int:
            time.sleep(0.2)
            return 1

        @record()
        def second(self) -> int:
            return self.first + 1

    run = Slow(Settings())
    assert run.second == 2
    assert run.seconds["first"] >= 0.2
    assert run.seconds["second"] < 0.1


def test_a_record_that_was_given_is_not_made_and_what_follows_from_it_is() -> None:
    run, made = kitchen(dough="my dough")
    assert run.bread.startswith("bread of my dough")
    assert made == ["flour", "bread"]
    other = run.given(dough="rye")
    assert (other.dough, run.dough) == ("rye", "my dough")
    assert other.bread.startswith("bread of rye")
    assert made == ["flour", "bread", "bread"]
    with pytest.raises(TypeError, match="a run has no record 'cake'; it has flour, dough, bread, crumbs"):
        run.given(cake="round")


def test_another_seed_keeps_the_records_and_leaves_the_first_run_alone() -> None:
    run, made = kitchen()
    run.make("flour")
    other = run.with_seed(9)
    other.make("bread")
    assert other.settings.seed == other.settings.search_seed == 9
    assert run.settings.search_seed == 0
    assert "bread" not in run.records
    assert made == ["flour", "dough", "bread"]


def test_a_run_without_a_directory_writes_nothing_and_says_so() -> None:
    with pytest.raises(ConfigError, match="this record is files: give the run a results directory"):
        Kitchen(Settings()).made(Record(lambda run: run.place, "writer"))


def test_a_record_that_cannot_be_is_tried_once() -> None:
    tried: list[str] = []

    class Hopeless(BaseRun):
        @record()
        def way(self) -> int:
            tried.append("way")
            raise InfeasibleError("no way")

        @record()
        def end(self) -> int:
            return self.way

    run = Hopeless(Settings())
    for name in ("end", "way", "end"):
        with pytest.raises(InfeasibleError, match="no way"):
            run.make(name)
    assert tried == ["way"]
    assert list(run.seconds) == ["way"]
    assert run.failure == "no way"


def test_a_run_in_a_directory_is_read_back_and_nothing_is_made_or_written(tmp_path: Path) -> None:
    settings = listing("scene", "decomposition", "wind", scene=phi1(), wind=WindConfig(source="calm"))
    Pipeline.of(settings).run(tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    run = Run.open(tmp_path)
    assert run.records == {}
    assert run.scene.regions.keys() == {"a", "b", "c"}
    assert run.get("plan") is None
    with pytest.raises(DataError, match=r"automaton\.json"):
        run.make("problem")
    with pytest.raises(DataError, match="has no readings of winds"):
        run.make("readings")
    assert run.seconds.keys() == {"problem", "readings"}
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before
    other = run.given(wind=run.wind)
    with pytest.raises(DataError, match=r"automaton\.json"):
        other.make("plan")  # the files of what follows from the wind are not read


# --- how runs end ------------------------------------------------------------------------------


def test_the_answer_comes_after_all_records_and_before_figures(tmp_path: Path) -> None:
    order = list[str]()

    def stage(name: str, writes: tuple[str, ...], shows: tuple[str, ...]) -> Record[None]:
        return Record(lambda _run: order.append(name), name, writes, shows)

    stages = [
        stage("early", (), ("early.png",)),
        stage("table", ("t.csv",), ()),
        stage("both", ("b.csv",), ("b.png",)),
        stage("drawn", (), ("d.png",)),
        stage("page", (), ("p.html",)),
    ]
    run = Run(Settings(), directory=tmp_path)
    carry_out(run, stages, answered=lambda metrics: order.append(f"answer {metrics['completed']:g}"))
    assert order == ["early", "table", "both", "answer 0", "drawn", "page"]
    assert json.loads((tmp_path / "metrics.json").read_text())["seconds_page"] >= 0.0


def test_a_mission_without_a_plan_has_no_answer_and_its_figures(tmp_path: Path) -> None:
    def impossible(_run: Run) -> None:
        raise InfeasibleError("there is no way")

    drawn, told = list[int](), list[object]()
    stages = [
        Record(impossible, "plan2", ("p.csv",)),
        Record(lambda _: drawn.append(1), "draw", (), ("d.png",)),
    ]
    with pytest.raises(InfeasibleError, match="there is no way"):
        carry_out(Run(Settings(), directory=tmp_path), stages, answered=told.append)
    assert (drawn, told) == ([1], [])


def test_an_infeasible_mission_still_gets_its_trees_its_figure_and_metrics(tmp_path: Path) -> None:
    drawn: list[object] = []

    @record(codec=Run.forest.codec)
    def forest(run: Run) -> Forest:
        return Forest((), np.empty((0, 2), np.int64), 0.1)

    @record()
    def front(run: Run) -> Any:
        raise InfeasibleError("no path")

    @record()
    def plan(run: Run) -> Any:
        run.made(front)
        raise AssertionError("a plan without a front")

    @record()
    def report(run: Run) -> str:
        drawn.append(run.get("plan"))
        return "drawn"

    @record()
    def late(run: Run) -> str:
        raise ValueError("only logged")

    stages = (forest, front, plan, report, late)
    settings = listing(*(stage.stage for stage in stages))
    with pytest.raises(InfeasibleError, match="no path"):
        Pipeline(settings, stages).run(tmp_path)
    assert drawn == [None]
    assert "stage late failed after" in (tmp_path / "run.log").read_text()
    assert "seconds_plan" not in json.loads((tmp_path / "metrics.json").read_text())
    assert (tmp_path / "trees.npz").is_file()
    assert json.loads((tmp_path / "metrics.json").read_text())["completed"] == 0.0
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "infeasible"


def test_numbers_of_a_record_of_ones_own_are_metrics(tmp_path: Path) -> None:
    class Loaf:
        numbers = {"crust_mm": 4.0}  # noqa: RUF012

    @record()
    def bake(run: Run) -> Loaf:
        return Loaf()

    table = Pipeline(listing("bake"), (bake,)).run(tmp_path)
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
    assert Run(settings).front.paths
    assert "only paths of the search trees are left: the nearest line cannot be flown" in caplog.text
    none = replace(settings, planner=PlannerConfig(trees=1, n_max=2))
    if models.judge == "flights":
        assert all("line" in path.origin for path in Run(none).front.paths)
        return
    with pytest.raises(InfeasibleError) as told:
        Run(none).make("front")
    assert "the nearest line cannot be flown" not in str(told.value)
