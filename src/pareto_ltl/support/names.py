"""Names of regions in formulas and tables: in quotes where they are not one word."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable

LONGEST = 80  # characters of a name
QUOTED = r'"[^"\\\x00-\x1f]*"'


def quoted_name(name: str, reserved: Container[str] = ()) -> str:
    """``name``, in double quotes unless it is one word of letters, digits and ``_``, and not ``reserved``."""
    return name if re.fullmatch(r"\w+", name) and name not in reserved else f'"{name}"'


def joined_names(names: Iterable[str]) -> str:
    """The names in order, with spaces between them; :func:`split_names` reads them."""
    return " ".join(quoted_name(name) for name in sorted(names))


def split_names(text: str) -> frozenset[str]:
    """The names of :func:`joined_names`."""
    return frozenset(word.strip('"') for word in re.findall(rf"{QUOTED}|\S+", text))


def name_fault(name: str) -> str:
    """Why ``name`` cannot be used in a formula, not even in quotes; empty if it can."""
    if not name.strip() or name != name.strip():
        return "it is empty, or begins or ends with a space"
    if len(name) > LONGEST:
        return f"it has {len(name)} characters, {LONGEST} are the limit"
    if '"' in name or "\\" in name or not name.isprintable():
        return "it holds a quotation mark, a backslash or a character that cannot be printed"
    return ""


def quoted_text(text: str) -> str:
    """``text`` in double quotes, with backslashes in front of quotes and backslashes (HOA, Graphviz)."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
