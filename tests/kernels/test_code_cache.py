"""Machine code on disk: reused where nothing that it can reach has changed, and only there."""

from __future__ import annotations

import ast
import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pareto_ltl.kernels import code_cache
from pareto_ltl.kernels.code_cache import FOREIGN, KERNELS, CodeStamp, reachable_sources
from pareto_ltl.kernels.jit import IMPLEMENTATIONS, by_type, implements, source_file
from pareto_ltl.kernels.parents import improves
from unmeasured import untraced

PROGRAM = """
import numpy as np
from pareto_ltl.kernels.geometry import locate_cells
from problems import paper_problem
world = paper_problem("phi1").world
print(locate_cells(world.mission.cells, np.array([[1e9, 1e9], [1e5, 1e5]])).tolist())
print(sum(locate_cells.stats.cache_hits.values()), sum(locate_cells.stats.cache_misses.values()))
"""


def names(file: str) -> set[str]:
    return {source.stem for source in reachable_sources(KERNELS / file)}


def test_a_file_reaches_what_it_imports_directly_or_through_others():
    assert {"growth", "tree", "tree_models", "collision_risk", "polygon", "data", "jit"} <= names("growth.py")
    assert not {"margin", "flight", "visibility", "importance"} & names("growth.py")
    assert "growth" not in names("margin.py")


def test_modules_that_a_file_imports_as_such_are_reached():
    assert {"claim_lists", "claim_rows"} <= names("margin.py")


@pytest.mark.parametrize("file", sorted(KERNELS.glob("*.py")), ids=lambda file: file.stem)
def test_the_pattern_of_imports_finds_what_the_parser_finds(file):
    found = [node for node in ast.walk(ast.parse(file.read_bytes())) if isinstance(node, ast.ImportFrom)]
    modules = {node.module for node in found}
    modules |= {f"{node.module}.{alias.name}" for node in found for alias in node.names}
    kernels = {KERNELS / f"{name.rpartition('.')[2]}.py" for name in modules if "pareto_ltl.kernels." in name}
    assert {source for source in kernels if source.is_file()} | {file} == {
        *code_cache.imported_kernels(file),
        file,
    }


ENTRIES = [
    file
    for file in sorted(KERNELS.glob("*.py"))
    if re.search(r"^@(entry|allocating)", file.read_text(), re.M)
]


@pytest.mark.parametrize("file", ENTRIES, ids=lambda file: file.stem)
def test_a_file_that_reaches_a_choice_reaches_the_code_of_every_model(file):
    reached = reachable_sources(file)
    for chosen in IMPLEMENTATIONS.values():
        file = source_file(chosen.chosen)
        if file in reached:
            codes = {source_file(code) for code in chosen.implementations.values()}
            assert codes <= reached | FOREIGN.get(file, set())


def test_code_that_others_add_to_a_model_changes_the_stamps_of_what_can_reach_it(monkeypatch):
    reaching, other = CodeStamp(KERNELS / "growth.py"), CodeStamp(KERNELS / "visibility.py")
    before = str(reaching), str(other)
    assert KERNELS / "parents.py" in reachable_sources(reaching.file) - reachable_sources(other.file)
    monkeypatch.setitem(FOREIGN, KERNELS / "parents.py", set())
    chosen = IMPLEMENTATIONS[improves]
    monkeypatch.setattr(chosen, "implementations", dict(chosen.implementations))
    implements(improves, complex)(lambda rule, risks, new, old, strict: True)
    assert FOREIGN[KERNELS / "parents.py"] == {Path(__file__)}
    assert str(reaching) != before[0]
    assert str(other) == before[1]


def test_a_function_of_another_package_changes_no_stamp():
    stamp = CodeStamp(KERNELS / "growth.py")
    before = str(stamp)

    @by_type
    def volume(model):
        """Volume of a model."""

    implements(volume, float)(lambda model: model)
    assert FOREIGN[Path(__file__)] == {Path(__file__)}
    assert str(stamp) == before


def test_a_stamp_is_a_string_on_disk_and_equal_to_it():
    stamp = CodeStamp(KERNELS / "growth.py")
    saved = pickle.loads(pickle.dumps(stamp))
    assert type(saved) is str
    assert saved == stamp
    assert CodeStamp(KERNELS / "margin.py") != saved


@pytest.fixture
def program(tmp_path):
    """Runs PROGRAM on a copy of the package; returns its first line, and whether its code was on disk."""
    package = tmp_path / "src" / "pareto_ltl"
    shutil.copytree(KERNELS.parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in ("conf", "pipelines"):
        shutil.copytree(KERNELS.parents[2] / folder, tmp_path / folder)
    tests = Path(__file__).parents[1]
    surroundings = untraced(
        PYTHONPATH=os.pathsep.join(map(str, (package.parent, tests))), NUMBA_DISABLE_JIT="0",
        NUMBA_CACHE_DIR=str(tmp_path / "code"), PYTHONDONTWRITEBYTECODE="1",
    )  # fmt: skip

    def run() -> tuple[str, str]:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=surroundings, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        found, counts = done.stdout.splitlines()
        return found, {"1 0": "reused", "0 1": "compiled"}[counts]

    return run, package / "kernels"


def test_a_change_compiles_anew_what_it_can_reach_and_nothing_else(program):
    run, kernels = program
    assert run() == ("[-1, 18]", "compiled")
    assert run() == ("[-1, 18]", "reused")

    other = kernels / "margin.py"
    other.write_text(other.read_text() + "\n# another kernel\n")
    assert run() == ("[-1, 18]", "reused")

    helper = kernels / "data.py"  # locate_cells is in geometry.py, which imports it
    helper.write_text(helper.read_text() + "\n# a file that it reaches\n")
    assert run() == ("[-1, 18]", "compiled")
    assert run() == ("[-1, 18]", "reused")


def test_code_for_types_that_are_gone_is_removed_and_never_read(program):
    """Numba's index names types: reading one of a type without a class would end the program."""
    run, kernels = program
    assert run() == ("[-1, 18]", "compiled")
    code = kernels.parents[2] / "code"
    old = set(code.rglob("*locate_cells*.nb?"))
    assert old
    for source in kernels.parent.rglob("*.py"):
        source.write_text(re.sub(r"\bCells\b", "CellTable", source.read_text()))
    assert run() == ("[-1, 18]", "compiled")
    assert run() == ("[-1, 18]", "reused")
    assert not any(file.exists() for file in old)


def test_the_settings_of_numba_are_as_before():
    before = code_cache.config.CACHE_LOCATOR_CLASSES
    with code_cache.stamped_by_source():
        assert code_cache.config.CACHE_LOCATOR_CLASSES == code_cache.LOCATORS
    assert before == code_cache.config.CACHE_LOCATOR_CLASSES
