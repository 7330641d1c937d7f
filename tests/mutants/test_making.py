"""Mutants change one place each, the same ones every time; the harness tells which of them tests notice."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

from mutants.judge import Case, judged
from mutants.making import drawn, mutants
from mutants.reach import Reach
from mutants.table import EQUIVALENT, modules

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


@pytest.mark.parametrize(
    "source",
    [
        "log.info(1 + 1)",
        "pairs = zip(a, b, strict=True)",
        "text = dumps(a, indent=2)",
        "def __repr__(self):\n    return 1 + 1",
        "x = 1e-9",
        "x = 1e-9 * max(a, 2)",
        "x = a + 1e-9 * b",
        "x = np.empty((2, 3))",
        "chunk = cumsum(counts) // PAIRS_AT_ONCE",
        "x = f'{1 + 1}'",
        "assert 1 < 2",
        "if TYPE_CHECKING:\n    a = 1 + 1",
    ],
)
def test_a_kind_that_is_left_out_has_no_mutants(source: str) -> None:
    assert mutants(source) == []


@pytest.mark.parametrize(
    ("source", "tied"),
    [
        ("if a < b:\n    a = b", True),
        ("if a < b:\n    b = c", False),
        ("x = a if a > b else b", True),
        ("x = a if a > b else c", False),
        ("x = first <= end + ROUNDING", True),
        ("x = first <= end + 1e-9", True),
        ("x = first <= end", False),
    ],
)
def test_strictness_is_left_out_where_equality_changes_nothing(source: str, tied: bool) -> None:
    strict = {one.new for one in mutants(source) if {"<", "<=", ">", ">="} & set(one.new.split()[1:2])}
    assert (not strict) == tied


def test_mutants_of_every_module_can_be_compiled() -> None:
    for module, file in modules().items():
        made = mutants(file.read_text(encoding="utf-8"), module)
        for one in made[:: max(len(made) // 5, 1)]:
            compile(one.source, one.module, "exec")
    for module, stands, old, new in EQUIVALENT:  # a line that is gone needs no reason
        made = mutants(modules()[module].read_text(encoding="utf-8"), module)
        assert (module, stands, old, new) in {one.key for one in made}


def test_the_same_seed_draws_the_same_mutants(tmp_path: Path) -> None:
    file = tmp_path / "a.py"
    file.write_text(SOURCE)
    first, again, other = (drawn({"a": file}, 5, seed) for seed in ("1", "1", "2"))
    assert first == again
    assert first != other
    assert len(drawn({"a": file}, 99, "1")) == len(mutants(SOURCE))


SMALL = (
    "LIMIT = 3\n\n\ndef part(a):\n    b = a + 1\n    return b < LIMIT\n\n\ndef other(a, b=2):\n    return a\n"
)
QUICK, SLOW, ONE = "tests/test_a.py::quick", "tests/test_a.py::slow", "tests/test_b.py::one"


@pytest.fixture
def reach(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Reach:
    """Of ``SMALL``: one test runs all of ``part``, another its first line, and the third ``other``."""
    (tmp_path / "small.py").write_text(SMALL)
    monkeypatch.setattr("mutants.reach.SOURCE", tmp_path)
    found = Reach()
    found.seconds = {QUICK: 0.1, SLOW: 2.0, ONE: 0.2}
    found.lines = {"small.py": {5: [SLOW, ONE], 6: [SLOW], 10: [ONE]}}
    return found


@pytest.mark.parametrize(
    ("old", "tests"),
    [
        ("a + 1", (ONE, SLOW, QUICK)),  # both that run the line, then the other one of their files
        ("b < LIMIT", (SLOW, QUICK)),
        ("3", (SLOW, QUICK)),  # of the module: where its name is used
        ("2", (ONE,)),  # a default: where the function is run
    ],
)
def test_a_mutant_meets_the_tests_that_run_its_line_and_others_of_their_file(
    reach: Reach, tmp_path: Path, old: str, tests: tuple[str, ...]
) -> None:
    (one,) = [one for one in mutants(SMALL, "small") if one.old == old]
    assert reach.tests(one, tmp_path / "small.py")[0] == tests


def test_tests_are_chosen_as_far_as_time_reaches(reach: Reach, tmp_path: Path) -> None:
    (one,) = [one for one in mutants(SMALL, "small") if one.old == "a + 1"]
    assert reach.tests(one, tmp_path / "small.py", 1.0) == ((ONE,), 0.2)


@pytest.mark.skipif(sys.platform != "linux", reason="the tests of a mutant run in a fork")
def test_mutants_that_no_test_notices_are_told_and_a_loop_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tests of a module of two functions: one is tested, the other is not, and one mutant never ends."""
    code = (
        "LIMIT = 5\n\n\ndef one(n):\n    while n > 0:\n        n -= 1\n    return n\n\n\n"
        "def other(a):\n    return a + a\n"
    )
    file, test = tmp_path / "small_module.py", "tests/test_small.py"
    file.write_text(code)
    (tmp_path / "tests").mkdir()
    (tmp_path / test).write_text(
        "from small_module import LIMIT, one\ndef test_it(): assert one(LIMIT) == 0 and LIMIT == 5\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("mutants.judge.MORE_TIME", (2.0, 2.0))
    made = mutants(code, "small_module")
    told: list[str] = []
    verdicts = judged(
        [Case(one, file, (f"{test}::test_it",), 0.1) for one in made],
        tmp_path,
        lambda case, verdict: told.append(case.mutant.old),
    )
    assert [one.old for one, verdict in verdicts.items() if not verdict.killed] == ["a + a"]
    assert sorted(told) == sorted(one.old for one in made)
    assert file.read_text() == code


@pytest.mark.skipif(sys.platform != "linux", reason="the tests of a mutant run in a fork")
def test_a_test_that_fails_without_a_mutant_kills_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = "ONE = 1\n\n\ndef twice(a):\n    return a + a\n"
    file, test = tmp_path / "smaller_module.py", "tests/test_smaller.py"
    file.write_text(code)
    (tmp_path / "tests").mkdir()
    (tmp_path / test).write_text(
        "from smaller_module import twice\n\n\n"
        "def test_wrong(): assert twice(1) == 3\n\n\ndef test_none(): pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    names = tuple(f"{test}::{name}" for name in ("test_wrong", "test_none"))
    made = [Case(one, file, names, 0.1) for one in mutants(code, "smaller_module")]
    assert len(made) == 2
    assert not any(one.killed for one in judged(made, tmp_path, lambda *_: None).values())


@pytest.mark.skipif(sys.platform != "linux", reason="the tests of a mutant run in a fork")
@pytest.mark.parametrize("test", ["while True:\n        pass", "os._exit(7)"], ids=["endless", "dies"])
def test_a_mutant_that_changes_nothing_is_not_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, test: str
) -> None:
    """By tests that pass, by one that never ends, and by one that ends the process."""
    code = "def twice(a):\n    return a + a\n"
    same = "def twice(a):\n    return 2 * a\n"
    name = f"null_module_{test[:2].strip('_.')}"
    file, path = tmp_path / f"{name}.py", f"tests/test_{name}.py"
    file.write_text(code)
    (tmp_path / "tests").mkdir()
    (tmp_path / path).write_text(
        f"import os\n\nfrom {name} import twice\n\n\ndef test_good(): assert twice(3) == 6\n\n\n"
        f"def test_bad():\n    {test}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("mutants.judge.MORE_TIME", (1.0, 1.0))
    (one,) = mutants(code, name)
    null = one._replace(source=same)
    for chosen in (("test_good",), ("test_good", "test_bad")):
        names = tuple(f"{path}::{part}" for part in chosen)
        verdicts = judged([Case(null, file, names, 0.1)], tmp_path, lambda *_: None)
        assert [verdict.killed for verdict in verdicts.values()] == [False]
