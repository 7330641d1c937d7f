"""Which packages a command loads: most of its start is imports, and what is not needed is not loaded."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from quick_wind import wind_words

LOADED = (  # packages of others: their files are in a folder of installed packages
    "import atexit, runpy, sys\n"
    "def loaded():\n"
    "    files = {name: getattr(found, '__file__', None) or '' for name, found in sys.modules.items()}\n"
    "    names = {name.partition('.')[0] for name, file in files.items() if '-packages' in file}\n"
    "    open(sys.argv[1], 'w').write(' '.join(sorted(name for name in names if name[0] != '_')))\n"
    "atexit.register(loaded)\n"
    "place, sys.argv = sys.argv[1], ['pareto-ltl', *sys.argv[2:]]\n"
    "runpy.run_module('pareto_ltl', run_name='__main__')\n"
).replace("sys.argv[1], 'w'", "place, 'w'")
SETTINGS = {"yaml"}
COMPOSED = SETTINGS | {"hydra", "hydra_plugins", "omegaconf", "antlr4", "attr", "packaging"}
FIGURES = {"matplotlib", "PIL", "jinja2", "contourpy", "kiwisolver", "mpl_toolkits"}
SLOW = {"sklearn", "xarray", "pandas", "pymavlink", "starlette", "uvicorn", "joblib", "dask"}
PLANNER = {"numba", "llvmlite", "cvxpy", "clarabel", "shapely", "hydra", "omegaconf"}
SMALL = (
    "+experiment=hop", "fidelity=paper", "planner.trees=2", "planner.n_max=2000", "deployment.runs=10",
    "report=none", *wind_words(),
)  # fmt: skip


def packages_of(place: Path, *words: str, code: int = 0) -> set[str]:
    """The packages of others that a process of the command line has loaded when it ends with ``code``."""
    names = place / "packages"
    done = subprocess.run(
        [sys.executable, "-c", LOADED, str(names), *words],
        cwd=place, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    return set(names.read_text(encoding="utf-8").split())


@pytest.mark.parametrize("words", ["--version", "show --help", "-h", "--help", "plan --help"])
def test_help_loads_the_reader_of_settings_alone(words: str, tmp_path: Path) -> None:
    assert packages_of(tmp_path, *words.split()) <= SETTINGS


@pytest.mark.parametrize(
    ("words", "loaded"),
    [
        ("nothing", set[str]()),
        ("show nowhere", set[str]()),
        ("plan typo=1", COMPOSED),
        ("plan +experiment=phi1 planner.trees=0", COMPOSED),
    ],
)
def test_an_error_loads_no_numerical_package(words: str, loaded: set[str], tmp_path: Path) -> None:
    assert packages_of(tmp_path, *words.split(), code=2) <= loaded


def test_a_second_plan_loads_no_drawing_and_its_verification_no_planner(tmp_path: Path) -> None:
    packages_of(tmp_path, "plan", *SMALL, "hydra.run.dir=first")  # fits the wind, once
    planned = packages_of(tmp_path, "plan", *SMALL, "hydra.run.dir=plan")
    assert {"numpy", "numba", "hydra"} <= planned
    assert not planned & (FIGURES | SLOW)
    assert not list(tmp_path.glob("plan/figures/*"))
    judged = packages_of(tmp_path, "verify", "plan")
    assert "numpy" in judged
    assert not judged & ((FIGURES | SLOW | PLANNER) - {"jinja2"})
