"""``pareto-ltl rerun DIR``: make a result again from its settings, and compare byte by byte."""

from __future__ import annotations

import csv
import re
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from careful_io.error_lines import one_line
from careful_io.links import refuse_links_out
from careful_io.messages import shown_text
from pareto_ltl import Run
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError
from pareto_ltl.support.run_status import ending_text
from pareto_ltl_apps.cli.output import Answer
from pareto_ltl_apps.formats.settings import IngestConfig

if TYPE_CHECKING:
    from pareto_ltl import Settings
    from pareto_ltl.extend import Pipeline

CODE_VERSIONS = ("version", "code_hash", "python")
TIME_COLUMN = "second"  # part of the name of columns of computing times


def rerun(options: Namespace) -> Answer:
    """Make a result again; the exit code is 0 if it is the same, 1 if it differs."""
    with _second_place(options.into) as place:
        return rerun_and_compare(options.directory, place, options.settings)


@contextmanager
def _second_place(into: Path | None) -> Iterator[Path]:
    """The folder of the second result: the one to keep, or a temporary one."""
    if into is None:
        with tempfile.TemporaryDirectory(prefix="pareto_ltl_rerun_") as folder:
            yield Path(folder)
        return
    if into.exists() and (not into.is_dir() or any(into.iterdir())):
        raise ConfigError(f"--into {into}: it exists and is not empty; name a new folder")
    yield into


def rerun_and_compare(directory: Path, place: Path, words: Sequence[str] = ()) -> Answer:
    """Run the settings of ``directory`` into ``place``; the differences, and what may explain them.

    The user's ``words`` allow what settings of another person may not do (``received.py``).

    Raises
    ------
    ConfigError
        If the settings would act, and no word allows it.
    DataError
        If the directory holds no result, or if none of its files can be compared.
    """
    from pareto_ltl.extend import Pipeline
    from pareto_ltl_apps.received import allowed_settings

    refuse_links_out(directory)
    before = _finished_record(directory)
    settings = _kept_inside(allowed_settings(directory, before["inputs"], words), place)
    read_now = Run(settings).input_hashes()
    notes = [
        *_code_changes(before, Run(settings).provenance),
        *_changed_inputs(before["inputs"], read_now),
    ]

    def answer(same: bool, *differences: str, compared: Sequence[str] = ()) -> Answer:
        document = {"same": same, "differences": differences, "compared": compared, "notes": notes}
        reported = differences or [f"the same, byte for byte: {', '.join(compared)}"]
        return Answer(document, [*(f"note: {note}" for note in notes), *reported], code=0 if same else 1)

    checked = Pipeline.of(settings)
    try:
        checked.run(place, before["argv"], before["overrides"])
    except InfeasibleError as error:
        same = before["status"] == "infeasible" and before["error"] == one_line(error)
        return answer(same, "infeasible again, for the same reason" if same else f"now infeasible: {error}")
    if before["status"] == "infeasible":
        return answer(False, f"now there is an answer; before: {before['error']}")
    compared, differ = _compare_results(directory, place, before, checked)
    return answer(not differ, *differ, compared=compared)


def _finished_record(directory: Path) -> dict[str, Any]:
    """``run.json`` of a run that ended with an answer, with a default for each missing key."""
    from pareto_ltl.support.run_status import ANSWERS
    from pareto_ltl.support.schemas import read_document

    written = read_document(directory / "run.json", "run")
    record = {"argv": [], "overrides": [], "inputs": {}, "packages": {}} | written
    if record.get("status") not in ANSWERS:
        raise DataError(
            f"{directory}: there is nothing to compare: {ending_text(directory, record.get('status'))}"
        )
    return record


def _kept_inside(settings: Settings, place: Path) -> Settings:
    """``settings`` with which a run writes only into ``place``."""
    ingest = settings[IngestConfig]
    return settings.with_sections(replace(ingest, out=str(place / Path(ingest.out).name)))


def _code_changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Changes of the code and of packages, which may explain a difference."""
    for name in CODE_VERSIONS:
        if before.get(name) != now[name]:
            yield f"{name} was {str(before.get(name))[:12]}, is {now[name][:12]}"
    for package, here in now["packages"].items():
        if before["packages"].get(package) != here:
            yield f"{package} was {before['packages'].get(package)}, is {here}"


def _changed_inputs(before: Mapping[str, Any], now: Mapping[str, str]) -> Iterator[str]:
    """Files that the run read and this one does not, under any name."""
    for name, digest in before.items():
        if digest not in now.values():
            yield f"{shown_text(name)} is not what the run read"


# --- comparing -------------------------------------------------------------------------------


def _compare_results(
    one: Path, two: Path, before: Mapping[str, Any], pipeline: Pipeline
) -> tuple[list[str], list[str]]:
    """The files that the stages of ``pipeline`` write, and the differences of both folders in them."""
    names = _written_names(pipeline, one, two)
    differ = {name: unlike for name in names if (unlike := _file_difference(one / name, two / name))}
    tables = _tables_elsewhere(before, two)
    differ |= {name: f"{name} has other bytes" for name, same in tables.items() if not same}
    compared = [*names, *tables]
    if not compared:
        raise DataError(
            f"{one} holds none of the files that its pipeline writes; there is nothing to compare"
        )
    return compared, list(differ.values())


def _written_names(pipeline: Pipeline, *places: Path) -> list[str]:
    """Files in one of ``places`` that the stages of ``pipeline`` write, in the order of the stages."""
    patterns = [pattern for stage in pipeline.stages for pattern in stage.writes]
    found = (path.relative_to(place) for p in patterns for place in places for path in sorted(place.glob(p)))
    return list(dict.fromkeys(path.as_posix() for path in found))


def _tables_elsewhere(before: Mapping[str, Any], place: Path) -> dict[str, bool]:
    """For each file that the run wrote outside its directory: whether the second run made the same."""
    from careful_io.fingerprints import file_fingerprint

    outputs = before.get("outputs")
    made = ((str(name), place / Path(str(name)).name, digest) for name, digest in (outputs or {}).items())
    return {name: path.is_file() and file_fingerprint(path) == digest for name, path, digest in made}


def _file_difference(one: Path, two: Path) -> str | None:
    """The first difference of two files, or None; columns of seconds are ignored."""
    missing = [str(path) for path in (one, two) if not path.is_file()]
    if missing:
        return f"{' and '.join(missing)} missing"
    before, after = _compared_lines(one), _compared_lines(two)
    if before == after:
        return None
    pairs = enumerate(zip(before, after, strict=False), 1)
    line = next((number for number, (a, b) in pairs if a != b), min(len(before), len(after)) + 1)
    where = f"line {line}" if line <= min(len(before), len(after)) else f"line {line}, where one of both ends"
    return f"{one.name} differs, first in {where}{_key_of(one, before[line - 1 : line])}"


def _key_of(path: Path, lines: list[bytes]) -> str:
    """The key of a line of JSON or YAML, in brackets; other files are not quoted."""
    keyed = path.suffix in (".json", ".yaml") and lines
    found = re.match(rb'\s*"?([a-z_][a-z0-9_.]{0,39})"?:', lines[0]) if keyed else None
    return f" ({found[1].decode()})" if found else ""


def _compared_lines(path: Path) -> list[bytes]:
    data = path.read_bytes()
    if path.suffix != ".csv" or TIME_COLUMN.encode() not in data.split(b"\n", 1)[0]:
        return data.splitlines()
    rows = list(csv.reader(data.decode(errors="replace").splitlines()))
    kept = [column for column, name in enumerate(rows[0]) if TIME_COLUMN not in name]
    return [",".join(row[column] for column in kept if column < len(row)).encode() for row in rows]
