"""Lies that are made, not written: one fact of any file is changed, in all records that state it.

Records are judged without the exported files and the page, which a liar would write anew; a fact of an
exported file or of the page is judged with all files, and a setting without the page alone, which has all of
them.
"""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from careful_io.archives import read_npz
from careful_io.files import write_json, write_npz
from careful_io.fingerprints import data_fingerprint
from careful_io.reading import read_json
from lies.about_pages import DATA

SETTINGS = "config_resolved.yaml"
RECORDS = (
    "plan.json", "run.json", "metrics.json", "scene.json", "cells.json", "automaton.json", "front.csv",
    "plan.csv", "front.npz", "trees.npz", "deployments.npz", SETTINGS,
)  # fmt: skip
KEPT = (*RECORDS, "automaton.hoa", "wind.nc")
EXPORTS = (
    "plan.geojson", "corridor.geojson", "mission.plan", "mavlink_script.json", "dead_reckoning.csv",
    "flight_card.csv",
)  # fmt: skip
PAGE = "report.html"
HASH = "config_hash"
FILES = (*RECORDS, *EXPORTS, PAGE)
LONG = 9  # characters from which on a number is the same fact wherever it stands
Path_ = tuple[Any, ...]


class Fact(NamedTuple):
    """A value of a file: where it stands, and the place without the numbers of entries."""

    file: str
    place: Path_
    kind: str
    value: Any


def facts(folder: Path, file: str) -> dict[str, list[Fact]]:
    """The facts of a file by their kind: the path to them with ``*`` for the number of an entry."""
    found: dict[str, list[Fact]] = {}
    for place, value in _leaves(_read(folder / file)):
        kind = "/".join("*" if isinstance(key, int) else re.sub(r"\d+", "#", str(key)) for key in place)
        found.setdefault(kind, []).append(Fact(file, place, kind, value))
    return found


def _leaves(content: Any, place: Path_ = ()) -> Iterator[tuple[Path_, Any]]:
    pairs = content.items() if isinstance(content, Mapping) else enumerate(content)
    for key, value in pairs:
        if isinstance(value, np.ndarray):
            flat = value.ravel()
            yield from (
                ((*place, key, k), flat[k].item()) for k in range(0, len(flat), max(len(flat) // 50, 1))
            )
        elif isinstance(value, Mapping | list):
            yield from _leaves(value, (*place, key))
        elif value is not None:
            yield (*place, key), value


def _read(path: Path) -> Any:
    if path.suffix == ".csv":
        with path.open(encoding="utf-8") as file:
            return list(csv.DictReader(file))
    if path.suffix == ".npz":
        return dict(read_npz(path))
    if path.suffix == ".yaml":
        return yaml.safe_load(path.read_text())
    if path.suffix == ".html":
        return json.loads(DATA.findall(path.read_text(encoding="utf-8"))[0][1])
    return read_json(path)


def _write(path: Path, content: Any) -> None:
    if path.suffix == ".csv":
        text = io.StringIO()
        writer = csv.DictWriter(text, list(content[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(content)
        path.write_text(text.getvalue(), encoding="utf-8")
    elif path.suffix == ".npz":
        write_npz(path, content)
    elif path.suffix == ".yaml":
        path.write_text(yaml.safe_dump(content, sort_keys=False))
    elif path.suffix == ".html":
        page = path.read_text(encoding="utf-8")
        begin, old, end = DATA.findall(page)[0]
        new = json.dumps(content, separators=(",", ":"), ensure_ascii=False)
        for sign in "<>&":
            new = new.replace(sign, f"\\u{ord(sign):04x}")
        path.write_text(page.replace(begin + old + end, begin + new + end), encoding="utf-8")
    else:
        write_json(path, content)


CHANGES: dict[str, Callable[[Any], Any]] = {
    "half": lambda value: value / 2,
    "a tenth more": lambda value: value * 1.1,
    "ten times": lambda value: value * 10,
    "other sign": lambda value: -value,
    "one more": lambda value: value + 1,
}


def changed(value: Any, change: str) -> Any:
    """Another value of the same kind; the same one if the change does not apply."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        new = CHANGES[change](value)
        return type(value)(round(new)) if isinstance(value, int) else float(new)
    text = str(value)
    try:
        number = float(text)
    except ValueError:
        return f"{text} certified" if change != "half" else text[: len(text) // 2]
    return repr(type(number)(CHANGES[change](number)))


def told(folder: Path, copy: Path, fact: Fact, change: str) -> Path | None:
    """A copy of a result in which a fact is another one; None if the change does not change it.

    Less than 10⁻⁸ of a number is not compared: 2 cm of 2,000 km, 1 cm of a latitude; and less than 10⁻⁴ of a
    covariance, for the modes of the planner have single precision.
    """
    new = changed(fact.value, change)
    if _alike(fact.value, new, 1e-4 if "cov" in fact.kind.rpartition("/")[2] else 1e-8):
        return None
    if fact.kind == HASH:  # follows from the settings, and is written anew
        return None
    if new == fact.value or str(new) == str(fact.value) or new != new:  # noqa: PLR0124 - NaN
        return None
    left_out = _page if fact.file == SETTINGS else _left_out if fact.file in RECORDS else None
    shutil.copytree(folder, copy, ignore=left_out)
    content = _read(copy / fact.file)
    _put(content, fact.place, new)
    _write(copy / fact.file, content)
    if fact.file in RECORDS:
        _everywhere(copy, fact, new)
        _hash_again(copy)
    return copy


def _alike(value: Any, new: Any, share: float) -> bool:
    try:
        old = float(value)
        return 0.0 < abs(float(new) - old) <= share * abs(old)
    except (TypeError, ValueError):
        return False


def _left_out(_folder: str, names: list[str]) -> list[str]:
    return [name for name in names if name not in KEPT]


def _page(_folder: str, names: list[str]) -> list[str]:
    return [name for name in names if name == PAGE]


def _put(content: Any, place: Path_, value: Any) -> None:
    for depth, key in enumerate(place):
        if isinstance(content[key], np.ndarray):
            array = content[key].copy()
            if array.dtype.kind == "U":  # which would cut a longer text
                array = array.astype(f"<U{max(len(str(value)), array.dtype.itemsize // 4)}")
            content[key] = array
            array.reshape(-1)[place[depth + 1]] = value
            return
        if depth == len(place) - 1:
            content[key] = value
            return
        content = content[key]


def _everywhere(copy: Path, fact: Fact, new: Any) -> None:
    """Change the same long number in the other records."""
    old, text = str(fact.value), str(new)
    if len(old) < LONG or not re.fullmatch(r"-?[\d.e+-]+", old):
        return
    for path in copy.iterdir():
        if path.suffix in (".json", ".csv", ".yaml"):
            before = path.read_text(encoding="utf-8")
            after = re.sub(rf"(?<![\d.]){re.escape(old)}(?![\d.])", text, before)
            if after != before:
                path.write_text(after, encoding="utf-8")


def _hash_again(copy: Path) -> None:
    """The fingerprint of the settings in run.json is that of the settings as they are."""
    run, settings = read_json(copy / "run.json"), _read(copy / "config_resolved.yaml")
    planner = {key: value for key, value in settings["planner"].items() if key != "threads"}
    content = {key: value for key, value in settings.items() if key != "sweep"} | {"planner": planner}
    hashed = {"version": run["version"], "code": run["code_hash"], "settings": content}
    write_json(copy / "run.json", run | {"config_hash": data_fingerprint(hashed)})
