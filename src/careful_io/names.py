"""Names in formulas and tables: in quotes where they are not one word."""

from __future__ import annotations

import re
from collections.abc import Iterable

QUOTED = r'"[^"\\\x00-\x1f]*"'


def quoted_name(name: str) -> str:
    """``name``, in double quotes unless it is one word of letters, digits and ``_``."""
    return name if re.fullmatch(r"\w+", name) else f'"{name}"'


def joined_names(names: Iterable[str]) -> str:
    """The names in order, with spaces between them; :func:`split_names` reads them."""
    return " ".join(quoted_name(name) for name in sorted(names))


def split_names(text: str) -> frozenset[str]:
    """The names of :func:`joined_names`."""
    return frozenset(word.strip('"') for word in re.findall(rf"{QUOTED}|\S+", text))


def quoted_text(text: str) -> str:
    """``text`` in double quotes, with backslashes in front of quotes and backslashes (HOA, Graphviz)."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
