"""Which tests run while one writes (``make test-fast``), by day (``make test``), before a change is taken in
(``make test-all``) and at night.

``PARETO_LTL_TESTS`` is ``fast``, ``day``, ``all`` (the default) or ``night``. Each has the tests of those
before it. With ``PARETO_LTL_SAMPLE=SEED``, the night is a tenth of what only the night runs, drawn with that
seed (``make test-sample``). With ``PARETO_LTL_PART=2/3``, all are the tests of the day, and the second of
three parts of the others, which take equally long.
"""

from __future__ import annotations

import ast
import os
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import TypeVar

import pytest
from hypothesis import settings

LEVEL = os.environ.get("PARETO_LTL_TESTS", "all")
if LEVEL not in ("fast", "day", "all", "night"):
    raise ValueError(f"PARETO_LTL_TESTS must be fast, day, all or night, got {LEVEL!r}")
BY_DAY = LEVEL in ("fast", "day")
AT_NIGHT = LEVEL == "night"
PART, PARTS = (int(number) for number in os.environ.get("PARETO_LTL_PART", "1/1").split("/"))
if not 1 <= PART <= PARTS:
    raise ValueError(f"PARETO_LTL_PART must be like 2/3, got {PART}/{PARTS}")
SAMPLE = os.environ.get("PARETO_LTL_SAMPLE", "") if AT_NIGHT else ""  # its seed
SAMPLE_SHARE, SAMPLE_SECONDS = 0.1, 60.0  # of the tests of the night alone; no test begins later
Case = TypeVar("Case")

# Modules of the fast level, and those among them that run kernels, start processes or compose for long.
FAST = [
    "careful_io/*", "declared_settings/*", "flight_quantities/*", "logic/*", "settings/*", "support/*",
    "wind_laws/*", "world/*",
]  # fmt: skip
NOT_FAST = [
    "careful_io/test_netcdf4",
    "settings/test_building",
    "support/test_cache",
    "support/test_extras",
    "wind_laws/test_gp",
    "wind_laws/test_variability",
    "world/test_cells",
    "world/test_random_maps",
]

# Modules or tests that start processes, plan whole missions or read files of every kind: not by day.
NOT_BY_DAY = [
    "test_published::test_the_published_plans_have_the_ranks_that_the_page_states",
    "test_benchmarks",
    "test_corpus",
    "test_docs::test_the_search_works_in_a_site_that_is_opened_as_files",
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
    "mutants/test_making",
    "studies/*",
    "cli/test_budget",
    "cli/test_commands",
    "cli/test_imports",
    "cli/test_warm",
    "cli/test_help",
    "cli/test_hydra_app",
    "cli/test_rerun",
    "cli/test_wind_error",
    "cli/test_wind_table",
    "inflight/test_beacons",
    "inflight/test_command",
    "inflight/test_link",
    "inflight/test_mavsdk",
    "inflight/test_session",
    "inflight/test_watch::test_no_stream_stops_a_watch",
    "planning/test_choices",
    "preflight/test_check",
    "preflight/test_contain_command",
    "planning/test_front_sweep",
    "planning/test_landmarks::test_what_a_landmark_gives_is_continuous_in_its_distance",
    "planning/test_margin_model::test_edges_that_are_left_out_change_no_margin_of_acceptance",
    "planning/test_merged_steps::test_paths_in_merged_steps_are_flown_in_all_steps",
    "planning/test_no_path",
    "planning/test_power",
    "planning/test_programme",
    "planning/test_search_map",
    "planning/test_smoothing::test_random_maps_keep_every_promise",
    "planning/test_smoothing::test_the_same_input_gives_the_same_paths",
    "planning/test_smoothing_large",
    "planning/test_step_programme::test_the_solved_step_is_that_of_the_plain_statement",
    "planning/test_timed_trees",
    "planning/test_uncompiled_plans",
    "report/test_command_output",
    "report/test_figures",
    "report/test_legs",
    "report/test_page",
    "report/test_page_browser",
    "report/test_limits",
    "report/test_texts",
    "branching/test_branches",
    "run/test_choosing",
    "run/test_compile_time::test_ctrl_c_while_it_compiles_leaves_no_process_and_no_broken_code",
    "run/test_directory",
    "run/test_documents",
    "run/test_exporting",
    "run/test_faults",
    "run/test_interface",
    "run/test_nearest_path",
    "run/test_nothing_received_acts",
    "run/test_nth_call",
    "run/test_objects_compose",
    "run/test_pipeline::test_where_refinement_finds_nothing_that_can_be_flown_the_paths_of_the_trees_stay",
    "run/test_received_results",
    "run/test_recorded_branches",
    "branching/test_rejoin",
    "run/test_replan_inputs",
    "run/test_replanning",
    "branching/test_second_branches",
    "run/test_steering",
    "run/test_vehicles",
    "run/test_warmup",
    "run/test_whole_jobs",
    "serve/test_allowed",
    "serve/test_desk_api",
    "serve/test_desk_browser",
    "serve/test_limits",
    "settings/test_odd_values",
    "simulation/test_coherent_flights",
    "simulation/test_common_flights::test_flights_with_fixes_steer_by_them_in_linear_winds",
    "simulation/test_error_tail::test_weighted_flights_agree_with_plain_ones",
    "simulation/test_failure_times",
    "simulation/test_fixes",
    "simulation/test_flights::test_missions_of_visits_fail_no_more_often_than_the_papers_bound",
    "simulation/test_judging",
    "simulation/test_replanned_errors::test_over_all_fixes_the_promises_are_right_in_the_mean",
    "support/test_cache::test_the_cache_keeps_below_its_limit",
    "support/test_extensions",
    "support/test_extras::test_a_plan_in_python_loads_neither_hydra_nor_the_readers_of_other_files",
    "verify/test_capacity",
    "verify/test_further_costs",
    "verify/test_far_barriers",
    "verify/test_fix_shapes",
    "verify/test_forbidden",
    "verify/test_generated_lies",
    "verify/test_air",
    "verify/test_laws_of_parts",
    "verify/test_rare_promises::test_further_flights_fail_as_often_as_the_first_ones",
    "verify/test_readings",
    "verify/test_exact_replans",
    "verify/test_robot_errors",
    "verify/test_replanned_errors",
    "verify/test_simplified",
    "verify/test_unscored",
    "verify/test_verify",
    "verify/test_winds::test_the_judge_has_the_planners_clock",
    "wind/test_air::test_messages_of_the_air_are_read_with_the_wind_at_their_level",
    "wind/test_ensemble::test_a_folder_for_each_member_is_an_ensemble",
    "wind/test_ensemble::test_notes_on_the_members_in_grib_files_are_kept",
    "wind/test_law_estimate",
    "wind/test_netcdf_files",
    "wind/test_live",
    "wind/test_live_missions",
    "wind/test_live_models",
    "wind/test_sources",
    "wind/test_wind_document",
    "wind/test_wind_kinds",
    "world/test_region_names",
]
IN_EVERY_PART = ["test_golden", "verify/test_verify"]  # the plans of the paper, and the checker of every plan
SECONDS = {  # of the longest modules of two processes on two cores, so that parts take equally long
    "branching/test_branches": 60, "branching/test_rejoin": 87, "serve/test_desk_browser": 80,
    "serve/test_desk_api": 87, "run/test_faults": 72, "cli/test_hydra_app": 72, "run/test_whole_jobs": 52,
    "run/test_replan_inputs": 60, "studies/test_sweeps": 60,
    "run/test_nothing_received_acts": 61, "wind/test_sources": 59, "kernels/test_code_cache": 56,
    "cli/test_commands": 50, "fuzz/test_fuzz": 52, "test_documented_commands": 49, "test_examples": 50,
    "run/test_vehicles": 48, "run/test_interface": 47, "run/test_replanning": 35, "run/test_choosing": 40,
    "verify/test_laws_of_parts": 35, "verify/test_generated_lies": 48, "inflight/test_command": 44,
}  # fmt: skip
USUAL_SECONDS = 15  # of a module that is not by day
ONLY_AT_NIGHT = [
    "planning/test_uncompiled_plans",
    "run/test_documents",
    "branching/test_second_branches",  # two and a half minutes; its files and claims are met in test_rejoin
    "studies/test_sweep_slurm",  # needs four packages of Debian; the same sweep runs with submitit before
    "test_machine_code_wheel",
]
NOT_SAMPLED = [  # a test takes minutes, or needs root and Debian packages
    "planning/test_uncompiled_plans",
    "studies/test_sweep_slurm",
    "test_machine_code_wheel",
]

# Tests whose cases all run at night alone, the number of those that run before too, and why these are enough:
# long tests whose property another test has too.
FEWER: dict[str, tuple[int, str]] = {
    "test_published::test_every_mission_has_a_map_and_winds_that_were_known_and_that_came": (
        8, "the missions are drawn and written by one program, and are read in the test of the ranks too",
    ),
    "run/test_choosing::test_a_choice_has_the_bytes_of_a_whole_run_and_passes_the_judge": (
        2, "each plans anew and judges; all wishes go through one function, which its own tests cover",
    ),
    "test_golden::test_a_run_of_the_papers_planner_gives_the_same_results": (
        2, "one seed of each mission notices a change; the others are the same code with other samples",
    ),
    "test_corpus::test_a_mission_of_each_kind_has_a_plan": (
        3, "each plans a mission; the kinds have tests of their own where they are drawn, planned and judged",
    ),
    "run/test_nothing_received_acts::"
    "test_no_command_connects_reads_or_writes_where_the_settings_of_a_result_say": (
        12, "each command once (97 of 1,600 s of tests/run with both sources, read alike by all)",
    ),
    "run/test_vehicles::test_all_paths_of_a_vehicle_keep_its_airspeeds_and_tell_its_energy": (
        4, "each plans; a power curve and the airspeeds have tests of their own (planning/test_power)",
    ),
    "planning/test_front_sweep::test_refined_paths_fail_less_on_fresh_flights_than_those_of_the_trees": (
        1, "each sweeps a front; laws and borders have tests of their own where failures are judged",
    ),
    "simulation/test_failure_times::test_flights_that_fail_are_those_of_the_verdict": (
        1, "each plans; both missions are judged without a plan in simulation/test_judging",
    ),
    "simulation/test_failure_times::test_a_flight_fails_at_the_first_prefix_that_has_failed": (
        1, "each plans; flights of a mission with a forbidden region are judged in verify/test_forbidden",
    ),
    "serve/test_desk_browser::test_a_mission_is_drawn_planned_chosen_exported_and_replanned": (
        1, "wide; the narrow page is opened, drawn on and read by the other tests of the desk",
    ),
    "inflight/test_beacons::test_the_best_place_saves_what_a_landmark_there_saves": (
        0, "38 s, one command: fixes are tested in planning/test_landmarks and simulation/test_fixes",
    ),
    "studies/test_replanning::test_on_a_map_with_landmarks_the_plan_made_without_them_is_flown_too": (
        0, "55 s: the study with fixes is tested flight by flight on a map without landmarks",
    ),
    "studies/test_studies::test_plans_of_every_model_meet_the_same_winds": (
        0, "20 s: one seed is one wind whatever flies, which is tested there for three methods",
    ),
    "test_packages::test_a_run_imports_every_package_of_its_lock": (
        0, "19 s, and changes with the lock files alone",
    ),
    "test_packages::test_nothing_is_installed_that_neither_a_run_nor_a_test_imports": (
        0, "12 s, and changes with the lock files alone",
    ),
    "test_examples::test_the_command_of_an_example_folder_makes_a_plan": (
        1, "each plans a mission of real size; their maps and settings are read before",
    ),
    "run/test_whole_jobs::test_a_wind_in_netcdf_is_flown": (
        1, "both files are read in wind/test_wind_kinds, and flown in the same way",
    ),
    "planning/test_no_path::test_a_deadline_that_is_too_early_is_named_and_a_later_one_finds_a_path": (
        0, "16 s: eight other causes are named and cured there",
    ),
    "studies/test_sweeps::test_a_launcher_killed_in_the_middle_and_started_again_gives_the_same_summary": (
        0, "22 s: run/test_faults kills a sweep at a random moment, and continues it",
    ),
    "studies/test_sweeps::test_submitit_waits_for_all_jobs_when_one_is_killed_and_runs_that_one_again": (
        0, "21 s: the queue treats what any launcher raises alike, and is tested with killed jobs there",
    ),
    "studies/test_sweeps::test_half_the_jobs_killed_once_are_run_again_by_the_same_command": (
        0, "a job that kills its process every time is killed once, and run again, before it is given up",
    ),
    "studies/test_replan_test::test_a_mission_is_flown_once_in_each_way_in_the_same_wind": (
        1, "a turning wind: 16 s each; a calm is one of the winds of studies/test_replanning",
    ),
    "test_examples::test_an_example_runs_and_says_something": (
        3, "10 s each; two more run for what they say, and the others call what run/test_interface,"
        " run/test_choosing, studies/test_studies and inflight/test_link test",
    ),
    "serve/test_desk_browser::test_points_are_compared_with_flights_beacons_winds_and_starts": (
        0, "28 s: the answers are tested in serve/test_desk_api, and another test there compares a point",
    ),
    "run/test_whole_jobs::test_speed_and_direction_of_the_nbm_are_flown": (
        0, "wind/test_live_models reads these files, and winds of other files are flown there",
    ),
    "run/test_whole_jobs::test_the_current_of_rtofs_is_sailed": (
        0, "wind/test_live_models reads these files, and the current of HYCOM is sailed there",
    ),
    "inflight/test_command::test_a_killed_process_is_resumed": (
        0, "15 s: a watch is resumed from its journal in branching/test_branches",
    ),
    "branching/test_branches::test_a_fix_that_says_nothing_gives_no_branches": (
        0, "15 s: a plan stays as it is where branches change nothing, branching/test_tree_flights",
    ),
    "run/test_faults::test_a_sweep_that_was_killed_at_any_moment_is_finished_by_the_same_command": (
        0, "26 s: a killed run is made again there, and studies/test_sweeps kills jobs of a sweep",
    ),
    "run/test_whole_jobs::"
    "test_zones_to_which_a_kmz_links_are_avoided_and_a_change_of_them_is_noticed": (
        0, "22 s: links of KMZ files are read in world/test_map_kml, and airspace is avoided there",
    ),
    "studies/test_dask::test_a_sweep_on_a_cluster_has_the_table_of_one_without": (
        0, "16 s: parts of studies run on a cluster there, and sweeps run with three other launchers",
    ),
    "studies/test_forecast_test::test_a_forecast_test_of_real_fields_from_the_command_line": (
        0, "12 s: its table and figure are tested there, the command in studies/test_study_runs",
    ),
    "studies/test_hindcast::test_a_hindcast_of_real_fields_from_the_command_line": (
        0, "19 s: missions and fields are tested there, the command in studies/test_study_runs",
    ),
    "studies/test_sweeps::test_a_job_that_kills_its_process_every_time_is_given_up_and_the_others_are_done": (
        0, "12 s: the queue gives such a job up in the tests there that start no process",
    ),
    "studies/test_sweeps::test_a_sweep_that_is_asked_to_end_ends_its_jobs_and_goes_on_later": (
        0, "12 s: a run that is asked to end is tested in cli/test_hydra_app",
    ),
    "studies/test_study_runs::test_a_killed_run_goes_on_and_ends_as_if_it_had_not_been_stopped": (
        0, "11 s: parts that are done are not done again in studies/test_parts",
    ),
    "verify/test_far_barriers::"
    "test_the_order_of_far_barriers_is_no_claim_and_a_near_one_cannot_be_called_far": (
        0, "24 s: the closest barrier and its distance are among the lies of verify/test_verify",
    ),
    "verify/test_verify::test_a_promise_of_few_flights_holds": (1, "12 s each, of 20 and 300 flights"),
    "serve/test_desk_browser::test_random_clicks_leave_no_error": (
        2, "10 s each: wide without a plan, and narrow with one; the night has a hundred",
    ),
    "cli/test_commands::test_the_flag_of_a_sweep_may_stand_anywhere": (
        3, "six orders of the same three words, half a second of composition each",
    ),
}  # fmt: skip


# Tests that say the same of kernels that run as Python, for most of the time of these: many flights.
NOT_UNCOMPILED = [
    "kernels/test_path::test_correlations_between_steps_are_those_of_linear_flights",
    "kernels/test_letters::test_v_bounds_the_flights_that_meet_a_forbidden_strip",
]
UNCOMPILED = bool(os.environ.get("NUMBA_DISABLE_JIT"))  # which `.ci/run` tries by day alone


def left_out(path: Path) -> bool:
    """Whether the tests of the module ``path`` are not of this level."""
    if LEVEL == "fast" and (not _listed(path, FAST) or _listed(path, NOT_FAST)):
        return True
    if LEVEL == "all" and _listed(path, NOT_BY_DAY) and not in_part(name_of_module(path), PART, PARTS):
        return True
    return _listed(path, ONLY_AT_NIGHT if LEVEL == "all" else NOT_BY_DAY if BY_DAY else [])


def in_part(module: str, part: int, parts: int) -> bool:
    """Whether the tests of ``module`` that are not by day are in the part ``part`` of ``parts``."""
    return parts == 1 or module in IN_EVERY_PART or parts_of(parts)[module] == part


@cache
def parts_of(parts: int) -> dict[str, int]:
    """The part, from 1 on, of each module with tests not by day: the longest first, each to the shortest."""
    here = Path(__file__).parent
    listed = {name_of_module(path) for path in here.rglob("test_*.py") if _listed(path, NOT_BY_DAY)}
    listed |= {name.partition("::")[0] for name in NOT_BY_DAY if "::" in name}
    lengths, chosen = dict.fromkeys(range(1, parts + 1), 0), dict[str, int]()
    for module in sorted(listed, key=lambda name: (-SECONDS.get(name, USUAL_SECONDS), name)):
        chosen[module] = min(lengths, key=lambda part: lengths[part])
        lengths[chosen[module]] += SECONDS.get(module, USUAL_SECONDS)
    return chosen


def of_this_level(items: Sequence[pytest.Item]) -> list[pytest.Item]:
    """The tests among those collected that are of this level, in their order."""
    if SAMPLE:
        alone = night_alone(items)
        return drawn([item for item in items if item in alone], SAMPLE)
    if AT_NIGHT:
        return list(items)
    night = _left_to_night(items)
    chosen = [item for item in items if item not in night]
    if UNCOMPILED:
        chosen = [item for item in chosen if not _listed_test(item, NOT_UNCOMPILED)]
    return [
        item
        for item in chosen
        if not _listed_test(item, NOT_BY_DAY)
        or (not BY_DAY and in_part(name_of_module(item.path), PART, PARTS))
    ]


def fewer(cases: int, retained: int) -> set[int]:
    """Numbers of the ``retained`` of ``cases`` cases that run before the night, evenly from first to last."""
    if retained >= cases:
        return set(range(cases))
    return {round(k * (cases - 1) / max(retained - 1, 1)) for k in range(retained)}


def _left_to_night(items: Sequence[pytest.Item]) -> set[pytest.Item]:
    """The cases that :data:`FEWER` leaves to the night."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        name = name_of(item)
        if name in FEWER:
            cases.setdefault(name, []).append(item)
    return {
        item
        for name, of_test in cases.items()
        for number, item in enumerate(of_test)
        if number not in fewer(len(of_test), FEWER[name][0])
    }


def night_alone(items: Sequence[pytest.Item]) -> set[pytest.Item]:
    """The tests that no other level runs in the same way."""
    return _left_to_night(items) | {
        item
        for item in items
        if not _listed(item.path, NOT_SAMPLED)
        and (
            _listed(item.path, ONLY_AT_NIGHT)
            or _depends_on_level(item, "AT_NIGHT", "first_of_each")
            or _examples_by_level(getattr(item, "obj", None))
        )
    }


def drawn(items: Sequence[pytest.Item], seed: str) -> list[pytest.Item]:
    """A tenth of the tests, by module in an order that is drawn too, since time may not suffice for all."""
    dice = random.Random(seed)
    chosen = set(dice.sample(range(len(items)), -(-len(items) // round(1 / SAMPLE_SHARE))))
    modules: dict[Path, list[pytest.Item]] = {}
    for number, item in enumerate(items):
        if number in chosen:
            modules.setdefault(item.path, []).append(item)
    order = list(modules)
    dice.shuffle(order)
    return [item for path in order for item in modules[path]]


def _depends_on_level(item: pytest.Item, *levels: str) -> bool:
    name = getattr(getattr(item, "obj", None), "__qualname__", "").partition(".")[
        0
    ]  # of a function or its class
    return name in names_by_level(item.path.read_text(encoding="utf-8"), *levels)


def _examples_by_level(test: object) -> bool:
    """Whether a Hypothesis test has the number of examples of the level, and none of its own."""
    own = getattr(test, "_hypothesis_internal_use_settings", settings.default)
    assert settings.default is not None
    usual = own is None or own.max_examples == settings.default.max_examples
    return getattr(test, "is_hypothesis_test", False) and usual


@cache
def names_by_level(source: str, *levels: str) -> frozenset[str]:
    """What a module defines with one of ``levels``: names whose definitions use it, or use such a name.

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
    found, more = set(levels), True
    while more:
        new = {name for name, used in uses.items() if used & found} - found
        found |= new
        more = bool(new)
    return frozenset(uses if found & autouse else found)


def _listed(path: Path, names: Iterable[str]) -> bool:
    module = path.relative_to(Path(__file__).parent).with_suffix("")
    return any(module.match(name) for name in names)


def name_of_module(path: Path) -> str:
    """``cli/test_help``."""
    return path.relative_to(Path(__file__).parent).with_suffix("").as_posix()


def name_of(item: pytest.Item) -> str:
    """Of all cases of a test: ``cli/test_help::test_one``."""
    return f"{name_of_module(item.path)}::{item.name.partition('[')[0]}"


def _listed_test(item: pytest.Item, names: Iterable[str]) -> bool:
    return name_of(item) in names


def first_of_each(cases: Iterable[Case], kinds: Callable[[Case], Iterable[object]]) -> Iterator[Case]:
    """At night all cases; else those that are the first of one of their kinds."""
    seen: set[object] = set()
    for case in cases:
        new = set(kinds(case)) - seen
        if new or AT_NIGHT:
            seen |= new
            yield case
