"""YAML files are read within limits, and what is wrong is said in one line with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from careful_io import yaml_files
from careful_io.yaml_files import read_yaml
from pareto_ltl.support.errors import DataError


def doubling(levels: int) -> str:
    """Lists of which each holds the one before nine times."""
    lines = ["a0: &a0 [x]"]
    lines += [f"a{i + 1}: &a{i + 1} [{', '.join([f'*a{i}'] * 9)}]" for i in range(levels)]
    return "\n".join(lines)


def merging(levels: int) -> str:
    """Mappings of which each takes in the one before twice, by a merge key."""
    lines = ["a0: &a0 {x: 1}", *(f"a{i + 1}: &a{i + 1} {{<<: [*a{i}, *a{i}]}}" for i in range(levels))]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (doubling(30), "line 7: its aliases expand to more than 1,000,000 values"),
        (merging(30), "its aliases expand to more than 1,000,000 values"),
        ("a0: &a0 []\n" + "\n".join(f"a{i + 1}: &a{i + 1} [*a{i}]" for i in range(80)), "nested deeper than"),
        ("a: &a [*a]", "line 1: an anchor contains its alias"),
        ("[" * 100, "nested deeper than 64 levels"),
        ("[" * 70 + "]" * 70, "line 1: nested deeper than 64 levels"),
        ("[" * 100_000 + "]" * 100_000, "line 1: nested deeper than 64 levels"),
        ("a: 1\nb: [\n", "not YAML"),
        ("a: " + "9" * 5000, "a value cannot be read"),
        ("a: 2018-99-99", "a value cannot be read"),
        ("a: 1\n---\nb: 1", "expected a single document"),
        ("a: !!python/object:os.system x", "not YAML"),
        ("a: 1\nb: 2\na: 3", "line 1: the key 'a' occurs twice"),
        ("a: \0", "not YAML"),
    ],
)  # fmt: skip
def test_a_document_beyond_the_limits_is_refused(content: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(content)
    with pytest.raises(DataError) as caught:
        read_yaml(tmp_path / "a.yaml")
    message = str(caught.value)
    assert words in message
    assert message.startswith(str(tmp_path / "a.yaml"))
    assert message.endswith("; run the plan again")
    assert "\n" not in message


@pytest.mark.parametrize("loader", ["CSafeLoader", "SafeLoader"])
def test_what_is_within_the_limits_is_read(
    loader: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import yaml

    if loader == "SafeLoader":
        monkeypatch.delattr(yaml, "CSafeLoader", raising=False)  # as where PyYAML is without libyaml
    (tmp_path / "a.yaml").write_text("a: &a [1, 2.5]\nb: {c: *a, d: *a}\n", encoding="utf-8-sig")
    assert read_yaml(tmp_path / "a.yaml") == {"a": [1, 2.5], "b": {"c": [1, 2.5], "d": [1, 2.5]}}
    (tmp_path / "a.yaml").write_text("# nothing\n")
    assert read_yaml(tmp_path / "a.yaml") is None


def test_a_large_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yaml_files, "MAX_YAML_BYTES", 1000)
    (tmp_path / "a.yaml").write_text("a: " + 2000 * "x")
    with pytest.raises(DataError, match="which is the limit"):
        read_yaml(tmp_path / "a.yaml")
