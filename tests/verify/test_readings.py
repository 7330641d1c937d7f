"""The second reader of the judge: readings of many kinds of files pass, and changed ones are caught."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from careful_io.fingerprints import file_fingerprint
from flight_quantities.frames import local_plane
from pareto_ltl.settings import Settings, WindConfig
from pareto_ltl.settings.wind import wind_sources
from pareto_ltl.wind.netcdf import write_netcdf
from pareto_ltl.wind.observations import place_readings
from pareto_ltl.wind.records import WindField
from pareto_ltl.wind.sources import data_files, read_readings, source_of_path
from pareto_ltl.world.scene import Scene
from pareto_ltl.world.scene_files import write_scene
from pareto_ltl_verify.claims import Verdict, readings
from pareto_ltl_verify.evidence import Evidence
from pareto_ltl_verify.judge import unchecked_claims
from pareto_ltl_verify.sources import SOURCES
from pareto_ltl_verify.wind_fit import Fit
from pareto_ltl_verify.wind_tables import WindFile
from wind_files import GRIB, NETCDF, REPORTS, TABLES, ensemble
from wind_laws.records import WindEvidence

KINDS = TABLES | {"metars": REPORTS["metars"]} | NETCDF | GRIB
SIDE = 4e5  # [m] of the map


def result_of(place: Path, path: Path, **settings: Any) -> Evidence:
    """The evidence of a run that read ``path``."""
    source = settings.pop("source", None) or source_of_path(path)
    level = "0m" if source == "currents" else "10m"
    cfg = WindConfig(**{"source": source, "path": str(path), "level": level, "hold_last": True} | settings)
    found = read_readings(cfg)
    plain = not found.geographic
    middle = np.mean(np.concatenate(found.points), axis=0)
    crs = None if plain else local_plane(middle[1], middle[0])
    half = SIDE / 2
    scene = Scene(
        bounds=np.array([[-half, -half], [half, half]]), start=np.zeros(2), crs=crs, obstacles=(),
        regions={"a": np.array([[0.0, 0.0], [1e4, 0.0], [1e4, 1e4]])}, time_zero=found.first_time,
    )  # fmt: skip
    seen = place_readings(cfg, found, scene)
    place.mkdir(parents=True)
    write_scene(place, scene)
    slots = len(seen.times)
    still = np.zeros((slots, 2, 2, 2))
    evidence = WindEvidence(seen.points, seen.winds, "matern12", np.ones((slots, 2, 4)))
    wind = WindField(
        np.full(2, -half), SIDE, seen.times, still, still, np.ones((slots, 2)), seen.until,
        evidence=evidence, leads=seen.leads, level=seen.level,
    )  # fmt: skip
    write_netcdf(wind, place / "wind.nc", scene)
    inputs = {str(file): file_fingerprint(file) for file in data_files(cfg)}
    whole = asdict(Settings()) | {"wind": asdict(cfg)}
    return Evidence(place, {"inputs": inputs, "status": "ok"}, {}, whole)


def reasons(result: Evidence) -> dict[str, tuple[str, ...]]:
    """Why claims are not checked, apart from those about the map, which has no settings here."""
    return {why: names for why, names in unchecked_claims(result).items() if not why.startswith("the map")}


def judged(result: Evidence) -> list[Verdict]:
    assert readings.unread_reason(result) is None
    found = [claim.judge(result) for claim in readings.CLAIMS]
    assert None not in found
    return [verdict for verdict in found if verdict is not None]


def turned(wind: WindFile, fit: Fit) -> WindFile:
    """The readings, turned by 10 degrees."""
    a = np.deg2rad(10.0)
    matrix = np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])
    return replace(wind, fit=replace(fit, winds=[winds @ matrix for winds in fit.winds]))


def in_knots(wind: WindFile, fit: Fit) -> WindFile:
    return replace(wind, fit=replace(fit, winds=[1.943844 * winds for winds in fit.winds]))


def an_hour_late(wind: WindFile, fit: Fit) -> WindFile:
    return replace(wind, times=wind.times + 3600.0)


def of_the_other_time(wind: WindFile, fit: Fit) -> WindFile:
    return replace(wind, fit=replace(fit, winds=fit.winds[::-1]))


def moved(wind: WindFile, fit: Fit) -> WindFile:
    return replace(wind, fit=replace(fit, points=[points + 3000.0 for points in fit.points]))


LIES = (turned, in_knots, an_hour_late, of_the_other_time, moved)


@pytest.mark.parametrize("kind", KINDS)
def test_the_second_reader_has_the_readings_of_the_run_and_catches_others(kind: str, tmp_path: Path) -> None:
    path = KINDS[kind](tmp_path / "files")
    result = result_of(tmp_path / "run", path)
    assert [verdict for verdict in judged(result) if not verdict.holds] == []
    assert result.wind.fit is not None
    for lie in LIES:
        told = replace(result)
        told.__dict__.update(wind=lie(result.wind, result.wind.fit), remembered=result.remembered)
        assert not all(verdict.holds for verdict in judged(told)), lie.__name__


def test_a_lead_that_the_file_does_not_state_is_caught(tmp_path: Path) -> None:
    result = result_of(tmp_path / "run", TABLES["table"](tmp_path))
    told = replace(result)
    told.__dict__.update(wind=replace(result.wind, leads=result.wind.leads + 3600.0))
    assert [verdict.holds for verdict in judged(told)] == [False, True]


def test_a_time_of_the_file_that_the_run_left_out_is_caught(tmp_path: Path) -> None:
    path = TABLES["table"](tmp_path)
    between = [line.replace("T21:", "T19:") for line in path.read_text().splitlines() if "T21:" in line]
    result = result_of(tmp_path / "run", path)
    path.write_text("\n".join([path.read_text(), *between]))
    result = replace(result, run={"inputs": {str(path): file_fingerprint(path)}})
    assert [verdict.holds for verdict in judged(result)] == [False, True]


def test_the_readings_of_an_ensemble_are_the_mean_of_its_members(tmp_path: Path) -> None:
    result = result_of(tmp_path / "run", ensemble(tmp_path / "files"), source="ensemble")
    assert [verdict.holds for verdict in judged(result)] == [True, True]
    told = replace(result)
    assert result.wind.fit is not None
    one_member = [winds + np.array([0.5, 0.0]) for winds in result.wind.fit.winds]
    told.__dict__.update(wind=replace(result.wind, fit=replace(result.wind.fit, winds=one_member)))
    assert [verdict.holds for verdict in judged(told)] == [True, False]


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda path: path.unlink(), "is no longer where run.json says"),
        (lambda path: path.write_text(path.read_text() + "\n"), "has changed since the run"),
    ],
)
def test_files_that_are_gone_or_changed_are_not_checked_and_the_reason_is_stated(
    spoil: Callable[[Path], Any], reason: str, tmp_path: Path
) -> None:
    path = TABLES["table"](tmp_path)
    result = result_of(tmp_path / "run", path)
    spoil(path)
    assert reasons(result) == {f"the wind file winds.csv {reason}": readings.NAMES}
    assert [claim.judge(result) for claim in readings.CLAIMS] == [None, None]


@pytest.mark.parametrize("kind", [kind for kind in REPORTS if kind != "metars"])
def test_kinds_without_a_second_reader_are_named(kind: str, tmp_path: Path) -> None:
    result = result_of(tmp_path / "run", REPORTS[kind](tmp_path))
    ((reason, names),) = reasons(result).items()
    assert names == readings.NAMES
    assert "second reader" in reason


def test_a_wind_that_was_given_in_python_is_not_read_again(tmp_path: Path) -> None:
    result = result_of(tmp_path / "run", TABLES["table"](tmp_path))
    settings = {**result.settings, "wind": {**result.settings["wind"], "source": "given"}}
    assert reasons(replace(result, settings=settings)) == {"the wind was given in Python": readings.NAMES}


def test_the_checker_knows_every_source_of_the_planner() -> None:
    sources = wind_sources()
    assert SOURCES.keys() == sources.keys()
    for name, row in SOURCES.items():
        planner = sources[name]
        assert (row.reads_path, row.live, row.current) == (planner.reads_path, planner.live, planner.current)
