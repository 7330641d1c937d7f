"""What commands print: text, one JSON document, or only the paths of what was written."""

from __future__ import annotations

import json
import logging
import re
from pathlib import Path

import numpy as np
import pytest

from pareto_ltl.run.plan_run import Run
from pareto_ltl.support.errors import ConfigError
from pareto_ltl_apps.cli.commands import run_command_line
from pareto_ltl_apps.cli.output import Answer, Output, Tell, answered, output_of

WORDS = {
    "front": ["front", "DIR"],
    "explain": ["explain", "DIR"],
    "limits": ["explain", "DIR", "--limits"],
    "export": ["export", "DIR", "--formats", "kml,geojson", "--to", "OUT/files"],
    "verify": ["verify", "DIR"],
    "show": ["show", "DIR", "--print"],
    "choose": ["choose", "DIR", "--point", "0", "--out", "OUT/chosen"],
    "formula": ["formula", "F(a & F b)", "--hoa", "OUT/mission.hoa"],
    "cache": ["cache"],
    "version": ["--version"],
}


def words_of(name: str, result: Path, out: Path) -> list[str]:
    return [word.replace("DIR", str(result)).replace("OUT", str(out)) for word in WORDS[name]]


@pytest.mark.parametrize("name", WORDS)
def test_every_command_gives_one_json_document(
    name: str, page_result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run_command_line([*words_of(name, page_result, tmp_path), "--json"])
    out = capsys.readouterr().out
    document = json.loads(out)
    assert out.count("\n") == 1
    assert isinstance(document, dict)
    assert document
    assert code == (3 if document.get("failed") else 0)


def test_the_documents_have_the_numbers_of_the_files(
    page_result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    front, plan = Run.open(page_result).front, Run.open(page_result).plan

    def document(name: str) -> dict[str, object]:
        run_command_line(["--json", *words_of(name, page_result, tmp_path)])
        found: dict[str, object] = json.loads(capsys.readouterr().out)
        return found

    points = document("front")["points"]
    assert isinstance(points, list)
    assert [point["length_m"] for point in points] == [path.objectives.length for path in front.paths]
    assert all(point["law"] == front.models.law for point in points)
    legs = document("explain")["legs"]
    assert isinstance(legs, list)
    assert len(legs) == len(plan.path.u)
    assert np.isclose([leg["airspeed"] for leg in legs], np.linalg.norm(plan.path.u, axis=1), rtol=1e-6).all()
    files = document("export")["files"]
    assert isinstance(files, list)
    assert all(Path(file).is_file() for file in files)


def test_a_quiet_command_prints_only_what_it_wrote(
    page_result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_command_line(["--quiet", *words_of("export", page_result, tmp_path)])
    assert all(Path(line).is_file() for line in capsys.readouterr().out.splitlines())
    run_command_line(["--quiet", *words_of("choose", page_result, tmp_path)])
    assert capsys.readouterr().out == f"{tmp_path / 'chosen'}\n"
    run_command_line(["--quiet", *words_of("explain", page_result, tmp_path)])
    assert capsys.readouterr().out == ""


def test_the_table_of_a_front_fits_a_terminal_and_marks_the_plan(
    page_result: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["front", str(page_result)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum(line.lstrip().startswith("plan ") for line in lines) == 1
    front = Run.open(page_result).front
    assert f"{front.models.law} winds" in " ".join(lines)
    rows = [line for line in lines if re.match(r" *(plan )?\d+ +[\d.e-]+ %", line)]
    assert len(rows) == len(front.paths)  # a line each
    assert all(re.search(r"% \([\d.e-]+ to [\d.e-]+\)", row) for row in rows)


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["explain", "nowhere"], 2),
        (["choose", "nowhere", "--point", "0"], 2),
        (["plan", "planner.n_max=1"], 2),
        (["plan", "no.such=1"], 2),
        (["formula", "F(a & ("], 2),
        (["nonsense"], 2),
    ],
)
def test_errors_are_documents_too_and_stay_lines_on_the_error_stream(
    words: list[str], code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert run_command_line([*words, "--json"]) == code
    told = capsys.readouterr()
    assert json.loads(told.out)["error"] in told.err
    assert told.err.startswith("pareto-ltl: ")
    assert list(tmp_path.iterdir()) == []


WARNED, OTHER = logging.getLogger("pareto_ltl.run.plan_run"), logging.getLogger("matplotlib.font_manager")
LONG = "the wind used is 10 m above ground: winds at other heights differ, often by a factor of two; read it"


def test_warnings_of_commands_are_in_their_answer_and_other_packages_are_quiet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def warned(_options: object) -> Answer:
        for _ in range(2):
            WARNED.warning(LONG)
            OTHER.warning("findfont: not found")
        return Answer({"a": 1, "warnings": ["known"]}, ["text"])

    def streamed(_options: object, _output: Output) -> int:
        warned(None)
        return 0

    monkeypatch.setattr("pareto_ltl_apps.cli.other_commands.cache", warned)
    monkeypatch.setattr("pareto_ltl_apps.cli.follow_command.follow", streamed)
    assert run_command_line(["cache", "--json"]) == 0
    out, err = capfd.readouterr()
    assert json.loads(out) == {"a": 1, "warnings": ["known", LONG]}
    assert err == ""
    run_command_line(["cache"])
    lines = capfd.readouterr().out.splitlines()
    assert " ".join(lines[:-1]) == f"Warning: {LONG}"
    assert max(map(len, lines)) <= 80
    assert lines[-1] == "text"
    run_command_line(["follow", str(tmp_path), "--log", "x.csv", "--json"])
    assert capfd.readouterr() == ("", f"Warning: {LONG}\n")


def test_help_is_text_in_any_form_of_the_output(capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("--json", "--quiet"):
        assert run_command_line(["verify", "--help", flag]) == 0
        out, err = capsys.readouterr()
        assert out.startswith("usage: pareto-ltl verify")
        assert err == ""


def test_flags_that_exclude_each_other_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["cache", "--json", "--quiet"]) == 2
    assert "--json and --quiet exclude each other" in capsys.readouterr().err
    with pytest.raises(ConfigError):
        output_of(["--quiet", "--verbose"])
    assert output_of(["a", "--json", "b", "--json"]) == (Output.JSON, ["a", "b"])


def test_what_else_is_printed_does_not_reach_programs(capsys: pytest.CaptureFixture[str]) -> None:
    def work(_tell: Tell) -> Answer:
        print("between")
        return Answer({"a": float("nan"), "b": Path("x")}, ["text"], ["x"], code=3)

    expected = {
        Output.JSON: ('{"a": null, "b": "x"}\n', "between\n"),
        Output.QUIET: ("x\n", ""),
        Output.TEXT: ("between\ntext\n", ""),
    }
    for output, streams in expected.items():
        assert answered(work, output) == 3
        assert tuple(capsys.readouterr()) == streams
