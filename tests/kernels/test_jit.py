"""Models by type: every model has its code, and one without is named."""

from __future__ import annotations

import ast
import importlib
import pkgutil
from pathlib import Path
from typing import NamedTuple, get_args

import pytest
from numba import config

import pareto_ltl.kernels
import plane_kernels
import plane_logic
from pareto_ltl.kernels import data, flight, pilots
from pareto_ltl.planning import evaluate
from pareto_ltl.settings.fidelity import LAWS
from pareto_ltl.simulation import flights
from plane_kernels.types import CollisionBound
from plane_logic.claim_lists import ClaimLists
from plane_logic.claim_rows import ClaimRows
from typed_kernels.jit import IMPLEMENTATIONS, by_type, implements, kernel

FOLDERS = {
    package.__name__: Path(package.__path__[0])
    for package in (pareto_ltl.kernels, plane_kernels, plane_logic)
}
for package, folder in FOLDERS.items():
    for module in pkgutil.iter_modules([str(folder)]):
        importlib.import_module(f"{package}.{module.name}")
PACKAGED = [chosen for chosen in IMPLEMENTATIONS.values() if chosen.chosen.__module__ != __name__]

FAMILIES = {
    "law": set(get_args(data.Law)),
    "collision": set(get_args(CollisionBound)),
    "draws": {flight.IndependentDraws, flight.CoherentDraws, flight.LinearDraws},
    "pilot": {pilots.Autopilot, pilots.Navigator, pilots.ErringPilot, pilots.RejoiningPilot},
    "claims": {ClaimLists, ClaimRows},
}
CHOSEN_BY = {
    "law": {"advance", "forget", "note_linear_law", "add_lure", "with_errors"},
    "collision": {"step_allowed"},
    "draws": {"meet_winds"},
    "pilot": {"begin_flights", "observe", "command"},
    "claims": {"mission_margins"},
}  # fmt: skip


class Square(NamedTuple):
    """A model with code."""

    side: float


class Circle(NamedTuple):
    """A model with other code."""

    radius: float


class Stranger(NamedTuple):
    """A model that nobody wrote code for."""

    size: float


@by_type
def area(model):
    """Area of a model."""


@implements(area, Square)
def _square_area(model):
    return model.side * model.side


@implements(area, Circle)
def _circle_area(model):
    return 3.0 * model.radius * model.radius


def twice_the_area(model):
    return 2.0 * area(model)


def test_the_type_of_the_first_argument_picks_the_code():
    compiled = kernel(twice_the_area)
    for road in (twice_the_area, compiled):
        assert road(Square(3.0)) == 18.0
        assert road(Circle(2.0)) == 24.0


def test_a_model_without_code_is_named_with_those_that_have_it():
    expected = r"area has no code for Stranger, only for Circle, Square; add it with @implements\(area, "
    with pytest.raises(TypeError, match=expected):
        twice_the_area(Stranger(1.0))
    if not config.DISABLE_JIT:
        from numba.core.errors import TypingError

        with pytest.raises(TypingError, match=expected):
            kernel(twice_the_area)(Stranger(1.0))


def test_every_function_has_code_for_every_model_of_its_family():
    found = {chosen.chosen.__name__: set(chosen.implementations) for chosen in PACKAGED}
    expected = {name: FAMILIES[family] for family, names in CHOSEN_BY.items() for name in names}
    assert found == expected


def test_every_model_has_its_memory_its_strategy_and_its_name():
    assert set(evaluate.LAW_MEMORY) == FAMILIES["law"]
    assert set(flights.DRAWS) == set(LAWS)


HELPERS = {"kernel", "inlined", "vector"}  # a run that calls one from Python compiles a second copy of it


def sources_of_kernels():
    """Package and path of each module."""
    for package, folder in FOLDERS.items():
        for path in sorted(folder.glob("*.py")):
            yield package, path


def marked_functions(wanted):
    """The functions of kernels with one of the decorators ``wanted``, as ``module.name``."""
    for package, path in sources_of_kernels():
        for node in ast.parse(path.read_text()).body:
            marks = {getattr(mark, "id", "") for mark in getattr(node, "decorator_list", ())}
            if marks & wanted:
                yield f"{package}.{path.stem}.{node.name}"


def kernels_read(path):
    """What the Python file ``path`` reads of the modules of kernels, as ``module.name``."""
    tree, modules = ast.parse(path.read_text()), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(tuple(FOLDERS)):
            for alias in node.names:
                modules[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    yield from modules.values()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            yield f"{modules[node.value.id]}.{node.attr}"


def test_python_calls_no_helper_of_kernels():
    helpers = set(marked_functions(HELPERS))
    assert "pareto_ltl.kernels.motion.left_time" in helpers
    package = Path(pareto_ltl.kernels.__path__[0]).parent
    called = {
        str(path.relative_to(package)): found
        for path in package.rglob("*.py")
        if path.parent.name != "kernels" and (found := helpers & set(kernels_read(path)))
    }
    assert called == {}


def called_kernels(entries):
    """Calls of the functions ``entries`` in the folders of kernels."""
    for _, path in sources_of_kernels():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call):
                name = getattr(node.func, "id", getattr(node.func, "attr", ""))
                yield from [f"{path.stem} calls {name}"] * (name in entries)


def test_only_shared_kernels_are_called_by_others():
    """The code of the others on disk has no form that could be built into a kernel."""
    shared, own = (
        {name.rpartition(".")[2] for name in marked_functions(marks)}
        for marks in ({"shared_entry", "allocating"}, {"entry"})
    )
    assert list(called_kernels(own)) == []
    assert "descent calls smoothed_failure" in list(called_kernels(shared))
