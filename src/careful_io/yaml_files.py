"""Reading of YAML with limits of size, of depth and of the values that its aliases expand to.

An alias (``*name``) repeats the value of an anchor (``&name``), so that 30 lines can expand to 2^30 values.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from careful_io.errors import DataError
from careful_io.reading import RESULTS, Advice, read_text

MAX_YAML_BYTES = 4 * 2**20
MAX_VALUES = 1_000_000  # after the expansion of aliases
MAX_YAML_DEPTH = 64


class _UnboundedError(ValueError):
    """A document that is too large, too deep, or ambiguous; the text names the place."""


def read_yaml(path: Path, advice: Advice = RESULTS) -> Any:
    """The content of the YAML file ``path``; None if the file is empty.

    Raises
    ------
    DataError
        If the file cannot be read, is not one YAML document, repeats a key, or is beyond the limits above.
    """
    import yaml

    text = read_text(path, advice, MAX_YAML_BYTES)
    with _described_flaws(path, advice):
        kind: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        _check_nesting(yaml.parse(text, Loader=kind))
        loader = kind(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _check_node(node, {})
            return loader.construct_document(node)
        finally:
            loader.dispose()


@contextmanager
def _described_flaws(path: Path, advice: Advice) -> Iterator[None]:
    import yaml

    try:
        yield
    except _UnboundedError as error:
        raise DataError(f"{path}: {error}; {advice.damaged}") from None
    except RecursionError:
        raise DataError(f"{path}: is nested deeper than {MAX_YAML_DEPTH} levels; {advice.damaged}") from None
    except yaml.YAMLError as error:
        raise DataError(f"{path}: not YAML ({' '.join(str(error).split())}); {advice.damaged}") from error
    except (ValueError, TypeError, OverflowError) as error:  # an impossible date or number
        raise DataError(f"{path}: a value cannot be read ({error}); {advice.damaged}") from error


def _check_nesting(events: Iterable[Any]) -> None:
    """Raise if lists and mappings are nested too deeply, which would overflow the stack of libyaml."""
    import yaml

    depth = 0
    for event in events:
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_YAML_DEPTH:
            line = event.start_mark.line + 1
            raise _UnboundedError(f"line {line}: nested deeper than {MAX_YAML_DEPTH} levels")


def _check_node(node: Any, known: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Number of values and of levels of ``node`` with aliases expanded; raise if they are too many."""
    place = f"line {node.start_mark.line + 1}"
    if id(node) in known:
        size, levels = known[id(node)]
        if levels == 0:
            raise _UnboundedError(f"{place}: an anchor contains its alias")
        return size, levels
    known[id(node)] = 0, 0  # 0 levels: its children are not counted yet
    parts = [_check_node(child, known) for child in _children(node, place)]
    size, levels = 1 + sum(size for size, _ in parts), 1 + max((levels for _, levels in parts), default=0)
    if size > MAX_VALUES:
        raise _UnboundedError(f"{place}: its aliases expand to more than {MAX_VALUES:,} values")
    if levels > MAX_YAML_DEPTH:
        raise _UnboundedError(f"{place}: its aliases are nested deeper than {MAX_YAML_DEPTH} levels")
    known[id(node)] = size, levels
    return size, levels


def _children(node: Any, place: str) -> list[Any]:
    if isinstance(node.value, str):
        return []
    if node.id == "sequence":
        return list(node.value)
    names = [key.value for key, _ in node.value if isinstance(key.value, str)]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise _UnboundedError(f"{place}: the key {twice[:60]!r} occurs twice")
    return [part for pair in node.value for part in pair]
