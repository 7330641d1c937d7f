"""Mutants: one place of a module's source with another operator, number, condition or statement.

A place is replaced in the text, so that all other lines stay as they are. Left out are annotations,
docstrings, decorators and messages of errors, which change no result.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, TypeGuard

SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Div, ast.Mod: ast.Mult, ast.MatMult: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
NAMES = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any",
    "argmin": "argmax", "argmax": "argmin", "floor": "ceil", "ceil": "floor", "sin": "cos", "cos": "sin",
    "first": "last", "last": "first", "cumsum": "cumprod", "sorted": "list",
}  # fmt: skip
UNMEANT = ("decorator_list", "annotation", "returns", "type_params")  # fields that no result depends on


class Mutant(NamedTuple):
    """A replaced stretch of a module: its file, its line and what stands there, the old and the new text, and
    the new source.
    """

    module: str
    line: int
    stands: str
    old: str
    new: str
    source: str

    def text(self) -> str:
        """One line for the report."""
        return f"{self.module}:{self.line}: {_short(self.old)} -> {_short(self.new)}"

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What names a mutant although lines move."""
        return self.module, self.stands, _short(self.old), _short(self.new)


def _short(text: str) -> str:
    return " ".join(text.split())[:120]


def mutants(source: str, module: str = "") -> list[Mutant]:
    """All mutants of a source, in the order of its places."""
    lines = source.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line.encode()))
    data, found = source.encode(), []
    for node, new in _changes(ast.parse(source)):
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        changed = (data[:begin] + new.encode() + data[end:]).decode()
        stands, old = lines[node.lineno - 1].strip(), data[begin:end].decode()
        found.append(Mutant(module, node.lineno, stands, old, new, changed))
    return found


def _changes(tree: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Nodes and the text that stands in their place in a mutant."""
    for node in _meant(tree):
        if isinstance(node, ast.Compare | ast.BinOp | ast.BoolOp | ast.AugAssign):
            yield from _other_operator(node)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            yield node, f"({ast.unparse(node.operand)})"
        elif isinstance(node, ast.Constant):
            if isinstance(node.value, bool):
                yield node, str(not node.value)
            elif isinstance(node.value, int):
                yield node, str(node.value + 1)
            elif isinstance(node.value, float) and node.value not in (float("inf"),):
                yield node, repr(1.5 * node.value if node.value else 1.0)
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in NAMES:
                yield node.func, ast.unparse(node.func)[: -len(name)] + NAMES[name]
        elif isinstance(node, ast.If | ast.IfExp | ast.While):
            yield node.test, f"(not ({ast.unparse(node.test)}))"
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            yield node, "pass"


def _other_operator(
    node: ast.Compare | ast.BinOp | ast.BoolOp | ast.AugAssign,
) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    held = node.ops[0] if isinstance(node, ast.Compare) else node.op
    swap = SWAPS.get(type(held))
    text = isinstance(node, ast.BinOp) and any(
        isinstance(side, ast.JoinedStr) or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in (node.left, node.right)
    )
    if swap is None or text:
        return
    if isinstance(node, ast.Compare):
        node.ops[0] = swap()  # type: ignore[call-overload]
    else:
        node.op = swap()  # type: ignore[assignment]
    new = ast.unparse(node)
    if isinstance(node, ast.Compare):
        node.ops[0] = held  # type: ignore[call-overload]
    else:
        node.op = held  # type: ignore[assignment]
    yield node, new if isinstance(node, ast.AugAssign) else f"({new})"


def _meant(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes, outermost first, without what no result depends on."""
    yield node
    for name, content in ast.iter_fields(node):
        if name in UNMEANT or isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        for one in content if isinstance(content, list) else [content]:
            if _is_unknown_length(node, one):
                yield one
            elif isinstance(one, ast.AST):
                yield from _meant(one)


def _is_unknown_length(call: ast.AST, argument: object) -> TypeGuard[ast.UnaryOp]:
    """Whether ``argument`` is the -1 of ``reshape(-1, 2)``, in whose place -2 means the same."""
    reshape = isinstance(call, ast.Call) and getattr(call.func, "attr", "") == "reshape"
    return reshape and isinstance(argument, ast.UnaryOp)


def drawn(modules: Mapping[str, Path], count: int, seed: str) -> list[Mutant]:
    """``count`` mutants of the modules, drawn with ``seed``; each place is as likely as any other."""
    every = [
        one
        for name, path in sorted(modules.items())
        for one in mutants(path.read_text(encoding="utf-8"), name)
    ]
    return random.Random(seed).sample(every, min(count, len(every)))
