"""JSON files with one long list, one entry on each line."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any


def listed_json(head: Mapping[str, Any], key: str, entries: Iterable[Any]) -> bytes:
    """An object of the keys of ``head``, one on each line, and of the list ``entries`` as ``key``."""
    pairs = ((json.dumps(name), json.dumps(value, allow_nan=False)) for name, value in head.items())
    told = "".join(f" {name}: {value},\n" for name, value in pairs)
    lines = ",\n".join(f"  {json.dumps(entry, allow_nan=False)}" for entry in entries)
    return f"{{\n{told} {json.dumps(key)}: [\n{lines}\n ]\n}}\n".encode()
