"""Cone forms that runs leave to each other: the same programmes, without cvxpy."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pareto_ltl.planning.refine import kept_forms
from pareto_ltl.planning.refine.cone_form import Statement, cone_form
from pareto_ltl.planning.refine.convex import SmoothingShape, state_smoothing
from pareto_ltl.planning.refine.kept_forms import arrays_of, form_of, forms_are_kept, kept_form
from pareto_ltl.planning.refine.risk_sharing import AllocatedRisk, EqualShares
from patience import PATIENCE
from quick_wind import wind_words
from unmeasured import untraced

TURNED = ((0.8, 0.6), (-0.6, 0.8))
STATEMENTS = {
    "equal shares": partial(state_smoothing, SmoothingShape(8, 2, 4, TURNED, False, EqualShares(2.5))),
    "allocated": partial(state_smoothing, SmoothingShape(8, 2, 4, TURNED, True, AllocatedRisk(0.05))),
}


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PARETO_LTL_CACHE", str(tmp_path))
    return tmp_path


def never() -> Statement:
    raise AssertionError("stated again")


@pytest.mark.parametrize("name", STATEMENTS)
def test_a_form_that_is_read_is_the_one_that_was_made(name: str) -> None:
    made = cone_form(STATEMENTS[name]())
    assert not forms_are_kept()
    kept_form(name, STATEMENTS[name])
    assert forms_are_kept()
    read = kept_form(name, never)
    one, two = arrays_of(made), arrays_of(read)
    assert one.keys() == two.keys()
    for part, array in one.items():
        np.testing.assert_array_equal(array, two[part], strict=True)
    assert read.places == made.places
    assert read.columns == made.columns
    numbers = np.random.default_rng(3).normal(size=len(made.parameters))
    for form in (made, read):
        form.parameters[:] = numbers
    np.testing.assert_array_equal(made.entries @ numbers, read.entries @ numbers)
    np.testing.assert_array_equal(made.cost @ numbers, read.cost @ numbers)
    np.testing.assert_array_equal(made.right_hand_side(), read.right_hand_side())
    assert [(type(cone), cone.dim) for cone in made.cones] == [(type(c), c.dim) for c in read.cones]


def test_other_contents_and_other_code_have_forms_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    state = STATEMENTS["equal shares"]
    kept_form("one", state)
    for content, edition in (("two", kept_forms.edition()), ("one", "of other code")):
        monkeypatch.setattr(kept_forms, "edition", lambda told=edition: told)
        with pytest.raises(AssertionError, match="stated again"):
            kept_form(content, never)
    assert not forms_are_kept()


def test_all_that_a_smoothing_programme_depends_on_is_in_its_content() -> None:
    shapes = [
        SmoothingShape(steps, 2, 4, b_inv, slowest, sharing)
        for steps in (8, 16)
        for b_inv in (TURNED, ((0.1, 0.0), (0.0, 1.0 / 3.0)))
        for slowest in (False, True)
        for sharing in (
            EqualShares(2.5),
            AllocatedRisk(0.05),
            AllocatedRisk(0.050000000000000003),
            AllocatedRisk(0.06),
        )
    ]
    assert len({repr(shape) for shape in shapes}) == len(set(shapes)) == 2 * 2 * 2 * 3


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def empty(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, parameters=np.zeros(3))


@pytest.mark.parametrize("damage", [cut, empty])
def test_a_damaged_form_is_made_again(damage: Callable[[Path], None], cache: Path) -> None:
    kept_form("step", STATEMENTS["equal shares"])
    (path,) = cache.glob("programmes/*.npz")
    before = path.read_bytes()
    damage(path)
    kept_form("step", STATEMENTS["equal shares"])
    assert path.read_bytes() == before


def test_where_nothing_can_be_kept_forms_are_made_each_time(cache: Path) -> None:
    (cache / "programmes").write_text("a file in its place")
    for _ in range(2):
        form = kept_form("step", STATEMENTS["equal shares"])
        assert arrays_of(form).keys() == arrays_of(form_of(arrays_of(form))).keys()


@pytest.mark.parametrize(
    ("fidelity", "imports"), [("paper", ["True", "False"]), ("full", ["False", "False"])]
)
def test_the_second_run_needs_no_cvxpy_and_makes_the_same_plan(
    fidelity: str, imports: list[str], tmp_path: Path
) -> None:
    """Sampled refinement has a solver of its own."""
    code = (
        "import sys\n"
        "from pareto_ltl.cli import hydra_app as app\n"
        "assert app.run_hydra(sys.argv[1:]) == 0\n"
        "print('cvxpy' in sys.modules)\n"
    )
    words = (
        "+experiment=phi1", f"fidelity={fidelity}", *wind_words(), "planner.trees=2",
        "planner.n_max=1500", "refine.flights=50", "selection.draws=50", "selection.runs=50", "report=none",
        "deployment.runs=20",
    )  # fmt: skip
    told, plans = [], []
    for place in ("one", "two"):
        command = [sys.executable, "-c", code, *words, f"hydra.run.dir={place}"]
        done = subprocess.run(
            command,
            cwd=tmp_path,
            env=untraced(),
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        told.append(done.stdout.splitlines()[-1])
        plans.append((tmp_path / place / "plan.json").read_bytes())
    assert told == imports
    assert plans[0] == plans[1]
