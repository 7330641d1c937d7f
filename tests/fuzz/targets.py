"""The table of fuzzed readers: name, source of cases, function under test, and number of cases of a test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
from hypothesis import strategies as st

from fuzz import corpora
from fuzz.arriving import ARRIVING
from fuzz.kinds import TOGETHER, from_file, read_map, wind_seeds
from fuzz.mutations import json_bytes, mutants, tree_mutants, yaml_bytes
from fuzz.records import Fuzz, Target
from pareto_ltl.support.errors import ConfigError

# --- formulas and automata -------------------------------------------------------------------


def formulas(place: Path) -> Fuzz:
    from pareto_ltl.logic import parse_formula, translate

    def read(text: str) -> object:
        tree = parse_formula(text)
        assert parse_formula(str(tree)) == tree
        return translate(text, [(), *((name,) for name in tree.atoms)], 50)

    signs = ["X", "F", "U", "M", "G", "W", "R", "&", "|", "!", "->", "<->", "xor", "(", ")", "[]", "<>"]
    names = [
        "a",
        "b",
        "true",
        "false",
        "and",
        "not",
        "é",
        "1",
        "\n",
        "$",
        "X[!]",
        "\\land",
        "◇",
        "=>",
        "/\\",
        "𝒰",
    ]
    words = st.lists(st.sampled_from(signs + names), max_size=20)
    openings = st.sampled_from(["F ", "!", "(", "X", "a & ("])
    ends = st.sampled_from(["a", "", "a)"])
    nested = st.builds(lambda op, n, end: n * op + end, openings, st.integers(0, 3000), ends)
    seeds = [text.encode() for text in corpora.FORMULAS]
    changed = mutants(seeds).map(lambda data: data.decode(errors="replace"))
    texts = st.one_of(words.map(" ".join), words.map("".join), changed, nested, st.text(max_size=40))
    return Fuzz(texts, read)


def automata(place: Path) -> Fuzz:
    from pareto_ltl_apps.formats.hoa_files import read_hoa

    seeds = [text.encode() for text in corpora.HOA]
    return Fuzz(mutants(seeds), from_file(place / "a.hoa", read_hoa))


# --- maps ------------------------------------------------------------------------------------


def geojson(place: Path) -> Fuzz:
    return Fuzz(tree_mutants([corpora.GEOJSON], json_bytes), from_file(place / "map.geojson", read_map))


def kml(place: Path) -> Fuzz:
    return Fuzz(mutants([corpora.KML.encode()]), from_file(place / "map.kml", read_map))


def scenes(place: Path) -> Fuzz:
    from pareto_ltl.world.scene_files import scene_to_dict

    trees = [scene_to_dict(corpora.scene())]
    return Fuzz(tree_mutants(trees, json_bytes), from_file(place / "scene.json", read_map))


# --- settings --------------------------------------------------------------------------------


def settings_files(place: Path) -> Fuzz:
    from pareto_ltl.settings import Settings

    whole = corpora.settings()
    trees = [{key: whole[key]} for key in whole] + [{"seed": 1, "scene": whole["scene"], "name": "x"}]
    return Fuzz(tree_mutants(trees, yaml_bytes), from_file(place / "config_resolved.yaml", Settings.of_file))


def _compose(words: Sequence[str]) -> object:
    from pareto_ltl_apps.cli.composition import opened_hydra, parse_flags, prepare
    from pareto_ltl_apps.cli.setting_keys import CONFIGURATION_ERRORS, explain_error

    try:
        arguments = parse_flags(words)
        with opened_hydra(arguments) as hydra:
            return prepare(hydra, arguments)
    except CONFIGURATION_ERRORS as error:
        raise ConfigError(explain_error(error)) from error  # what the command line prints


def config_files(place: Path) -> Fuzz:
    folder = place / "conf"
    (folder / "experiment").mkdir(parents=True)
    trees = [
        {"seed": 3, "name": "x", "planner": {"n_max": 500, "trees": 2}},
        {"defaults": [{"override /scene": "phi1"}, {"override /mission": "phi1"}], "robot": {"dt": 900}},
    ]
    header = b"# @package _global_\n"
    words = ["+experiment=mine", f"--config-dir={folder}"]
    read = from_file(folder / "experiment" / "mine.yaml", lambda _: _compose(words))
    return Fuzz(tree_mutants(trees, lambda tree: header + yaml_bytes(tree)), read)


def _command_lines() -> st.SearchStrategy[list[str]]:
    known = st.sampled_from(corpora.words())
    spoilt = mutants([word.encode() for word in corpora.words()]).map(
        lambda data: data.decode(errors="replace").replace("\0", "")[:300]  # a long word takes Hydra 0.1 s
    )
    return st.lists(st.one_of(known, spoilt), min_size=1, max_size=4)


def command_words(place: Path) -> Fuzz:
    """Checks of words that do not compose the configuration, which would take 0.1 s."""
    from pareto_ltl_apps.cli import composition
    from pareto_ltl_apps.cli.setting_keys import CONFIGURATION_ERRORS, explain_error, refuse_unknown_key

    with composition.opened_hydra(composition.parse_flags([])) as hydra:
        loader = hydra.config_loader

    def read(words: list[str]) -> None:
        try:
            arguments = composition.parse_flags(words)
            for override in composition.parsed_overrides(loader, arguments.overrides):
                refuse_unknown_key(override, loader)
        except SystemExit:  # --version
            pass
        except CONFIGURATION_ERRORS as error:
            raise ConfigError(explain_error(error)) from error

    return Fuzz(_command_lines(), read)


def command_lines(place: Path) -> Fuzz:
    def read(words: list[str]) -> object:
        try:
            return _compose(words)
        except SystemExit:
            return None

    return Fuzz(_command_lines(), read)


# --- winds -----------------------------------------------------------------------------------


def csv_winds(place: Path) -> Fuzz:
    from pareto_ltl_apps.formats.csv_files import read_csv_files

    return Fuzz(
        mutants(corpora.CSV), from_file(place / "wind.csv", lambda path: read_csv_files((path,), 150.0))
    )


def winds_by_content(place: Path) -> Fuzz:
    from pareto_ltl_apps.formats.content import source_of_file

    seeds = [*corpora.CSV, *corpora.STATIONS, *(seed for _, seed in sorted(wind_seeds(place).items()))]
    return Fuzz(mutants(seeds), from_file(place / "wind", source_of_file))


def position_fixes(place: Path) -> Fuzz:
    from pareto_ltl_apps.flight.position_fixes import fix_rows

    return Fuzz(
        mutants([b"time,lat,lon,sd_m\n3h,38.1,-95.6,500\n2018-10-09T06:00:00Z,38.4,-95.2,300\n"]),
        from_file(place / "fixes.csv", lambda path: fix_rows(path, on_earth=True)),
    )


def inventories(place: Path) -> Fuzz:
    from flight_quantities.levels import parse_level
    from pareto_ltl_apps.formats.inventories import parse_inventory, wind_parts

    def read(case: bytes) -> object:
        where = "a.index" if b"{" in case else "a.idx"
        entries = parse_inventory(case.decode("utf-8", "replace"), where)
        return wind_parts(entries, parse_level("10m"), where)

    return Fuzz(mutants(corpora.INVENTORIES), read)


def forecast_errors(place: Path) -> Fuzz:
    from pareto_ltl.wind.named_laws import law_named, read_law

    trees = [law_named(name).document() for name in ("gfs", "gfs_one_part")]
    return Fuzz(tree_mutants(trees, json_bytes), from_file(place / "law.json", read_law))


def forecast_tests(place: Path) -> Fuzz:
    from pareto_ltl_apps.studies.promises import TABLE, read_promises, references

    head = "mission,formula,departure,situation,latitude,longitude,kind,fidelity,simulated_coherent,failure"
    rows = ("0,F a,2018-10-09T06:00:00Z,s,40,-100,chosen,full,0.25,1.0",
            "1,F a,2018-10-09T03:00:00Z,s,40,-99,chosen,full,0.5,0.0")  # fmt: skip

    def read(path: Path) -> object:
        return references(read_promises(path.parent))

    return Fuzz(mutants(["\n".join((head, *rows)).encode()]), from_file(place / TABLE, read))


def netcdf_winds(place: Path) -> Fuzz:
    from pareto_ltl.wind.netcdf import read_netcdf, write_netcdf

    write_netcdf(corpora.wind(), place / "seed.nc", corpora.scene())
    return Fuzz(mutants([(place / "seed.nc").read_bytes()]), from_file(place / "wind.nc", read_netcdf))


# --- results ---------------------------------------------------------------------------------


def results(place: Path) -> Fuzz:
    """One file of a results directory is changed; everything that reads this file is called."""
    from pareto_ltl.planning.plan_files import read_extra_paths
    from pareto_ltl.run.plan_run import Run
    from pareto_ltl_apps.cli.rerun_command import _finished_record
    from pareto_ltl_apps.studies.jobs import RunJob

    run = place / "run"
    corpora.write_run(run)
    readers: dict[str, tuple[Callable[[], object], ...]] = {
        "scene.json": (lambda: Run.open(run).scene,),
        "cells.json": (lambda: Run.open(run).cells,),
        "automaton.json": (lambda: Run.open(run).automaton.n_states,),
        "plan.json": (lambda: Run.open(run).plan, lambda: repr(Run.open(run).plan)),
        "front.csv": (lambda: repr(Run.open(run).front),),
        "front.npz": (lambda: repr(Run.open(run).front), lambda: read_extra_paths(run)),
        "metrics.json": (lambda: Run.open(run).metrics, lambda: RunJob(run).look()),
        "run.json": (
            lambda: (Run.open(run).done, repr(Run.open(run)), RunJob(run).look(), RunJob(run).settled()),
            lambda: _finished_record(run),
        ),
        "trees.npz": (lambda: [tree.path(len(tree) - 1) for tree in Run.open(run).forest.trees],),
        "deployments.npz": (lambda: Run.open(run).deployments,),
    }  # fmt: skip
    whole = {name: (run / name).read_bytes() for name in readers}
    trees = corpora.json_trees(run)

    def case(name: str) -> st.SearchStrategy[tuple[str, bytes]]:
        changed = tree_mutants([trees[name]], json_bytes) if name in trees else mutants([whole[name]])
        return st.tuples(st.just(name), changed)

    def read(changed: tuple[str, bytes]) -> None:
        name, data = changed
        (run / name).write_bytes(data)
        try:
            for reader in readers[name]:
                reader()
        finally:
            (run / name).write_bytes(whole[name])

    return Fuzz(st.sampled_from(sorted(readers)).flatmap(case), read)


def sweeps(place: Path) -> Fuzz:
    """``sweep.json`` or a file of one of its runs is changed; the summary is made from the folder."""
    from pareto_ltl_apps.studies import sweep_summary as summary

    sweep = place / "sweep"
    corpora.write_sweep(sweep)
    names = ["sweep.json", "0000000000000001/run.json", "0000000000000001/metrics.json"]
    whole = {name: (sweep / name).read_bytes() for name in names}
    trees = {name: yaml.safe_load(data) for name, data in whole.items()}

    def read(changed: tuple[str, bytes]) -> None:
        name, data = changed
        (sweep / name).write_bytes(data)
        try:
            for newest in (True, False):
                _summarize(summary, sweep)
                if newest and name != "sweep.json":
                    (sweep / "sweep.json").unlink()  # what the directories say themselves
        finally:
            for name, data in whole.items():
                (sweep / name).write_bytes(data)

    cases = [st.tuples(st.just(name), tree_mutants([trees[name]], json_bytes)) for name in names]
    return Fuzz(st.one_of(*cases).map(tuple), read)


def _summarize(summary: Any, sweep: Path) -> None:
    """The summary without its figure."""
    from pareto_ltl_apps.studies.sweeps import read_manifest, seed_groups, sweep_rows

    manifest = read_manifest(sweep)
    rows = sweep_rows(sweep, manifest)
    made = summary.SweepSummary(sweep, manifest, rows, seed_groups(rows))
    summary.summary_content(made)
    if figure := summary.chosen_figure(made):
        summary.figure_series(made, *figure)


TARGETS = (
    Target("formulas", formulas),
    Target("automata", automata),
    Target("geojson", geojson),
    Target("kml", kml),
    Target("scenes", scenes),
    Target("settings_files", settings_files),
    Target("config_files", config_files, share=0.025),  # Hydra composes for 0.1 s and more
    Target("command_words", command_words, share=0.25),  # Hydra takes 30 ms for a long word
    Target("command_lines", command_lines, share=0.025),
    Target("csv_winds", csv_winds),
    Target("winds_by_content", winds_by_content, share=0.3),
    Target("position_fixes", position_fixes),
    Target("inventories", inventories),
    Target("forecast_errors", forecast_errors),
    Target("forecast_tests", forecast_tests),
    Target("netcdf_winds", netcdf_winds, share=0.2),  # HDF5 takes 10 ms to open a file
    Target("results", results),
    Target("sweeps", sweeps),
    *TOGETHER,
    *ARRIVING,
)
