"""The page of JSON Schemas: ``<!-- schemas -->`` stands for a table for each schema of the package."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from careful_io.schemas import TYPE_WORDS
from pareto_ltl.support.resources import PACKAGE
from pareto_ltl.support.schemas import FOLDER, SCHEMA_NAMES, schema_text

MARK = "<!-- schemas -->"
HEAD = "| key | value | meaning |\n|---|---|---|"
DOWNLOADS = "/".join(("src", PACKAGE.name, *FOLDER.relative_to(PACKAGE).parts))

Node = Mapping[str, Any]


def with_schemas(markdown: str) -> str:
    """Put in the tables."""
    return markdown.replace(MARK, "\n\n".join(map(_schema_section, SCHEMA_NAMES)))


def _schema_section(name: str) -> str:
    schema = json.loads(schema_text(name))
    download = f"[`{name}.schema.json`]({DOWNLOADS}/{name}.schema.json)"
    rows = [
        f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
        for row in _rows(schema, schema, "")
    ]
    return "\n".join([f"## {name}", "", f"{schema['title']}. {download}", "", HEAD, *rows])


def _rows(
    node: Node, schema: Node, prefix: str, passed: tuple[str, ...] = ()
) -> Iterator[tuple[str, str, str]]:
    """A row for each key of an object, then for objects inside it; keys that may be missing are marked.

    ``passed`` are the definitions that the object is part of: one that contains itself is shown once.
    """
    required = node.get("required", ())
    for name, found in node.get("properties", {}).items():
        below = _resolved(found, schema)
        key = f"{prefix}{name}"
        optional = "" if name in required else "optional; "
        yield f"`{key}`", f"{optional}{_value_text(below)}", _meaning(found, below)
        ref = found.get("$ref", "")
        if ref not in passed:
            yield from _rows_below(below, schema, key, (*passed, *([ref] if ref else [])))
    for pattern, found in node.get("patternProperties", {}).items():
        below = _resolved(found, schema)
        yield f"{prefix}NAME, with NAME like `{pattern}`", _value_text(below), _meaning(found, below)
    if isinstance(others := node.get("additionalProperties"), dict):
        below = _resolved(others, schema)
        yield f"`{prefix}NAME`", _value_text(below), _meaning(others, below)
        yield from _rows_below(below, schema, f"{prefix}NAME", passed)


def _rows_below(
    node: Node, schema: Node, key: str, passed: tuple[str, ...]
) -> Iterator[tuple[str, str, str]]:
    """The rows of an object, or of each item of an array."""
    if isinstance(items := node.get("items"), dict):
        yield from _rows_below(_resolved(items, schema), schema, f"{key}[]", passed)
    yield from _rows(node, schema, f"{key}.", passed)


def _resolved(node: Node, schema: Node) -> Node:
    """A node with the definition that it refers to."""
    if "$ref" not in node:
        return node
    return {
        **schema["$defs"][node["$ref"].removeprefix("#/$defs/")],
        **{k: v for k, v in node.items() if k != "$ref"},
    }


def _meaning(found: Node, below: Node) -> str:
    return str(found.get("description", below.get("description", ""))).replace("[", "&#91;")


def _value_text(node: Node) -> str:
    """What a value is: the title of its definition, else its type in words."""
    if "title" in node:
        return str(node["title"])
    if "const" in node:
        return f"`{json.dumps(node['const'])}`"
    if "enum" in node:
        return "one of " + ", ".join(f"`{json.dumps(value)}`" for value in node["enum"])
    types = node.get("type", "object")
    return " or ".join(TYPE_WORDS[name] for name in ([types] if isinstance(types, str) else types))
