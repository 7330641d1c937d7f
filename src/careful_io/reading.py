"""Reading of text and JSON with limits of size and depth; an error is one line with the place in the file.

The limits are far above the sizes of files that this program writes, and low enough for the memory of a
small machine: a list of two numbers, 4 bytes in a file, takes 80 bytes of memory.
"""

from __future__ import annotations

import csv
import json
import math
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from careful_io.errors import DataError

MAX_BYTES = 64 * 2**20  # of a text file
MAX_ELEMENTS = 8_000_000  # lists, mappings and values of a JSON file
MAX_DEPTH = 64  # levels of a JSON file
SHOWN = 60  # characters of a wrong value that a message repeats

NUMBER_TYPES = frozenset({int, float})
MISSHAPEN = (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, csv.Error)


@dataclass(frozen=True, slots=True)
class Advice:
    """The advice at the end of an error message.

    Attributes
    ----------
    missing : str
        Advice for a file that cannot be opened.
    damaged : str
        Advice for a file with the wrong content.
    """

    missing: str = "is this a results directory?"
    damaged: str = "run the plan again"


RESULTS = Advice()


@contextmanager
def shaped(path: Path, what: str) -> Iterator[None]:
    """Turn an error while the content of ``path`` is made into ``what`` into a DataError that names both."""
    try:
        yield
    except MISSHAPEN as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise DataError(f"{path}: not {what} ({reason}); run the plan again") from error


def inside(place: Path | str, name: str) -> Path:
    """The file ``name`` in ``place``, or ``place`` itself if it is a file."""
    place = Path(place)
    return place / name if place.is_dir() else place


def refuse_special(path: Path) -> None:
    """DataError if ``path`` is a pipe, a socket or a device: reading it may never end."""
    with suppress(OSError, ValueError):  # a missing file, or a NUL in the name: whoever opens it says so
        kind = path.stat().st_mode
        if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
            raise DataError(f"{path}: is a pipe, a socket or a device; copy its content into a file")


def read_bounded(path: Path, advice: Advice = RESULTS, largest: int = MAX_BYTES) -> bytes:
    """The bytes of ``path``; DataError if it cannot be read or has more than ``largest`` bytes."""
    refuse_special(path)
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)  # the size that the system states is not used: a device has none
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise DataError(f"{path}: cannot be read ({reason}); {advice.missing}") from error
    if len(data) > largest:
        raise DataError(
            f"{path}: has more than {largest / 2**20:g} MiB, which is the limit; {advice.damaged}"
        )
    return data


def read_text(path: Path, advice: Advice = RESULTS, limit: int = MAX_BYTES) -> str:
    """The text of ``path``, without its byte-order mark if it has one; DataError if it is not UTF-8."""
    return decoded_text(read_bounded(path, advice, limit), str(path), advice)


def decoded_text(data: bytes, where: str, advice: Advice = RESULTS) -> str:
    """``data`` as text; a DataError names the first byte that is not UTF-8."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise DataError(
            f"{where}: line {line}: byte 0x{data[error.start]:02x} is not UTF-8; "
            f"save the file as UTF-8, or {advice.damaged}"
        ) from error


def read_json(path: Path, advice: Advice = RESULTS) -> dict[str, Any]:
    """The JSON object in ``path``; DataError if the file does not hold one."""
    content = read_json_value(path, advice)
    if not isinstance(content, dict):
        kind = json_kind(content)
        raise DataError(f"{path}: expected a JSON object, found {kind}; {advice.damaged}")
    return content


def read_json_value(path: Path, advice: Advice = RESULTS) -> Any:
    """The JSON value in ``path``.

    DataError for numbers that are not finite, repeated names, texts that UTF-8 cannot encode, and files
    beyond the limits above.
    """
    return parse_json(read_bounded(path, advice), str(path), advice)


def parse_json(data: bytes, where: str, advice: Advice = RESULTS) -> Any:
    """Like :func:`read_json_value`, from bytes; error messages begin with ``where``."""
    text = decoded_text(data, where, advice)
    if sum(data.count(sign) for sign in (b",", b"[", b"{")) > MAX_ELEMENTS:
        raise DataError(f"{where}: has more than {MAX_ELEMENTS:,} values; {advice.damaged}")
    try:
        content = json.loads(text, object_pairs_hook=_unique_names)
    except RecursionError:
        raise DataError(f"{where}: is nested deeper than {MAX_DEPTH} levels; {advice.damaged}") from None
    except json.JSONDecodeError as error:
        raise DataError(f"{where}: not JSON ({error}); {advice.damaged}") from None
    except ValueError as error:
        raise DataError(f"{where}: {_value_error_text(error, text)}; {advice.damaged}") from None
    if flaw := _first_flaw(content):
        place, reason = flaw
        raise DataError(f"{where}: {place + ': ' if place else ''}{reason}; {advice.damaged}")
    return content


def json_kind(value: Any) -> str:
    """The JSON type of ``value`` in words: an object, an array, text, a number, true, false or null."""
    kinds = {dict: "an object", list: "an array", str: "text", int: "a number", float: "a number"}
    return kinds.get(type(value)) or json.dumps(value)


def shown_json(value: Any) -> str:
    """``value`` as JSON on one line, cut after :data:`SHOWN` characters."""
    text = json.dumps(value)
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."


class _RepeatedNameError(ValueError):
    """A JSON object has two values under one name."""


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise _RepeatedNameError(f"the name {shown_json(twice)} occurs twice in one object")
    return table


def _value_error_text(error: ValueError, text: str) -> str:
    if isinstance(error, _RepeatedNameError):
        return str(error)
    digits = re.search(r"\d{1000}", text)  # Python refuses to read whole numbers of more than 4300 digits
    line = text.count("\n", 0, digits.start()) + 1 if digits else 1
    return f"line {line}: a number has more than 1000 digits"


def _first_flaw(value: Any, depth: int = 0) -> tuple[str, str] | None:
    """Place (a JSON pointer) and description of the first flaw in ``value``; None if there is none."""
    items: Iterable[tuple[Any, Any]]
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        if _finite_numbers(value):
            return None
        items = enumerate(value)
    else:
        reason = _scalar_flaw(value)
        return ("", reason) if reason else None
    if depth == MAX_DEPTH:
        return "", f"is nested deeper than {MAX_DEPTH} levels"
    for name, item in items:
        found = _first_flaw(item, depth + 1) or _first_flaw(name, depth + 1)
        if found:
            return f"/{pointer_part(name)}{found[0]}", found[1]
    return None


def pointer_part(name: str | int) -> str:
    """One step of a JSON pointer as printable text; characters that UTF-8 cannot encode become ``?``."""
    text = str(name)[:SHOWN].encode(errors="replace").decode()
    return text if text.isprintable() else ascii(text)[1:-1]


def _finite_numbers(values: list[Any]) -> bool:
    """Whether all of ``values`` are finite numbers, tested without a Python loop."""
    try:
        return set(map(type, values)) <= NUMBER_TYPES and all(map(math.isfinite, values))
    except OverflowError:  # a whole number above 1e308
        return False


def _scalar_flaw(value: Any) -> str | None:
    if isinstance(value, str) and not value.isascii():
        try:
            value.encode()
        except UnicodeEncodeError:
            return "a text holds half of a character (a surrogate)"
    if type(value) in NUMBER_TYPES and not _finite_numbers([value]):
        found = value if isinstance(value, float) else "a whole number beyond 1e308"
        return f"expected a finite number, got {found}"
    return None
