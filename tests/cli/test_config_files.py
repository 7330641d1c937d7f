"""Configuration files of one's own that are damaged or do harm cost one line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pareto_ltl.support.resources import resource_folder
from pareto_ltl_apps.cli.commands import run_command_line


def refusal(folder: Path, content: bytes, capsys: pytest.CaptureFixture[str]) -> str:
    """What a run with the experiment ``content`` prints."""
    (folder / "experiment").mkdir()
    (folder / "experiment" / "mine.yaml").write_bytes(b"# @package _global_\n" + content)
    assert run_command_line(["+experiment=mine", f"--config-dir={folder}"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    return message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"seed: 3\nname: \xff", "line 3: byte 0xff is not UTF-8"),
        (b"seed: [", "not YAML"),
        (b"seed: 1\nseed: 2", "the key 'seed' occurs twice"),
        (b"seed: " + b"[" * 500 + b"]" * 500, "nested deeper than 64 levels"),
        (b"name: ${oc.env:HOME}", "name: ${oc.env:HOME} would write a variable of the environment"),
        (b"scene: {file: '${oc.${name}:HOME}'}\nname: env", "scene.file: ${oc.env:HOME} would write"),
        (b"defaults: 3", "the configuration cannot be composed"),
        (b"defaults: [null]", "the configuration cannot be composed"),
        (b"defaults: [override /mission: true]", "the configuration cannot be composed"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_named(
    content: bytes, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    message = refusal(tmp_path, content, capsys)
    assert words in message
    assert re.search("mine.yaml|check your configuration files|write its value", message)


def test_aliases_that_multiply_are_refused_before_hydra_follows_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["a0: &a0 [x]", *(f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]" for i in range(30))]
    message = refusal(tmp_path, "\n".join(lines).encode(), capsys)
    assert "its aliases expand to more than 1,000,000 values" in message
    assert "correct the file" in message


@pytest.mark.parametrize("path", sorted(resource_folder("conf").rglob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_files_are_within_the_limits(path: Path) -> None:
    from careful_io.yaml_files import read_yaml

    read_yaml(path)
