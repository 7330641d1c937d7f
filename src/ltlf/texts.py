"""Texts of users in messages, and names of propositions: in quotes where they are not one word."""

from __future__ import annotations

import re
from collections.abc import Container

SHOWN_WIDTH = 80  # characters of a user's text that a message repeats
LONGEST = 80  # characters of a name
QUOTED = r'"[^"\\\x00-\x1f]*"'


def shown_text(text: str) -> str:
    """``text`` in at most ``SHOWN_WIDTH`` printable characters; "..." replaces the middle of a longer one."""
    if len(text) > SHOWN_WIDTH:
        tail = (SHOWN_WIDTH - 3) // 2
        head = _printable(text[:SHOWN_WIDTH])[: SHOWN_WIDTH - 3 - tail]
        return f"{head}...{_printable(text[-tail:])[-tail:]}"
    line = _printable(text)
    return line if len(line) <= SHOWN_WIDTH else f"{line[: SHOWN_WIDTH - 3]}..."


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def caret_lines(text: str, column: int) -> str:
    """Two lines: the formula near the zero-based ``column``, and a caret under it."""
    line = "".join(character if character.isprintable() else " " for character in text)
    first, beyond = max(0, column - SHOWN_WIDTH // 2), column + SHOWN_WIDTH // 2
    before, after = "..." if first else "", "..." if len(line) > beyond else ""
    return f"{before}{line[first:beyond]}{after}\n{' ' * (len(before) + column - first)}^"


def quoted_name(name: str, reserved: Container[str]) -> str:
    """``name``, in double quotes unless it is one word of letters, digits and ``_``, and not ``reserved``."""
    return name if re.fullmatch(r"\w+", name) and name not in reserved else f'"{name}"'


def name_fault(name: str) -> str:
    """Why ``name`` cannot be used in a formula, not even in quotes; empty if it can."""
    if not name.strip() or name != name.strip():
        return "it is empty, or begins or ends with a space"
    if len(name) > LONGEST:
        return f"it has {len(name)} characters, {LONGEST} are the limit"
    if '"' in name or "\\" in name or not name.isprintable():
        return "it holds a quotation mark, a backslash or a character that cannot be printed"
    return ""
