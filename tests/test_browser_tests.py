"""Tests in a browser wait for what an action leads to: no ``assert`` reads the page right after a click."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
# Methods of Playwright and of our pages that act, and those that wait until their effect is there.
ACTS = {
    "check", "click", "drag", "draw", "fill", "focus", "go", "press", "reload", "select_option",
    "set_checked", "set_input_files", "submit", "type", "uncheck", "wheel", "begin_anew", "draw_mission",
}  # fmt: skip
WAITS = {
    "becomes", "drawn", "expect", "kept", "pdf", "wait", "wait_for_selector", "wait_for_timeout",
    "downloaded", "plan_mission",
}  # fmt: skip
READS = {
    "all_text_contents", "count", "evaluate", "get_attribute", "inner_html", "inner_text", "input_value",
    "is_checked", "is_disabled", "is_enabled", "is_hidden", "is_visible", "text_content", "value",
}  # fmt: skip


def calls(node: ast.AST) -> set[str]:
    """The names of all that is called in a node."""
    called = [one.func for one in ast.walk(node) if isinstance(one, ast.Call)]
    return {one.attr if isinstance(one, ast.Attribute) else getattr(one, "id", "") for one in called}


def hasty(body: list[ast.stmt], acted: bool = False) -> Iterator[ast.stmt]:
    """Assertions that read a page after an action, with no wait between both."""
    for statement in body:
        inner = [
            part
            for name in ("body", "orelse", "finalbody")
            for part in [getattr(statement, name, [])]
            if part
        ]
        if inner:
            for part in inner:
                yield from hasty(part, acted)
            called = calls(inner[-1][-1])
        else:
            called = calls(statement)
        if isinstance(statement, ast.Assert) and acted and called & READS and not called & WAITS:
            yield statement
        if called & WAITS:
            acted = False
        elif called & ACTS:
            acted = True


def browser_tests() -> list[Path]:
    """The modules that open a page."""
    return [path for path in sorted(TESTS.rglob("test_*.py")) if "import Browser" in path.read_text("utf-8")]


@pytest.mark.parametrize("path", browser_tests(), ids=lambda path: path.stem)
def test_no_assertion_reads_a_page_right_after_an_action(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    found = [
        f"{path.name}:{one.lineno}: {ast.unparse(one)}" for node in functions for one in hasty(node.body)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("page.click()\nassert page.inner_text() == 'a'", [2]),
        ("page.click()\nopened.wait('a')\nassert page.inner_text() == 'a'", []),
        ("with page:\n    page.fill('a')\nassert opened.value('a')", [3]),
        ("page.click()\nif a:\n    assert page.count() == 1", [3]),
        ("page.click()\nassert page.said == []", []),
    ],
)
def test_a_hasty_assertion_is_found(lines: str, expected: list[int]) -> None:
    assert [one.lineno for one in hasty(ast.parse(lines).body)] == expected
