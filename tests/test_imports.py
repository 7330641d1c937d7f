"""No module needs itself to be imported: imports that run when a module is loaded form no circle."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import networkx as nx
import pytest

SOURCE = Path(__file__).parents[1] / "src"


def modules(package: Path) -> dict[str, Path]:
    """The files of a package by the names of their modules."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def loaded(body: list[ast.stmt]) -> Iterator[ast.Import | ast.ImportFrom]:
    """The imports that run when a module is loaded: not those of functions and for type checkers."""
    for statement in body:
        if isinstance(statement, ast.Import | ast.ImportFrom):
            yield statement
        elif isinstance(statement, ast.If):
            if "TYPE_CHECKING" not in ast.dump(statement.test):
                yield from loaded(statement.body)
            yield from loaded(statement.orelse)
        elif isinstance(statement, ast.Try | ast.With | ast.ClassDef):
            yield from loaded(statement.body)


def import_graph(package: Path) -> nx.DiGraph:
    """An arrow from each module to those that it imports."""
    known = modules(package)
    graph = nx.DiGraph()
    for name, path in known.items():
        for statement in loaded(ast.parse(path.read_text(encoding="utf-8")).body):
            if isinstance(statement, ast.Import):
                targets = [alias.name for alias in statement.names]
            else:
                inside = [f"{statement.module}.{alias.name}" for alias in statement.names]
                targets = [full if full in known else str(statement.module) for full in inside]
            graph.add_edges_from((name, target) for target in targets if target in known)
    return graph


def circles(package: Path) -> list[list[str]]:
    """Modules that import each other, in groups."""
    graph = import_graph(package)
    groups = (sorted(group) for group in nx.strongly_connected_components(graph) if len(group) > 1)
    return sorted([*groups, *([name] for name in nx.nodes_with_selfloops(graph))])


@pytest.mark.parametrize(
    "package",
    [
        "pareto_ltl",
        "pareto_ltl_apps",
        "pareto_ltl_verify",
        "careful_io",
        "flight_quantities",
        "declared_settings",
        "ltlf",
        "plane_kernels",
        "plane_logic",
        "typed_kernels",
        "wind_laws",
        "hydra_plugins",
    ],
)
def test_no_modules_import_each_other(package: str) -> None:
    assert circles(SOURCE / package) == []


def test_a_circle_is_found_and_imports_of_functions_and_types_are_none(tmp_path: Path) -> None:
    made = tmp_path / "made"
    made.mkdir()
    late = "def f():\n    from made import a\n"
    typed = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from made import a\n"
    texts = {
        "a": "from made.b import y\n",
        "b": "try:\n    from made import c\nexcept ImportError:\n    y = 1\n",
    }
    for name, text in (
        texts | {"c": "import made.a\n", "d": late + typed, "e": "from made import d\n"}
    ).items():
        (made / f"{name}.py").write_text(text)
    assert circles(made) == [["made.a", "made.b", "made.c"]]
