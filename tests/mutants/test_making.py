"""Mutants change one place each, the same ones every time; the harness tells which of them tests notice."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

from mutants import harness
from mutants.making import drawn, mutants
from mutants.table import EQUIVALENT, MODULES

SOURCE = '''"""Docstring, 7 < 8."""
from typing import Final
LIMIT: Final = 3

def part(share: float = 0.5, *, whole: "1 < 2" = 4) -> int:
    """1 + 1."""
    if not share > 0 and whole:
        raise ValueError("no " + str(1 + 1))
    print(whole)
    return max(whole, LIMIT) * -share
'''


def test_each_kind_of_place_has_a_mutant_and_what_changes_no_result_has_none() -> None:
    found = [(one.line, one.old, one.new) for one in mutants(SOURCE)]
    assert found == [
        (3, "3", "4"),
        (5, "4", "5"),
        (5, "0.5", "0.75"),
        (7, "not share > 0 and whole", "(not (not share > 0 and whole))"),
        (7, "not share > 0 and whole", "(not share > 0 or whole)"),
        (7, "not share > 0", "(share > 0)"),
        (7, "share > 0", "(share >= 0)"),
        (7, "0", "1"),
        (9, "print(whole)", "pass"),
        (10, "max(whole, LIMIT) * -share", "(max(whole, LIMIT) / -share)"),
        (10, "max", "min"),
        (10, "-share", "(share)"),
    ]


def test_an_unknown_length_has_no_mutant_that_is_another_negative_number() -> None:
    assert [(one.old, one.new) for one in mutants("x.reshape(-1, 2)")] == [
        ("x.reshape(-1, 2)", "pass"), ("-1", "(1)"), ("2", "3"),
    ]  # fmt: skip


def test_a_mutant_differs_from_the_source_in_its_place_alone() -> None:
    for one in mutants(SOURCE):
        ast.parse(one.source)
        changed = [
            k
            for k, (a, b) in enumerate(zip(SOURCE.splitlines(), one.source.splitlines(), strict=True))
            if a != b
        ]
        assert changed == [one.line - 1]


def test_every_module_of_the_table_has_tests_and_its_mutants_can_be_compiled() -> None:
    for module, tests in MODULES.items():
        assert all((harness.TESTS / name).is_file() for name in tests)
        made = mutants(harness.file_of(module, harness.ROOT / "src").read_text(encoding="utf-8"), module)
        assert made
        for one in made[:: max(len(made) // 5, 1)]:
            compile(one.source, one.module, "exec")
    for module, stands, old, new in EQUIVALENT:  # a line that is gone needs no reason
        made = mutants(harness.file_of(module, harness.ROOT / "src").read_text(encoding="utf-8"), module)
        assert (module, stands, old, new) in {one.key for one in made}


def test_the_same_seed_draws_the_same_mutants(tmp_path: Path) -> None:
    file = tmp_path / "a.py"
    file.write_text(SOURCE)
    first, again, other = (drawn({"a": file}, 5, seed) for seed in ("1", "1", "2"))
    assert first == again
    assert first != other
    assert len(drawn({"a": file}, 99, "1")) == len(mutants(SOURCE))


@pytest.mark.skipif(sys.platform != "linux", reason="the tests of a mutant run in a fork")
def test_mutants_that_no_test_notices_are_told_and_a_loop_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tests of a module of two functions: one is tested, the other is not, and one mutant never ends."""
    source, tests = tmp_path / "src", tmp_path / "tests"
    source.mkdir()
    tests.mkdir()
    code = (
        "def one(n):\n    while n > 0:\n        n -= 1\n    return n\n\n\ndef other(a):\n    return a + a\n"
    )
    (source / "small_module.py").write_text(code)
    (tests / "test_small.py").write_text("from small_module import one\ndef test_it(): assert one(5) == 0\n")
    for name, value in {"TESTS": tests, "ROOT": tmp_path, "MORE_TIME": (2.0, 2.0)}.items():
        monkeypatch.setattr(harness, name, value)
    alive = harness.survivors(mutants(code, "small_module"), {"small_module": ("test_small.py",)}, source)
    assert [one.old for one in alive] == ["a + a"]
    assert (source / "small_module.py").read_text() == code
    assert capsys.readouterr().out.count("killed") == len(mutants(code)) - 1
