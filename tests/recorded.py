"""Numbers and texts of small plans, kept in ``recorded.json`` and checked by ``run/test_recorded.py``.

Each mission uses other models. Of every array that a results directory states, the record has its size and
two sums: a change of any number in it is seen, and the file stays short. After a change that is meant to
change results, write the file again and give the reason in the commit:

    python tests/recorded.py [MISSION ...]
"""

from __future__ import annotations

import csv
import json
import math
import sys
import tempfile
import zlib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_info

import golden
import pareto_ltl
from careful_io.yaml_files import read_yaml
from honest_results import forecasts, light_law
from pareto_ltl.support.resources import CONF
from small_plans import BEACONS, COMMON, PHI1, phi1
from wind_files import ensemble

KEPT = Path(__file__).with_name("recorded.json")
CLOSE = 1e-6  # relative to the sum of what is summed
PLAIN = COMMON | {"wind": COMMON["wind"] | {"cache": False}}  # a fit that is read says nothing of fitting
ROBOT, PLANNER, REFINED = PLAIN["robot"], PLAIN["planner"], PLAIN["refine"]
CHOICE, WIND = PLAIN["selection"], PLAIN["wind"]
JUDGED = {"refine": REFINED | {"flights": 60, "sweep_flights": 30}}
WING = {"kind": "wing", "base": 50.0, "drag": 0.02, "lift": 1000.0, "capacity": 50_000.0}
TABLE = {"kind": "table", "points": [[0, 450], [5, 400], [15, 300], [30, 900]]}
ROTOR = {"kind": "rotor", "base": 50.0, "blade": 100.0, "lifting": 200.0, "drag": 0.01}
PHI2 = read_yaml(CONF.file("mission", "phi2"))["formula"]
LONG = ("branches",)
REPLANNED = {"forecast": 4, "errors": 3}  # at which step
Mission = tuple[str | dict[str, Any], str | dict[str, Any], dict[str, Any]]


def _uneven(place: Path) -> Path:
    """Forecasts at other places at every time, so that errors and their modes differ from time to time."""
    head, *rows = forecasts(place / "even.csv").read_text().splitlines()
    path = place / "uneven.csv"
    path.write_text("\n".join([head, *(row for k, row in enumerate(rows) if k * k % 7 > 1)]) + "\n")
    return path


def missions(place: Path) -> dict[str, Mission]:
    """Map, formula and settings by name; files of winds are written into ``place``."""
    forecast = {
        "source": "csv", "path": str(forecasts(place / "forecasts.csv")), "hold_last": True,
        "forecast_error": str(light_law(place / "law.json")),
    }  # fmt: skip
    return {
        "full": ("phi1", PHI1, {}),
        "paper": ("phi1", PHI1, {"fidelity": "paper", "planner": PLANNER | {"n_max": 600}}),
        "paths": ("phi1", PHI1, {"fidelity": {"name": "full", "refine": "convex", "judge": "bound"},
                                 "planner": PLANNER | {"n_max": 3000}}),
        "two": ("phi2", PHI2, {"robot": ROBOT | {"dt": 1800.0}}),
        "fixes": (phi1(landmarks=BEACONS), "F a", JUDGED),
        "deadline": ("phi1", "F[0,40h] a & F[0,60h] b", {}),
        "window": (phi1(windows={"soon": {"region": "a", "from": "10h", "until": "40h"}}), "F soon", {}),
        "calm": ("phi1", "F a", {"wind": "calm", "robot": ROBOT | {"heading_sd": 6.0}}),
        "open": (phi1(border="open"), "!a U b", {}),
        "feedback": ("phi1", "F a", {"robot": ROBOT | {"feedback_time": 1800.0}} | JUDGED),
        "errors": ("phi1", "F a", {"robot": ROBOT | {"airspeed_sd": 0.03, "heading_sd": 2.0, "clock_sd": 60.0,
                                                     "start_sd": 2000.0, "heading_bias": 1.0}} | JUDGED),
        "wing": ("phi1", PHI1, {
            "robot": ROBOT | {"u_min": 12.0, "power": WING, "bank": 20.0, "turn_delay": 30.0},
            "selection": CHOICE | {"rule": "threshold", "alpha": 0.6}}),
        "rotor": ("phi1", "F a", {"robot": ROBOT | {"power": ROTOR},
                                  "selection": CHOICE | {"rule": "energy", "alpha": 0.6}}),
        "table": ("phi1", "F a", {
            "robot": ROBOT | {"power": TABLE},
            "selection": CHOICE | {"rule": "least", "alpha": 0.6, "least": "turns",
                                   "costs": ["turns", "duration"]}}),
        "level": ("phi1", "F a", {"robot": ROBOT | {"air_temperature": 5.0, "level": "10m"},
                                  "selection": CHOICE | {"rule": "length", "length": 1.3e6}}),
        "matern": ("phi1", "F a", {
            "wind": WIND | forecast | {"path": str(_uneven(place)), "kernel": "matern32", "rho": 0.5}
            | {"energy": 0.9},
            "smoothing": PLAIN["smoothing"] | {"weights": [1.0, 100.0], "rounds": 2}}),
        "forecast": ("phi1", "F a", {"wind": WIND | forecast} | JUDGED),
        "held": ("phi1", PHI1, {
            "wind": WIND | forecast | {"path": str(forecasts(place / "short.csv", 6.0)), "max_gap": 40.0},
            "planner": PLANNER | {"epsilon": 1e-4}} | JUDGED),
        "ensemble": ("phi1", "F a", {
            "wind": WIND | {"source": "ensemble", "path": str(ensemble(place / "members.nc"))}
            | {"hold_last": True, "max_gap": 40.0}} | JUDGED),
        "rare": ("phi1", "F a", {"robot": ROBOT | {"feedback_time": 400.0},
                                 "selection": CHOICE | {"draws": 400, "runs": 2000}} | JUDGED),
        "branches": ("phi1", PHI1, {"branch": {"leaves": 2, "at": [8.0]}} | JUDGED),
        "random": (phi1(obstacles=[], random={"seed": 3, "obstacles": 8, "radius": [0.03, 0.08]}), PHI1, {}),
        "knee": ("phi1", PHI1, {"selection": CHOICE | {"rule": "knee"},
                                "planner": PLANNER | {"epsilon": None}}),
        "weighted": ("phi1", PHI1, {"selection": CHOICE | {"rule": "weighted"},
                                    "refine": REFINED | {"points": 4, "classes": 2}}),
    }  # fmt: skip


def made_by() -> dict[str, str]:
    """Properties that affect the last bits of a result, and through them the end of a search."""
    return golden.fingerprint() | {"threads": str(max(pool["num_threads"] for pool in threadpool_info()))}


def found(name: str, place: Path) -> dict[str, list[Any]]:
    """What the results directory of a mission states, by file and key: size and sums, or texts.

    Of :data:`REPLANNED` that of the rest of the mission too, after a position fix.
    """
    scene, formula, changes = missions(place)[name]
    run = pareto_ltl.plan(scene, formula, out=place / name, **(PLAIN | changes))
    values = stated(place / name)
    if name in REPLANNED:
        lon, lat = run.scene.frame.to_geographic(run.plan.path.x[[REPLANNED[name]]] + 4000.0)
        hours = f"{REPLANNED[name]}h"
        pareto_ltl.replan(place / name, hours, (float(lat[0]), float(lon[0]), 500.0), out=place / "rest")
        values |= {f"rest/{key}": value for key, value in stated(place / "rest").items()}
    return values


def kept() -> dict[str, Any]:
    """The record: ``cases`` by mission, and the ``fingerprint`` of where it was made."""
    content: dict[str, Any] = json.loads(KEPT.read_text())
    return content


LEFT_OUT = ("seconds", "nodes_per_", "memory_")  # of metrics.json: they tell of the machine
FILES = ("plan.json", "metrics.json", "cells.json", "automaton.json", "scene.json", "front.csv", "plan.csv",
         "front.npz", "trees.npz", "deployments.npz", "wind.nc")  # fmt: skip


def stated(directory: Path) -> dict[str, list[Any]]:
    """Each file of :data:`FILES` in short."""
    values = defaultdict[str, list[Any]](list)
    for name in FILES:
        if (directory / name).exists():
            for key, value in _values(directory / name):
                if name != "metrics.json" or not any(word in key for word in LEFT_OUT):
                    values[f"{name}:{key}"].append(value)
    return {key: in_short(held) for key, held in values.items()}


def _values(path: Path) -> Iterator[tuple[str, Any]]:
    if path.suffix == ".json":
        yield from _leaves("", json.loads(path.read_text()))
    elif path.suffix == ".csv":
        for row in csv.DictReader(line for line in path.read_text().splitlines() if line[:1] != "#"):
            yield from row.items()
    elif path.suffix == ".npz":
        with np.load(path) as arrays:
            yield from ((name, value) for name in arrays for value in arrays[name].ravel().tolist())
    else:
        with xr.open_dataset(path, decode_times=False, engine="h5netcdf") as data:
            yield from ((str(n), value) for n in data.variables for value in data[n].values.ravel().tolist())


def _leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _leaves(f"{key}.{name}" if key else name, inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _leaves(key, inner)
    else:
        yield key, value


def in_short(values: list[Any]) -> list[Any]:
    """Number, weighted sum and sum of magnitudes of numbers; checksum of texts, if any."""
    numbers, texts = list[float](), list[str]()
    for value in values:
        try:
            number = float("nan" if value is None or value == "" else value)
        except ValueError:
            number = math.nan
        if math.isfinite(number):
            numbers.append(number)
        else:
            texts.append(str(value))
    weights = 1.0 + 0.5 * np.sin(np.arange(len(numbers)))
    sums = [float(weights @ np.asarray(numbers)), float(np.abs(numbers).sum())] if numbers else []
    return [len(numbers), *sums, *([zlib.crc32("\n".join(texts).encode())] if texts else [])]


def in_lines(cases: dict[str, dict[str, list[Any]]]) -> str:
    """JSON with a line for each case."""
    lines = (f"{json.dumps(name)}:{json.dumps(case, separators=(',', ':'))}" for name, case in cases.items())
    return "{\n" + ",\n".join(lines) + "\n}"


def differences(
    expected: dict[str, list[Any]], here: dict[str, list[Any]], close: float = CLOSE
) -> list[str]:
    """The keys whose texts are others, or whose numbers differ by more than ``close``, with both values."""
    return [
        f"{key}: {expected.get(key)} became {here.get(key)}"
        for key in sorted(expected.keys() | here.keys())
        if not _equal(expected.get(key), here.get(key), close)
    ]


def _equal(a: list[Any] | None, b: list[Any] | None, close: float) -> bool:
    if a is None or b is None or len(a) != len(b) or a[0] != b[0] or a[3:] != b[3:]:
        return False
    if a[0] == 0:
        return a == b
    return all(abs(x - y) <= close * max(a[2], 1e-300) for x, y in zip(a[1:3], b[1:3], strict=True))


def main(names: list[str]) -> None:
    """Write the missions ``names``, or all, into the file."""
    with tempfile.TemporaryDirectory() as folder:
        chosen = names or list(missions(Path(folder)))
        record = kept() if names else {"cases": {}}
        record["fingerprint"] = made_by()
        for name in chosen:
            record["cases"][name] = found(name, Path(folder))
    made = json.dumps(record["fingerprint"])
    KEPT.write_text(f'{{"fingerprint":{made},\n"cases":{in_lines(record["cases"])}}}\n')


if __name__ == "__main__":
    main(sys.argv[1:])
