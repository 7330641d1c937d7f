"""Mutants: one place of a module's source with another operator, number, condition or statement.

A place is replaced in the text, so that all other lines stay as they are. Left out are kinds of places that
change no result, :data:`KINDS`.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import Counter
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
KINDS = {
    "annotation, docstring, imports for types": "not run, or not read by what computes",
    "decorator": "slots, frozen, the size of a cache: memory and protection, not results",
    "text of an error or of an f-string; __repr__": "wording; that an error is raised, and where, is mutated",
    "assert; strict of zip": "checks of what holds in every run, for which no test can be written",
    "call of a logger; indent": "what a developer reads, the layout of a file",
    "-1 of reshape": "any negative number means the same",
    "number of at most TINY but not 0, its factors, and + or - of them": "protects against rounding, 1 / 0",
    "< or <= beside such a number": "equality has no meaning within a tolerance",
    "statement with a number of pieces (PIECES)": "how much is worked on at once: memory and time",
    "numbers of np.empty": "memory that is filled afterwards: more of it changes nothing",
    "< or <= where both branches give the same if the sides are equal": "a limit or an extreme",
}
TINY = 1e-6
TOLERANCES = re.compile(r"\b\w*(TINY|EPS|ROUNDING|TOLERANCE)\w*\b|\b\d(\.\d+)?e-(0?[6-9]|\d\d+)\b")
PIECES = re.compile(r"\b\w*(AT_ONCE|CHUNK|BATCH|BLOCK)\w*\b")
LOGGERS = ("log", "logger", "LOG", "logging")
STRICT = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)


class Mutant(NamedTuple):
    """A replaced stretch of a module: its name, first and last line, what stands in the first, the old and
    the new text, and the new source.
    """

    module: str
    line: int
    end: int
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
        found.append(Mutant(module, node.lineno, node.end_lineno or 0, stands, old, new, changed))
    return found


def _changes(tree: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Nodes and the text that stands in their place in a mutant."""
    ties = _ties(tree)
    for node in _meant(tree):
        if node in ties:
            continue
        if isinstance(node, ast.Compare | ast.BinOp | ast.BoolOp | ast.AugAssign):
            yield from _other_operator(node)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            yield node, f"({ast.unparse(node.operand)})"
        elif isinstance(node, ast.Constant):
            if isinstance(node.value, bool):
                yield node, str(not node.value)
            elif isinstance(node.value, int):
                yield node, str(node.value + 1)
            elif isinstance(node.value, float) and (node.value == 0.0 or TINY < node.value < float("inf")):
                yield node, repr(1.5 * node.value if node.value else 1.0)
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            if name in NAMES:
                yield node.func, ast.unparse(node.func)[: -len(name)] + NAMES[name]
        elif isinstance(node, ast.If | ast.IfExp | ast.While):
            yield node.test, f"(not ({ast.unparse(node.test)}))"
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and not _is_log(node.value):
            yield node, "pass"


def _ties(tree: ast.AST) -> set[ast.AST]:
    """Comparisons for which equality changes nothing, and terms of a tolerance: kinds left out."""
    found = set[ast.AST]()
    for node in ast.walk(tree):
        if _is_of_pieces(node) or (isinstance(node, ast.BinOp) and _is_tiny(node)):
            found.update(ast.walk(node))
        elif isinstance(node, ast.BinOp) and (_is_tiny(node.left) or _is_tiny(node.right)):
            found.add(node)
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "empty":
            found.update(part for part in ast.walk(node) if isinstance(part, ast.Constant))
        elif isinstance(node, ast.Compare) and isinstance(node.ops[0], STRICT):
            if TOLERANCES.search(ast.unparse(node)):
                found.add(node)
        elif (
            isinstance(node, ast.If | ast.IfExp)
            and isinstance(node.test, ast.Compare)
            and isinstance(node.test.ops[0], STRICT)
            and _branches(node) == _sides(node.test)
        ):
            found.add(node.test)
    return found


def _is_of_pieces(node: ast.AST) -> bool:
    return isinstance(node, ast.Assign | ast.AnnAssign) and bool(PIECES.search(ast.unparse(node)))


def _is_tiny(node: ast.expr) -> bool:
    """Whether a term is a tolerance: a number or name of one, or a product with it."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        return _is_tiny(node.left) or (isinstance(node.op, ast.Mult) and _is_tiny(node.right))
    return isinstance(node, ast.Constant | ast.Name) and bool(TOLERANCES.fullmatch(ast.unparse(node)))


def _sides(test: ast.Compare) -> set[str]:
    return {ast.unparse(test.left), ast.unparse(test.comparators[0])}


def _branches(node: ast.If | ast.IfExp) -> set[str]:
    """What the two branches give; of ``if a < b: a = b``, both sides of the assignment."""
    if isinstance(node, ast.IfExp):
        return {ast.unparse(node.body), ast.unparse(node.orelse)}
    match node.body, node.orelse:
        case [ast.Assign(targets=[target], value=value)], []:
            return {ast.unparse(target), ast.unparse(value)}
    return set()


def _is_log(call: ast.Call) -> bool:
    return isinstance(call.func, ast.Attribute) and getattr(call.func.value, "id", "") in LOGGERS


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
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return
    yield node
    if isinstance(node, ast.FunctionDef) and node.name == "__repr__":
        return
    for name, content in ast.iter_fields(node):
        if name in UNMEANT or isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr):
            continue
        for one in content if isinstance(content, list) else [content]:
            if isinstance(one, ast.keyword) and one.arg in ("strict", "indent"):
                continue
            if isinstance(one, ast.Call) and isinstance(node, ast.Expr) and _is_log(one):
                continue
            if _is_unknown_length(node, one):
                yield one
            elif isinstance(one, ast.AST):
                yield from _meant(one)


def _is_unknown_length(call: ast.AST, argument: object) -> TypeGuard[ast.UnaryOp]:
    """Whether ``argument`` is the -1 of ``reshape(-1, 2)``, in whose place -2 means the same."""
    reshape = isinstance(call, ast.Call) and getattr(call.func, "attr", "") == "reshape"
    return reshape and isinstance(argument, ast.UnaryOp)


def drawn(modules: Mapping[str, Path], count: int, seed: str) -> list[Mutant]:
    """``count`` mutants of the modules, drawn with ``seed``; each place is as likely as any other.

    Where one is drawn depends on its own line alone, so that a change of the modules changes few of them.
    """
    every = [
        one
        for name, path in sorted(modules.items())
        for one in mutants(path.read_text(encoding="utf-8"), name)
    ]
    known, numbered = Counter[tuple[str, ...]](), list[tuple[bytes, Mutant]]()
    for one in every:
        known[one.key] += 1  # the same text may stand in a line twice
        words = (seed, *one.key, str(known[one.key]))
        numbered.append((hashlib.sha256("\n".join(words).encode()).digest(), one))
    return [one for _, one in sorted(numbered)[:count]]
