"""Every command and every block of Python in the documents is accepted; on the first page, they also run."""

from __future__ import annotations

import ast
import builtins
import importlib
import json
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pareto_ltl
from documents import DOCUMENTS, ROOT, python_blocks, shell_commands
from pareto_ltl_apps.cli.arguments import HELP_FLAGS, CommandArguments
from pareto_ltl_apps.cli.command_table import PIPELINE_COMMANDS
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.cli.composition import opened_hydra, parse_flags, prepare
from pareto_ltl_apps.cli.hydra_app import apply_command
from pareto_ltl_apps.view.showing import DISPLAYS

HYDRA_WORDS = {command.name for command in PIPELINE_COMMANDS}
SHOWN = {*HELP_FLAGS, "--cfg"}  # words of commands that run nothing
EXTENSION = ROOT / "examples" / "extension" / "README.md"  # needs that package; tests/support has its command
START = ROOT / "docs" / "start.md"
SMALL = (
    "fidelity=paper", "fidelity.judge=flights", "planner.trees=2", "planner.n_max=1500",
    "planner.epsilon=0.2", "selection.draws=200", "selection.runs=500", "deployment.runs=50",
    "exports.flights=100",
)  # fmt: skip


class Accepted(BaseException):
    """An argument parser has taken a command line; a BaseException, which no command reports."""


def documented(document: Path) -> Iterator[tuple[str, ...]]:
    """The commands of a document, each once."""
    yield from dict.fromkeys(tuple(words) for words in shell_commands(document))


COMMANDS = {
    words: document.relative_to(ROOT).as_posix()
    for document in DOCUMENTS
    if document != EXTENSION
    for words in documented(document)
}


def is_composed(words: Sequence[str]) -> bool:
    """Whether Hydra reads the command: of a pipeline, of a sweep with settings, or without a command."""
    first = words[0]
    return (
        first in HYDRA_WORDS
        or "=" in first
        or first.startswith(("+", "-"))
        or (first == "sweep" and any("=" in word for word in words[1:]))
    )


def check_composed(words: Sequence[str]) -> None:
    """Compose the settings and check them as a run does, without a run."""
    command = words[0] if words[0] in (*HYDRA_WORDS, "sweep") else None
    arguments = parse_flags(words[1:] if command else words)
    apply_command(arguments, command)
    with opened_hydra(arguments) as hydra:
        assert prepare(hydra, arguments).config


def accepting(parse: Callable[..., Any]) -> Callable[..., None]:
    """``parse``, then :class:`Accepted` in place of the command."""

    def accept(parser: CommandArguments, *args: Any) -> None:
        parse(parser, *args)
        raise Accepted

    return accept


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: f"{COMMANDS[words]}: {' '.join(words)}"[:90])
def test_a_documented_command_is_accepted(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    if words[0] == "formula":
        monkeypatch.chdir(tmp_path)
        assert run_command_line(words) == 0
    elif SHOWN & set(words):
        assert run_command_line(words) == 0
    elif is_composed(words):
        check_composed(words)
    else:
        for name in ("parse_args", "parse_intermixed_args"):
            monkeypatch.setattr(CommandArguments, name, accepting(getattr(CommandArguments, name)))
        with pytest.raises(Accepted):
            run_command_line(words)


# --- the first page, and blocks of Python ----------------------------------------------------


def small_words(words: Sequence[str], place: Path) -> list[str]:
    """A command in a small form: a run with few vertices and flights."""
    if not is_composed(words):
        return list(words)
    named = any(word.startswith("hydra.run.dir=") for word in words)
    return [*words, *SMALL, *([] if named else ["report=none", f"hydra.run.dir={place}"])]


def small_plan(scene: Any, formula: Any, **sections: Any) -> pareto_ltl.Run:
    """``pareto_ltl.plan`` in a small form."""
    few = {"trees": 2, "n_max": 1500, "epsilon": 0.2}
    sections |= {"planner": sections.get("planner", {}) | few, "selection": {"draws": 200, "runs": 500}}
    return FULL_PLAN(scene, formula, fidelity={"name": "paper", "judge": "flights"}, **sections)


FULL_PLAN = pareto_ltl.plan
BLOCKS = [
    pytest.param(code, id=f"{document.relative_to(ROOT)}-{number}")
    for document in DOCUMENTS
    for number, code in enumerate(python_blocks(document))
]


@pytest.fixture(scope="module")
def started(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the commands of the first page were given, one after the other, in a small form."""
    place = tmp_path_factory.mktemp("start")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for name in DISPLAYS:  # show opens no browser then
            patch.delenv(name, raising=False)
        codes = [run_command_line(small_words(words, place / "other")) for words in documented(START)]
    assert codes == [0] * len(codes)
    return place


def test_the_first_page_leads_to_the_files_that_it_names(started: Path) -> None:
    assert {path.name for path in (started / "flight").iterdir()} == {
        "mission.plan", "plan.kml", "dead_reckoning.csv",
    }  # fmt: skip
    for name in ("report.html", "figures/plan.png", "figures/front.png"):
        assert (started / "outputs" / "first" / name).is_file()
    first, shorter, other = (
        pareto_ltl.load_results(started / name) for name in ("outputs/first", "outputs/shorter", "other")
    )
    assert shorter.plan.path.objectives.length <= first.plan.path.objectives.length
    assert (other.plan.formula, other.settings.seed, other.plan.u_max) == ("F(b & F a)", 1, 25.0)


def test_the_page_of_a_results_directory_names_every_file_number_and_array(started: Path) -> None:
    text = (ROOT / "docs" / "results_directory.md").read_text(encoding="utf-8")
    place = started / "outputs" / "first"
    for path in place.iterdir():
        assert path.name.startswith(".") or f"`{path.name}{'/' if path.is_dir() else ''}`" in text, path.name
    for name in json.loads((place / "metrics.json").read_text()):
        known = re.sub(r"(?<=_)(independent|coherent)\b|(?<=_)(independent|coherent)(?=_)", "L", name)
        known = "seconds_STAGE" if known.startswith("seconds_") else known
        assert f"`{known}`" in text, name
    for archive in ("front.npz", "trees.npz", "deployments.npz"):
        row = next(line for line in text.splitlines() if line.startswith(f"| `{archive}` | `"))
        for name in np.load(place / archive):
            assert f"`{name.rpartition('/')[2]}`" in row, (archive, name)
    columns = (place / "plan.csv").read_text().splitlines()[0].split(",")
    assert f"| {', '.join(f'`{name}`' for name in columns)}" in text.replace("one row per step: ", "")


@pytest.mark.parametrize("code", BLOCKS)
def test_a_block_of_python_runs(code: str, started: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With small plans; a part of a module is compiled, and the module has the names that it uses."""
    compiled = compile(code, "block", "exec")
    if "import" not in code:
        parts = ("kernels.parents", "planning.costs.duration", "run.plan_run")
        names = [f"pareto_ltl.{part}" for part in parts]
        names += ["pareto_ltl_apps.studies.sitl", "pareto_ltl_apps.studies.kinds"]
        modules = [importlib.import_module(name) for name in names]
        there = {*dir(builtins), *(name for module in modules for name in vars(module))}
        assert {name for name in compiled.co_names if not name.startswith("_")} <= {*there, *defined_in(code)}
        return
    monkeypatch.chdir(started)
    monkeypatch.setattr(pareto_ltl, "plan", small_plan)
    for name in ("outputs/phi1/...", "outputs/phi2/DIR"):
        code = code.replace(name, "outputs/first")
    exec(compile(code, "block", "exec"), {})


def defined_in(code: str) -> set[str]:
    """The classes and functions that a block defines."""
    return {node.name for node in ast.parse(code).body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
