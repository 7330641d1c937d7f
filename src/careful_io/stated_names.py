"""Names that a package gives to its users, written once: in the stub beside it, which type checkers read."""

from __future__ import annotations

import ast
from functools import lru_cache
from pathlib import Path


@lru_cache
def stated_names(module: str) -> dict[str, str]:
    """The module of each name that the stub of the file ``module`` imports, in its order."""
    tree = ast.parse(Path(module).with_suffix(".pyi").read_text(encoding="utf-8"))
    return {
        alias.name: str(node.module)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
