"""Which tests run while one writes (``make test-fast``), by day (``make test``), before a change is taken in
(``make test-all``) and at night.

``PARETO_LTL_TESTS`` is ``fast``, ``day``, ``all`` (the default) or ``night``. With ``PARETO_LTL_DONE=day``,
all are without the tests that ``make test`` has just run in the same way.
"""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import TypeVar

from hypothesis import settings

LEVEL = os.environ.get("PARETO_LTL_TESTS", "all")
if LEVEL not in ("fast", "day", "all", "night"):
    raise ValueError(f"PARETO_LTL_TESTS must be fast, day, all or night, got {LEVEL!r}")
BY_DAY = LEVEL in ("fast", "day")
DONE_BY_DAY = LEVEL == "all" and os.environ.get("PARETO_LTL_DONE") == "day"  # ``make test`` has just run
AT_NIGHT = LEVEL == "night"
Case = TypeVar("Case")

# Modules of the fast level, and those among them that run kernels or start processes.
FAST = ["logic/*", "settings/*", "support/*", "world/*"]
NOT_FAST = [
    "support/test_cache",
    "support/test_extras",
    "support/test_netcdf4",
    "world/test_cells",
    "world/test_random_maps",
    "world/test_region_names",
]

# Modules that start processes, plan whole missions or read files of every kind: not by day.
NOT_BY_DAY = [
    "test_corpus",
    "test_documented_commands",
    "test_environment",
    "test_packages",
    "test_examples",
    "test_golden",
    "test_machine_code_wheel",
    "test_notebooks",
    "test_platforms",
    "exports/test_edges",
    "fuzz/*",
    "kernels/test_code_cache",
    "studies/*",
    "cli/test_budget",
    "cli/test_commands",
    "cli/test_help",
    "cli/test_hydra_app",
    "cli/test_rerun",
    "cli/test_wind_error",
    "cli/test_wind_table",
    "inflight/test_command",
    "inflight/test_link",
    "inflight/test_mavsdk",
    "inflight/test_session",
    "planning/test_choices",
    "planning/test_front_sweep",
    "planning/test_no_path",
    "planning/test_power",
    "planning/test_programme",
    "planning/test_search_map",
    "planning/test_smoothing_large",
    "planning/test_timed_trees",
    "planning/test_uncompiled_plans",
    "report/test_command_output",
    "report/test_figures",
    "report/test_legs",
    "report/test_page_browser",
    "report/test_limits",
    "report/test_texts",
    "run/test_choosing",
    "run/test_directory",
    "run/test_documents",
    "run/test_exporting",
    "run/test_faults",
    "run/test_interface",
    "run/test_nothing_received_acts",
    "run/test_replan_inputs",
    "run/test_replanning",
    "run/test_steering",
    "run/test_vehicles",
    "run/test_warmup",
    "run/test_whole_jobs",
    "serve/test_allowed",
    "serve/test_desk_api",
    "serve/test_desk_browser",
    "serve/test_limits",
    "settings/test_odd_values",
    "simulation/test_beacons",
    "simulation/test_coherent_flights",
    "simulation/test_failure_times",
    "simulation/test_fixes",
    "simulation/test_judging",
    "support/test_extensions",
    "verify/test_capacity",
    "verify/test_further_costs",
    "verify/test_far_barriers",
    "verify/test_fix_shapes",
    "verify/test_forbidden",
    "verify/test_air",
    "verify/test_exact_replans",
    "verify/test_robot_errors",
    "verify/test_replanned_errors",
    "verify/test_simplified",
    "wind/test_law_estimate",
    "wind/test_netcdf_files",
    "wind/test_live",
    "wind/test_live_missions",
    "wind/test_live_models",
    "wind/test_sources",
    "wind/test_wind_document",
    "wind/test_wind_kinds",
]
ONLY_AT_NIGHT = ["planning/test_uncompiled_plans", "run/test_documents", "test_machine_code_wheel"]


def left_out(path: Path) -> bool:
    """Whether the tests of the module ``path`` are not of this level."""
    if LEVEL == "fast" and (not _listed(path, FAST) or _listed(path, NOT_FAST)):
        return True
    return _listed(path, ONLY_AT_NIGHT if LEVEL == "all" else NOT_BY_DAY if BY_DAY else [])


def same_by_day(test: object, path: Path) -> bool:
    """Whether ``test`` of the module ``path`` is the same by day: a number of Hypothesis examples by level or
    something else of that module by level would make it another one.
    """
    if _listed(path, NOT_BY_DAY) or _examples_by_level(test):
        return False
    name = getattr(test, "__qualname__", "").partition(".")[0]  # of a function or of its class
    return name not in names_by_level(path.read_text(encoding="utf-8"))


def _examples_by_level(test: object) -> bool:
    """Whether a Hypothesis test has the number of examples of the level, and none of its own."""
    own = getattr(test, "_hypothesis_internal_use_settings", settings.default)
    assert settings.default is not None
    usual = own is None or own.max_examples == settings.default.max_examples
    return getattr(test, "is_hypothesis_test", False) and usual


@cache
def names_by_level(source: str) -> frozenset[str]:
    """What a module defines with ``BY_DAY``: names whose definitions use it, or use such a name.

    Everything, if the definition of ``pytestmark`` or of a fixture that every test uses does.
    """
    uses: dict[str, set[str]] = {}
    autouse = {"pytestmark"}
    for node in ast.parse(source).body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            continue
        inner = list(ast.walk(node))
        used = {one.id for one in inner if isinstance(one, ast.Name)}
        used |= {one.arg for one in inner if isinstance(one, ast.arg)}  # fixtures
        defined = {one.id for one in inner if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)}
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            defined = {node.name}
            if any(isinstance(one, ast.keyword) and one.arg == "autouse" for one in inner):
                autouse.add(node.name)
        for name in defined:
            uses.setdefault(name, set()).update(used)
    found, more = {"BY_DAY"}, True
    while more:
        new = {name for name, used in uses.items() if used & found} - found
        found |= new
        more = bool(new)
    return frozenset(uses if found & autouse else found)


def _listed(path: Path, names: Iterable[str]) -> bool:
    module = path.relative_to(Path(__file__).parent).with_suffix("")
    return any(module.match(name) for name in names)


def first_of_each(cases: Iterable[Case], kinds: Callable[[Case], Iterable[object]]) -> Iterator[Case]:
    """At night all cases; else those that are the first of one of their kinds."""
    seen: set[object] = set()
    for case in cases:
        new = set(kinds(case)) - seen
        if new or AT_NIGHT:
            seen |= new
            yield case
