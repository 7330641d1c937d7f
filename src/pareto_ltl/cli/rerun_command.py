"""``pareto-ltl rerun DIR``: make a result again from what its directory says, and compare byte by byte."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pareto_ltl.cli.arguments import CommandArguments, run_reported
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError

COMPARED_FILES = ("plan.json", "front.csv")
CODE_VERSIONS = ("version", "code_hash", "python")


def rerun_command(argv: Sequence[str]) -> int:
    """0 where the result is the same, 1 where it differs, 2 with one line where it cannot be made again."""
    return run_reported(lambda: _rerun_arguments(argv))


def _rerun_arguments(argv: Sequence[str]) -> int:
    parser = CommandArguments(
        prog="pareto-ltl rerun",
        description="Make a result again from its own settings and compare both, byte by byte.",
    )
    parser.add_argument("directory", type=Path, help="for example multirun/phi2/04b3a3fb44baa8a5")
    parser.add_argument("--into", type=Path, metavar="FOLDER", help="keep the second result there")
    options = parser.parse_args(argv)
    with _second_place(options.into) as place:
        return rerun_and_compare(options.directory, place)


@contextmanager
def _second_place(into: Path | None) -> Iterator[Path]:
    """Where the second result goes: a folder to keep, or one for the comparison only."""
    if into is None:
        with tempfile.TemporaryDirectory(prefix="pareto_ltl_rerun_") as folder:
            yield Path(folder)
        return
    if into.exists() and any(into.iterdir()):
        raise ConfigError(f"--into {into}: the folder is not empty; name a new one")
    yield into


def rerun_and_compare(directory: Path, place: Path) -> int:
    """Run the settings of ``directory`` into ``place`` and say what differs."""
    from pareto_ltl.cli.setting_keys import read_run_settings
    from pareto_ltl.cli.stage_table import application_stages
    from pareto_ltl.run import pipeline, provenance
    from pareto_ltl.support.files import read_json

    before = read_json(directory / "run.json")
    if before.get("status") not in ("ok", "infeasible"):
        raise DataError(
            f"{directory}: its run ended as {before.get('status')!r}; there is nothing to compare"
        )
    settings = read_run_settings(directory / "config_resolved.yaml")
    for line in _code_changes(before, provenance.begin(settings, ())):
        print(f"note: {line}")
    moved = [name for name, digest in before["inputs"].items() if not provenance.unchanged({name: digest})]
    for name in moved:
        print(f"note: {name} is not what the run read")
    try:
        checked = pipeline.check_pipeline(settings, application_stages(settings))
        pipeline.run_pipeline(checked, place, before["argv"], before.get("overrides", ()))
    except InfeasibleError as error:
        same = before["status"] == "infeasible" and before["error"] == provenance.one_line(error)
        print("infeasible again, for the same reason" if same else f"now infeasible: {error}")
        return 0 if same else 1
    pairs = [(directory / name, place / name) for name in COMPARED_FILES]
    differ = [unlike for pair in pairs if (unlike := _file_difference(*pair))]
    print("\n".join(differ) or f"the same, byte for byte: {', '.join(COMPARED_FILES)}")
    return 1 if differ else 0


def _code_changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """What is different about the code and the packages, which may explain a difference."""
    for name in CODE_VERSIONS:
        if before.get(name) != now[name]:
            yield f"{name} was {str(before.get(name))[:12]}, is {now[name][:12]}"
    for package, here in now["packages"].items():
        if before["packages"].get(package) != here:
            yield f"{package} was {before['packages'].get(package)}, is {here}"


def _file_difference(one: Path, two: Path) -> str | None:
    """Where two files part, or None."""
    if not one.is_file() or not two.is_file():
        missing = [str(path) for path in (one, two) if not path.is_file()]
        return f"{' and '.join(missing)} missing" if len(missing) == 1 else None
    before, after = one.read_bytes().splitlines(), two.read_bytes().splitlines()
    if before == after:
        return None
    pairs = enumerate(zip(before, after, strict=False), 1)
    line = next((number for number, (a, b) in pairs if a != b), min(len(before), len(after)) + 1)
    what = (
        before[line - 1].split(b":")[0].strip().decode(errors="replace")[:40]
        if line <= len(before)
        else "end"
    )
    return f"{one.name} differs, first in line {line} ({what})"
