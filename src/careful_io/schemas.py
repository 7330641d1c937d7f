"""The check of the content of a JSON file against its JSON Schema (draft 2020-12).

fastjsonschema makes a function of each schema: 0.04 s for its import and for a large schema, and 0.3 million
numbers a second.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from careful_io.errors import DataError
from careful_io.reading import RESULTS, Advice, pointer_part, shown_json

if TYPE_CHECKING:
    from fastjsonschema import JsonSchemaValueException

TYPE_WORDS = {
    "object": "an object",
    "array": "an array",
    "string": "text",
    "number": "a number",
    "integer": "a whole number",
    "boolean": "true or false",
    "null": "null",
}


def check_content(content: Any, schema: Path, where: str, advice: Advice = RESULTS) -> None:
    """Raise a DataError that begins with ``where`` if ``content`` does not fit ``schema``, a file."""
    from fastjsonschema import JsonSchemaValueException

    try:
        schema_check(schema)(content)
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
def schema_check(schema: Path) -> Callable[[Any], Any]:
    """The function that fastjsonschema makes of the file ``schema``; it raises an error for a misfit."""
    from fastjsonschema import compile as compiled

    check: Callable[[Any], Any] = compiled(json.loads(schema.read_text(encoding="utf-8")), use_default=False)
    return check
