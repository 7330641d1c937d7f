"""Regions have names in any script; in a formula they stand in quotes where they are not one word."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pareto_ltl
from careful_io.names import joined_names, quoted_name, split_names
from ltlf import Formula, name_fault
from pareto_ltl.logic.automaton import translate
from pareto_ltl.logic.formula import parse_formula
from pareto_ltl.run.plan_run import Run
from pareto_ltl.settings.mission import SceneConfig
from pareto_ltl.support.errors import DataError, FormulaError
from pareto_ltl.world.scene_settings import scene_from_settings
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.formats.hoa_files import read_hoa
from pareto_ltl_verify.formula import read_formula
from problems import box, make_scene

NAMES = ("EFKU CTR", "Päijänne", "F", "until", "a&b | !c", "a$b_{c^ <b>x</b>", "(", "湖")
names = st.text(min_size=1, max_size=30).filter(lambda name: not name_fault(name))


@given(names)
def test_any_name_in_quotes_is_one_proposition_for_planner_and_verifier(name: str) -> None:
    text = f'F "{name}" & !("{name}") U b'
    tree = parse_formula(text)
    assert set(tree.atoms) == {name, "b"}
    assert parse_formula(str(tree)) == tree
    assert str(read_formula(text)) == str(read_formula(str(tree)))
    assert str(("ap", name)) in str(read_formula(text))


@given(st.frozensets(names, max_size=5))
def test_names_in_one_cell_of_a_table_are_read_again(some: frozenset[str]) -> None:
    assert split_names(joined_names(some)) == some


def test_names_of_one_word_stay_as_they_were() -> None:
    assert [quoted_name(name) for name in ("a", "Päijänne", "r2_d2", "EFKU CTR")] == [
        "a", "Päijänne", "r2_d2", '"EFKU CTR"',
    ]  # fmt: skip
    assert joined_names({"b", "a"}) == "a b"
    assert str(Formula("name", name="F")) == '"F"'


def test_an_automaton_keeps_the_names_in_its_file(tmp_path: Path) -> None:
    automaton = translate(" & ".join(f'F "{name}"' for name in NAMES[:3]))
    (tmp_path / "m.hoa").write_text(automaton.to_hoa(), encoding="utf-8")
    assert read_hoa(tmp_path / "m.hoa").atoms == automaton.atoms == tuple(sorted(NAMES[:3]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("F(EFKU CTR)", 'a name with spaces stands in double quotes, as in F "two words"'),
        ('F("EFKU CTR)', "a name in quotes ends with another"),
        ('F ""', "it is empty"),
        ('F " a"', "begins or ends with a space"),
        (f'F "{"x" * 81}"', "80 are the limit"),
    ],
)
def test_a_name_that_cannot_be_read_is_told_with_the_cure(text: str, said: str) -> None:
    with pytest.raises(FormulaError, match=said):
        parse_formula(text)


def test_a_region_whose_name_no_formula_can_hold_is_refused() -> None:
    drawn = SceneConfig(
        name="map", bounds=[[0.0, 0.0], [9e3, 9e3]], start=[1.0, 1.0],
        regions={'a"b': [[1e3, 1e3], [2e3, 1e3], [2e3, 2e3]]},
    )  # fmt: skip
    with pytest.raises(DataError, match="cannot stand in a formula: it holds a quotation mark"):
        scene_from_settings(drawn)


def test_a_mission_over_any_names_is_planned_exported_and_verified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = make_scene({NAMES[0]: box(13, 2, 17, 6), NAMES[5]: box(3, 13, 7, 17)}, start=(2.0, 3.0))
    formula = f'F("{NAMES[0]}" & F "{NAMES[5]}")'
    done = pareto_ltl.plan(
        scene=scene, formula=formula, wind="calm", out=tmp_path / "run", planner={"trees": 2, "n_max": 300},
        refine={"points": 3}, deployment={"runs": 50}, robot={"dt": 100.0, "u_max": 12.0},
    )  # fmt: skip
    assert done.plan.formula == formula
    front = Run.open(tmp_path / "run").front
    seen = frozenset().union(*(label for path in front.paths for label in path.label))
    assert seen == {NAMES[0], NAMES[5]}
    assert run_command_line(["explain", str(tmp_path / "run")]) == 0
    assert f"reach {NAMES[0]}, then {NAMES[5]}" in capsys.readouterr().out
    assert run_command_line(["verify", str(tmp_path / "run"), "--failed-only"]) == 0
    assert "not checked, because the map was given in Python: map: border" in capsys.readouterr().out
