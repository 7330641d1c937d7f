"""Mutations of files: bytes flipped, moved, repeated or cut, and trees with values of the wrong kind.

A mutation is a few small integers, so that Hypothesis can make a failing case smaller. ``spoil_bytes`` and
``spoil_tree`` are pure: the same numbers make the same file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import yaml
from hypothesis import strategies as st

Step = tuple[int, int, int]  # what to do, where, with what

RAW = "@raw "  # a text in a tree that stands for what follows it, without quotes
TOKENS = (
    *(b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\xed\xa0\x80", b"\n", b"\r", b'"', b"'", b",", b":", b"-", b"#"),
    *(b"{", b"}", b"[", b"]", b"(", b")", b"&a ", b"*a", b"<<: ", b"!!python/object:os.system ", b"!", b"|"),
    *(b"NaN", b"-Infinity", b"1e999", b"-0", b"1e308", b"null", b"true", b"0x", b"1_0", b"9" * 20, b"/*"),
    *(b"9" * 5000, b"[" * 5000, b"(" * 5000, b"a" * 200_000, "é漢😀\u202e".encode(), b"@0 ", b"\\ud800"),
)
SIZES = (0, 1, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2**31, 2**63, -(2**63) - 1, 10**30, -0.0, 0.5, 1e-320, 1e308, -1e308),
    *("", "a", "1", "true", "nan", "é漢😀", "\0", "\n", "a\nb", "../x", "/etc/passwd", "\ud800", "${seed}"),
    *([], {}, [[]], [None], [1, [2]], ["a"], {"a": 1}, {"": None}, [[1, 2], [3]], [1e308, 1e308], 2000 * [0]),
    *("a" * 100_000, f"{RAW}NaN", f"{RAW}-Infinity", f"{RAW}1e999", f"{RAW}{10**400}", f"{RAW}{'9' * 5000}"),
    *(f"{RAW}-0", f"{RAW}{'[' * 100 + ']' * 100}", f"{RAW}{'[' * 100_000 + ']' * 100_000}"),
    *(f'{RAW}{{"a": 1, "a": 2}}', RAW),
)


def steps(most: int = 4) -> st.SearchStrategy[list[Step]]:
    """A few steps of a mutation."""
    number = st.integers(0, 2**16 - 1)
    return st.lists(st.tuples(st.integers(0, 255), number, number), min_size=1, max_size=most)


# --- bytes -----------------------------------------------------------------------------------


def spoil_bytes(data: bytes, mutation: Sequence[Step]) -> bytes:
    """``data`` after each step of ``mutation``."""
    for kind, where, what in mutation:
        at = where * (len(data) + 1) // 2**16
        data = BYTE_STEPS[kind % len(BYTE_STEPS)](data, at, what)
    return data


def _flip(data: bytes, at: int, what: int) -> bytes:
    return data[:at] + bytes([data[at] ^ (1 << what % 8)]) + data[at + 1 :] if at < len(data) else data


def _set(data: bytes, at: int, what: int) -> bytes:
    return data[:at] + bytes([what % 256]) + data[at + 1 :]


def _insert(data: bytes, at: int, what: int) -> bytes:
    return data[:at] + TOKENS[what % len(TOKENS)] + data[at:]


def _overwrite(data: bytes, at: int, what: int) -> bytes:
    token = TOKENS[what % len(TOKENS)]
    return data[:at] + token + data[at + len(token) :]


def _size(data: bytes, at: int, what: int) -> bytes:
    """A number of 2, 4 or 8 bytes, in the form of sizes in headers."""
    width, order = (2, 4, 8)[what % 3], ("big", "little")[what // 3 % 2]
    number = SIZES[what // 6 % len(SIZES)] % 256**width
    return data[:at] + number.to_bytes(width, order) + data[at + width :]  # type: ignore[arg-type]


def _cut(data: bytes, at: int, what: int) -> bytes:
    return data[:at]


def _delete(data: bytes, at: int, what: int) -> bytes:
    return data[:at] + data[at + 1 + what % 64 :]


def _repeat(data: bytes, at: int, what: int) -> bytes:
    length, times = 1 + what % 64, (2, 3, 1000)[what // 64 % 3]
    return data[:at] + times * data[at : at + length] + data[at + length :]


def _move(data: bytes, at: int, what: int) -> bytes:
    length, to = 1 + what % 64, what * len(data) // 2**16
    piece, rest = data[at : at + length], data[:at] + data[at + length :]
    return rest[:to] + piece + rest[to:]


def _recode(data: bytes, at: int, what: int) -> bytes:
    text = data.decode("utf-8", errors="replace")
    return text.encode(("utf-16", "utf-8-sig", "latin1", "utf-32")[what % 4], errors="replace")


BYTE_STEPS: tuple[Callable[[bytes, int, int], bytes], ...] = (
    *(_flip, _set, _insert, _overwrite, _size, _cut, _delete, _repeat, _move),
    *(_flip, _set, _insert, _delete, _recode),
)


# --- trees -----------------------------------------------------------------------------------


def spoil_tree(tree: Any, mutation: Sequence[Step]) -> Any:
    """A copy of ``tree`` (dicts, lists and scalars) after each step of ``mutation``."""
    tree = deepcopy(tree)
    for kind, where, what in mutation:
        places = list(_places(tree))
        if not places:
            return VALUES[what % len(VALUES)]
        holder, key = places[where % len(places)]
        TREE_STEPS[kind % len(TREE_STEPS)](holder, key, what, places)
    return tree


def _places(tree: Any) -> Any:
    """Every (list or dict, key) below ``tree``; of long lists of scalars, only the first three."""
    stack = [tree]
    while stack:
        holder = stack.pop()
        keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        for number, key in enumerate(keys):
            if isinstance(holder[key], dict | list):
                stack.append(holder[key])
            elif number > 3 and isinstance(holder, list):
                continue
            yield holder, key


def _replace(holder: Any, key: Any, what: int, places: Any) -> None:
    holder[key] = deepcopy(VALUES[what % len(VALUES)])


def _remove(holder: Any, key: Any, what: int, places: Any) -> None:
    del holder[key]


def _swap(holder: Any, key: Any, what: int, places: Any) -> None:
    other, its_key = places[what % len(places)]
    holder[key], other[its_key] = deepcopy(other[its_key]), deepcopy(holder[key])


def _double(holder: Any, key: Any, what: int, places: Any) -> None:
    if isinstance(holder, list):
        holder.insert(key, deepcopy(holder[key]))
    else:
        holder[f"{key}_{what % 10}"] = deepcopy(holder[key])


def _rename(holder: Any, key: Any, what: int, places: Any) -> None:
    if isinstance(holder, dict):
        value = VALUES[what % len(VALUES)]
        holder[value if isinstance(value, str) else str(value)] = holder.pop(key)
    else:
        holder[key] = {"x": holder[key]}


def _wrap(holder: Any, key: Any, what: int, places: Any) -> None:
    holder[key] = [holder[key]]


def _scale(holder: Any, key: Any, what: int, places: Any) -> None:
    if isinstance(holder[key], int | float):
        holder[key] = holder[key] * (-1, 1e-300, 1e9, 1e150, 1e-9)[what % 5]


TREE_STEPS: tuple[Callable[[Any, Any, int, Any], None], ...] = (
    *(_replace, _replace, _replace, _remove, _swap, _double, _rename, _wrap, _scale),
)


def json_bytes(tree: Any) -> bytes:
    """``tree`` as JSON; texts that begin with :data:`RAW` are put in as they are."""
    return _unquoted(json.dumps(tree))


def yaml_bytes(tree: Any) -> bytes:
    """The same as YAML; surrogates, which YAML cannot write, as question marks."""
    text = json.dumps(tree, ensure_ascii=False).encode(errors="replace").decode()
    if '"' + RAW in text:
        return _unquoted(text)
    return yaml.dump(json.loads(text), Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True).encode()


def _unquoted(text: str) -> bytes:
    first, *others = text.split(f'"{RAW}')
    for part in others:
        value, _, rest = part.partition('"') if not part.startswith("{") else part.partition('}"')
        closing = "}" if part.startswith("{") else ""
        first += value.replace("\\", "") + closing + rest
    return first.encode()


# --- cases -----------------------------------------------------------------------------------


def mutants(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Each of ``seeds`` with bytes changed."""
    return st.builds(spoil_bytes, st.sampled_from(list(seeds)), steps()).map(bytes)


def tree_mutants(trees: Sequence[Any], write: Callable[[Any], bytes]) -> st.SearchStrategy[bytes]:
    """Each of ``trees`` with values changed, written by ``write``; one in four with bytes changed, too."""
    spoilt = st.builds(spoil_tree, st.sampled_from(list(trees)), steps()).map(write)
    also_bytes = st.builds(spoil_bytes, spoilt, steps(2))
    only_bytes = mutants([write(tree) for tree in trees])
    return st.one_of(spoilt, spoilt, also_bytes, only_bytes).map(bytes)
