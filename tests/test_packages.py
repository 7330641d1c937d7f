"""The locks, the environment that they make, and the tables that describe it."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import platform
import re
import subprocess
import sys
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution, packages_distributions
from pathlib import Path
from types import ModuleType

import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
LARGEST = 780.0  # [MB] of a run's packages
CODE = ("src", "tests", "benchmarks", "docs", "examples", "release")
NOT_IN_A_RUN = {  # packages that a run needs and does not import, and why they are there
    "contourpy": "contours of the wind, in figures that only some runs have",
    "cloudpickle": "joblib imports it where a function is sent to a process",
    "joblib": "processes of studies; scikit-learn imports it where a wind is fitted",
    "markdown-it-py": "rich imports it for text in Markdown",
    "mdurl": "a part of markdown-it-py",
    "narwhals": "scikit-learn imports it for data frames",
    "pygments": "rich imports it for tracebacks and code",
    "psutil": "memory and processes on systems other than Linux",
    "sparsediffpy": "cvxpy-base requires it for programmes that are not convex; it cannot be left out",
    "tzdata": "time zones where the system has none",
}
PLACES = {  # what is not imported by name: where it is run or plugged in, or what cannot do without it
    "build": "Makefile", "import-linter": "Makefile", "mypy": "Makefile", "ruff": "Makefile",
    "uv": "Makefile", "mkdocs": "Makefile", "mkdocs-material": "mkdocs.yml", "mkdocstrings": "mkdocs.yml",
    "pre-commit": "CONTRIBUTING.md", "pytest-benchmark": "benchmarks", "pytest-cov": "Makefile",
    "pytest-xdist": "Makefile", "hydra-joblib-launcher": "conf/hydra/launcher",
    "hydra-submitit-launcher": "conf/hydra/launcher", "ipykernel": "benchmarks/notebooks.py",
    "eccodeslib": "the library of eccodes", "eckitlib": "a library of eccodeslib",
    "fckitlib": "a library of eccodeslib", "pyserial": "serial ports of pymavlink, which does not require it",
    "deprecated": "stormpy requires it", "wrapt": "deprecated requires it",
    "nodeenv": "pre-commit requires it",
    "mkdocs-material-extensions": "mkdocs-material requires it", "lxml": "fastkml[lxml]",
}  # fmt: skip


def module_of(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "release" / "docs_site" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


packages = module_of("package_tables")


def locked(lock: str) -> dict[str, str]:
    """Versions in ``lock`` that this Python and system need, by name."""
    text = (ROOT / lock).read_text(encoding="utf-8")
    lines = re.findall(r"^([\w.-]+)==([^\s;]+)(?: ; ([^\\\n]+))?", text, re.MULTILINE)
    return {name: version for name, version, marker in lines if not marker or Marker(marker).evaluate()}


@cache
def installed(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


# --- the locks -------------------------------------------------------------------------------


def test_the_lock_of_a_run_has_what_the_core_needs_and_nothing_else() -> None:
    assert set(locked("requirements.lock")) == set(packages.needed())


def test_the_lock_of_development_has_the_other_in_the_same_versions() -> None:
    run, everything = locked("requirements.lock"), locked("requirements-dev.lock")
    assert everything | run == everything
    for name, version in everything.items():
        if (found := installed(name)) is not None:
            assert found.version == version, name


def test_the_solvers_that_are_not_used_are_not_installed() -> None:
    assert not {"cvxpy", "scs", "osqp", "highspy", "ecos"} & set(locked("requirements-dev.lock"))
    assert not {"xarray", "pandas", "cf-xarray"} & set(locked("requirements.lock"))


# --- what is imported ------------------------------------------------------------------------


def test_a_run_imports_every_package_of_its_lock(tmp_path: Path) -> None:
    """Except those with a reason; with figures, exports, and a wind that is fitted."""
    code = (
        "import json, sys\n"
        "from pareto_ltl_apps.cli.commands import run_command_line\n"
        "code = run_command_line(['+experiment=hop', 'planner.trees=2', 'deployment.runs=50', '--quiet'])\n"
        "print(json.dumps([code, sorted({name.partition('.')[0] for name in sys.modules})]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False,
        env=os.environ | {"PARETO_LTL_CACHE": str(tmp_path / "cache")},
    )  # fmt: skip
    code_, modules = json.loads(done.stdout.splitlines()[-1])
    assert code_ == 0, done.stderr
    providers = packages_distributions()
    imported = {packages.normal(name) for module in modules for name in providers.get(module, ())}
    idle = set(packages.needed()) - imported
    assert idle <= set(NOT_IN_A_RUN)
    assert set(NOT_IN_A_RUN) <= set(packages.needed())


def modules_in(package: Distribution) -> set[str]:
    """Modules that a package installs, as they are imported: ``google.protobuf`` of a shared ``google``."""
    found = set()
    for file in package.files or ():
        parts = file.parts
        if ".." in parts or parts[0].endswith((".dist-info", ".data", ".libs")):
            continue
        if len(parts) > 1 and file.suffix in (".py", ".so", ".pyi"):
            found.add(parts[0])
            found.add(".".join(parts[:2]).partition(".py")[0])
        elif file.suffix in (".py", ".so"):
            found.add(parts[0].partition(".")[0])
    return {name.removesuffix("-stubs") for name in found}


@cache
def imported_here() -> frozenset[str]:
    """Names that our code, tests and pages import."""
    found: set[str] = set()
    for folder in CODE:
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    found.update(alias.name for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    found.update({node.module, *(f"{node.module}.{alias.name}" for alias in node.names)})
                elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "importorskip":
                    found.update(
                        a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)
                    )
    return frozenset(name for whole in found for name in parents(whole))


def parents(name: str) -> list[str]:
    """``a.b.c``: a, a.b and a.b.c."""
    parts = name.split(".")
    return [".".join(parts[:k]) for k in range(1, len(parts) + 1)]


def imports(user: Distribution, modules: set[str]) -> bool:
    """Whether the code of ``user`` imports one of ``modules``, or it has compiled parts that may."""
    pattern = re.compile(
        rb"^[ \t]*(?:from|import)[ \t]+(?:%s)\b"
        % b"|".join(re.escape(name.encode()) for name in sorted(modules)),
        re.MULTILINE,
    )
    for file in user.files or ():
        path = Path(str(file.locate()))
        if file.suffix in (".py", ".pyi") and path.is_file() and pattern.search(path.read_bytes()):
            return True
    return False


def test_nothing_is_installed_that_neither_a_run_nor_a_test_imports() -> None:
    """Directly, or because the code of a package that is imported does; programs and plugins have a place."""
    names = [name for name in locked("requirements-dev.lock") if installed(name) is not None]
    modules = {name: modules_in(distribution(name)) for name in names}
    used = {name for name in names if modules[name] & imported_here() and not _only_namespace(name, modules)}
    used |= {
        name for name in names if name in PLACES or name in packages.needed() or name.startswith("types-")
    }
    used |= {name for name in names if name.endswith("-stubs")}
    waiting = list(used)
    while waiting:
        user = distribution(waiting.pop())
        for line in user.requires or ():
            name = packages.normal(Requirement(line).name)
            if name in modules and name not in used and imports(user, modules[name]):
                used.add(name)
                waiting.append(name)
    assert sorted(set(names) - used) == []


def _only_namespace(name: str, modules: dict[str, set[str]]) -> bool:
    """Whether what is imported of a package is a folder that other packages share."""
    both = modules[name] & imported_here()
    return all(any(module in theirs for other, theirs in modules.items() if other != name) for module in both)


# --- the page --------------------------------------------------------------------------------


def test_the_tables_have_every_package_with_its_licence_and_the_page_their_sum() -> None:
    core = packages.needed()
    tables = packages.tables()
    assert packages.MARK in PAGE
    for name, (package, _) in core.items():
        size = f"{packages.megabytes(package):.1f}"
        row = re.search(rf"^\| ({name} \| .*|[^|`]+ \| (?:.*, )?{name} {size}.*) \|$", tables, re.MULTILINE)
        assert row, name
        assert packages.licence(package) in row[0], name
    licences = {name: packages.licence(package) for name, (package, _) in core.items()}
    assert "not stated" not in licences.values()
    assert {name for name, found in licences.items() if re.search(r"\b[AL]?GPL", found)} == {"moocore"}
    assert "**moocore is LGPL-2.1-or-later**" in PAGE
    total = sum(packages.megabytes(package) for package, _ in core.values())
    assert total <= LARGEST
    stated = re.search(r"(\d+) packages, (\d+) MB \(Python ([\d.]+), (\w+ \w+)\)", PAGE)
    assert stated
    python = ".".join(map(str, sys.version_info[:2]))
    if stated.groups()[2:] == (python, f"{platform.system()} {platform.machine()}"):
        assert int(stated[1]) == len(core)
        assert int(stated[2]) == pytest.approx(total, rel=0.05)


def test_the_tables_have_every_extra_with_its_packages() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \| [^|]+ \| [\d.]+ \| ([^|]+) \|$", packages.tables(), re.MULTILINE))
    assert set(rows) == set(packages.EXTRAS)
    core = packages.needed()
    for extra, text in rows.items():
        assert set(text.split(", ")) == set(packages.needed((extra,))) - set(core), extra


def test_every_requirement_of_the_core_has_a_purpose() -> None:
    direct = {name for name, (_, users) in packages.needed().items() if packages.PROJECT in users}
    assert direct == set(packages.PURPOSES)
