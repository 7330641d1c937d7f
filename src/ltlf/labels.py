"""Sets of letters as short Boolean expressions, e.g. ``b & !c`` instead of 64 letters.

A cube (care, value) is the set of letters whose bits in ``care`` agree with ``value``. Letters that cannot
occur are don't-cares, which keeps labels short for propositions that exclude each other.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ltlf.automaton import Dfa, letter_codes
from ltlf.dfa import IntArray

Cube = tuple[int, int]
DecisionTree = int | tuple[int, "DecisionTree", "DecisionTree"]


def disjoint_cubes(codes: IntArray, targets: IntArray) -> Iterator[tuple[Cube, int]]:
    """Disjoint cubes that cover all letters, each with a target.

    ``targets`` (L,) belong to the letters ``codes`` (L,). The cubes are the leaves of a decision tree, so
    that a table written with them is complete and deterministic.
    """
    stack = [(0, 0, _decision_tree(codes, targets))]
    while stack:
        care, value, tree = stack.pop()
        if isinstance(tree, int):
            yield (care, value), tree
        else:
            bit, without, with_ = tree
            stack.append((care | bit, value | bit, with_))
            stack.append((care | bit, value, without))


def _decision_tree(codes: IntArray, targets: IntArray) -> DecisionTree:
    """(bit, tree for bit 0, tree for bit 1), or the target if all letters have the same."""
    if (targets == targets[0]).all():
        return int(targets[0])
    differ = int(np.bitwise_or.reduce(codes ^ codes[0]))  # the letters agree in all other bits
    bit = differ & -differ
    yes = (codes & bit) != 0
    without, with_ = _decision_tree(codes[~yes], targets[~yes]), _decision_tree(codes[yes], targets[yes])
    return without if without == with_ else (bit, without, with_)


def covering_cubes(inside: IntArray, outside: IntArray, width: int) -> list[Cube]:
    """Few short cubes that contain all codes ``inside`` and none of ``outside``, over ``width`` propositions.

    Each is a prime cube, made from a letter by dropping literals while it contains no code of ``outside``. A
    cube whose letters the others contain is removed.
    """
    cubes: list[Cube] = []
    left = inside
    while len(left):
        cube = _prime_cube(int(left[0]), outside, width)
        cubes.append(cube)
        left = left[(left & cube[0]) != cube[1]]
    for cube in cubes[:-1]:
        others = [other for other in cubes if other != cube]
        if all(any(code & care == value for care, value in others) for code in inside.tolist()):
            cubes = others
    return cubes


def _prime_cube(code: int, outside: IntArray, width: int) -> Cube:
    """A prime cube that contains ``code``; negative literals are dropped first, for readable labels."""
    care = (1 << width) - 1
    bits = [1 << i for i in reversed(range(width))]
    for bit in sorted(bits, key=lambda bit: bool(code & bit)):
        smaller = care & ~bit
        if not ((outside & smaller) == (code & smaller)).any():
            care = smaller
    return care, code & care


def cubes_text(cubes: list[Cube], names: tuple[str, ...], always: str = "true") -> str:
    """Text of a union of cubes, e.g. ``a & !b | c``; ``always`` for the cube without literals."""
    return " | ".join(" & ".join(_cube_literals(cube, names)) or always for cube in cubes)


def _cube_literals(cube: Cube, names: tuple[str, ...]) -> list[str]:
    care, value = cube
    return [name if value >> i & 1 else f"!{name}" for i, name in enumerate(names) if care >> i & 1]


def edge_labels(automaton: Dfa) -> dict[tuple[int, int], str]:
    """Label of each edge (from, to): its letters, or ``!(other letters)`` if that text is shorter."""
    codes = letter_codes(automaton.atoms, automaton.letters)
    result = {}
    for q, row in enumerate(automaton.delta):
        for target in np.unique(row).tolist():
            result[q, target] = _shorter_label(codes[row == target], codes[row != target], automaton.atoms)
    return result


def _shorter_label(inside: IntArray, outside: IntArray, names: tuple[str, ...]) -> str:
    label = cubes_text(covering_cubes(inside, outside, len(names)), names)
    if not len(outside) or "|" not in label:
        return label
    denied = f"!({cubes_text(covering_cubes(outside, inside, len(names)), names)})"
    return denied if len(denied) < len(label) else label
