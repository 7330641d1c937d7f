"""JSON Schemas (draft 2020-12) of the JSON files of a run, and the check of a file against its schema.

All files of a results directory or of a sweep are read by :func:`read_document`. fastjsonschema makes a
function of each schema: 0.04 s for its import and for a large schema, and 0.3 million numbers a second.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.reading import RESULTS, Advice, pointer_part, read_json, shown_json
from pareto_ltl.support.resources import PACKAGE

if TYPE_CHECKING:
    from fastjsonschema import JsonSchemaValueException

FOLDER = PACKAGE / "support" / "data" / "schemas"
SCHEMA_NAMES = tuple(sorted(path.name.partition(".")[0] for path in FOLDER.glob("*.schema.json")))
TYPE_WORDS = {
    "object": "an object",
    "array": "an array",
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}


def schema_text(name: str) -> str:
    """The text of the schema of ``name``, one of :data:`SCHEMA_NAMES`."""
    return (FOLDER / f"{name}.schema.json").read_text(encoding="utf-8")


def read_document(path: Path, name: str | Mapping[str, str], advice: Advice = RESULTS) -> dict[str, Any]:
    """Read the JSON file ``path`` and check it against a schema.

    Parameters
    ----------
    name : str or mapping of str to str
        The name of the schema; or, for each allowed value of the file's key ``schema``, that name. A file of
        another version is refused.

    Raises
    ------
    DataError
        If the file does not fit; the message has the place (a JSON pointer), what was expected and the value.
    """
    content = read_json(path, advice)
    if isinstance(name, Mapping):
        stated = content.get("schema")
        if not isinstance(stated, str) or stated not in name:
            raise DataError(
                f"{path}: expected schema {' or '.join(map(repr, name))}, found {shown_json(stated)}; "
                "read it with the version of pareto-ltl that wrote it"
            )
        name = name[stated]
    check_document(content, name, str(path), advice)
    return content


def check_document(content: Any, name: str, where: str, advice: Advice = RESULTS) -> None:
    """Raise a DataError that begins with ``where`` if ``content`` does not fit the schema of ``name``."""
    from fastjsonschema import JsonSchemaValueException

    try:
        schema_check(name)(content)
    except JsonSchemaValueException as error:
        place = "".join(f"/{pointer_part(part)}" for part in error.path[1:])
        raise DataError(
            f"{where}: {place + ': ' if place else ''}{_misfit(error)}; {advice.damaged}"
        ) from None


def _misfit(error: JsonSchemaValueException) -> str:
    """The end of an error message: what was expected, and the value in the file."""
    schema: Mapping[str, Any] = error.definition
    found = error.value
    if error.rule == "required":
        missing = [key for key in schema["required"] if key not in found]
        return f"lacks {', '.join(map(repr, missing))}"
    if error.rule == "additionalProperties":
        unknown = next(key for key in found if key not in schema["properties"])
        return f"unknown key {shown_json(unknown)}; there are {', '.join(schema['properties'])}"
    return f"expected {schema.get('title') or _described(schema)}, got {shown_json(found)}"


def _described(schema: Mapping[str, Any]) -> str:
    """The keywords of ``schema`` in words."""
    if "const" in schema:
        return shown_json(schema["const"])
    if "enum" in schema:
        return f"one of {', '.join(map(json.dumps, schema['enum']))}"
    kinds = schema.get("type", "text")
    words = " or ".join(TYPE_WORDS[kind] for kind in ([kinds] if isinstance(kinds, str) else kinds))
    limits = {
        "minimum": "at least",
        "exclusiveMinimum": "above",
        "maximum": "at most",
        "minItems": "at least",
    }
    reported = [f"{text} {schema[key]:g}" for key, text in limits.items() if key in schema]
    return ", ".join([words, *reported])


@lru_cache
def schema_check(name: str) -> Callable[[Any], Any]:
    """The function that fastjsonschema makes of the schema of ``name``; it raises an error for a misfit."""
    from fastjsonschema import compile as compiled

    check: Callable[[Any], Any] = compiled(json.loads(schema_text(name)), use_default=False)
    return check
