"""JSON Schemas (draft 2020-12) of the JSON files of a run, and the check of a file against its schema.

All files of a results directory or of a sweep are read by :func:`read_document`. jsonschema does the check;
long arrays of numbers are tested first by :func:`surely_fit`, which checks 20 million numbers a second.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.reading import RESULTS, Advice, pointer_part, read_json, shown_json
from pareto_ltl.support.resources import PACKAGE

if TYPE_CHECKING:
    from jsonschema.exceptions import ValidationError
    from jsonschema.protocols import Validator

FOLDER = PACKAGE / "support" / "data" / "schemas"
SCHEMA_NAMES = (
    "automaton",
    "cells",
    "departures",
    "forecast_error",
    "mavlink_script",
    "metrics",
    "plan",
    "plan_1",
    "run",
    "scene",
    "sweep",
)
PYTHON_TYPES: Mapping[str, frozenset[type]] = {
    "number": frozenset({int, float}),
    "integer": frozenset({int}),
    "string": frozenset({str}),
    "null": frozenset({type(None)}),
}
QUICK_KEYWORDS = {"type", "items", "minItems", "maxItems", "minimum", "maximum", "title", "description"}
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


def read_document(
    path: Path, name: str | Mapping[str, str], advice: Advice = RESULTS, version: str | None = None
) -> dict[str, Any]:
    """Read the JSON file ``path`` and check it against a schema.

    Parameters
    ----------
    name : str or mapping of str to str
        The name of the schema; or, for each allowed value of the file's key ``schema``, that name.
    version : str, optional
        The required value of the file's key ``schema``; a file of another version is refused.

    Raises
    ------
    DataError
        If the file does not fit; the message has the place (a JSON pointer), what was expected and found.
    """
    content = read_json(path, advice)
    if version is not None or isinstance(name, Mapping):
        known = name if isinstance(name, Mapping) else {str(version): name}
        said = content.get("schema")
        if not isinstance(said, str) or said not in known:
            raise DataError(
                f"{path}: expected schema {' or '.join(map(repr, known))}, found {shown_json(said)}; "
                "read it with the version of pareto-ltl that wrote it"
            )
        name = known[said]
    check_document(content, name, str(path), advice)
    return content


def check_document(content: Any, name: str, where: str, advice: Advice = RESULTS) -> None:
    """Raise a DataError that begins with ``where`` if ``content`` does not fit the schema of ``name``."""
    if error := next(iter(schema_validator(name).iter_errors(content)), None):
        place = "".join(f"/{pointer_part(part)}" for part in error.absolute_path)
        raise DataError(f"{where}: {place + ': ' if place else ''}{_misfit(error)}; {advice.damaged}")


def _misfit(error: ValidationError) -> str:
    """The end of an error message: what was expected and what was found."""
    schema: Mapping[str, Any] = error.schema  # type: ignore[assignment]  # an object in all our files
    found: Any = error.instance
    if error.validator == "required":
        missing = [key for key in schema["required"] if key not in found]
        return f"lacks {', '.join(map(repr, missing))}"
    if error.validator == "additionalProperties":
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
    told = [f"{text} {schema[key]:g}" for key, text in limits.items() if key in schema]
    return ", ".join([words, *told])


# --- the validator ---------------------------------------------------------------------------


@lru_cache
def schema_validator(name: str) -> Validator:
    """The validator of ``name``; jsonschema is imported at the first use, which takes 0.2 s."""
    from jsonschema import Draft202012Validator, validators

    schema = json.loads(schema_text(name))
    definitions = schema.get("$defs", {})

    def quick(keyword: str, values: Any) -> Any:
        slow = Draft202012Validator.VALIDATORS[keyword]

        def check(validator: Any, rule: Any, instance: Any, parent: Any) -> Iterator[ValidationError]:
            if not surely_fit(values(instance, parent), rule, definitions):
                yield from slow(validator, rule, instance, parent)

        return check

    kind = validators.extend(  # type: ignore[no-untyped-call]
        Draft202012Validator,
        {
            "items": quick("items", _list_items),
            "additionalProperties": quick("additionalProperties", _free_values),
        },
    )
    checked: Validator = kind(schema)
    return checked


def _list_items(instance: Any, parent: Mapping[str, Any]) -> list[Any] | None:
    return instance if isinstance(instance, list) and "prefixItems" not in parent else None


def _free_values(instance: Any, parent: Mapping[str, Any]) -> list[Any] | None:
    if not isinstance(instance, dict) or "patternProperties" in parent:
        return None
    named = parent.get("properties", {})
    return [value for key, value in instance.items() if key not in named]


def surely_fit(values: list[Any] | None, rule: Any, definitions: Mapping[str, Any]) -> bool:
    """Quick test whether all ``values`` fit ``rule``; False also if only jsonschema can decide it."""
    if values is None or not isinstance(rule, dict):
        return False
    rule = definitions.get(str(rule.get("$ref", "")).removeprefix("#/$defs/"), rule)
    if not rule.keys() <= QUICK_KEYWORDS:
        return False
    if rule["type"] == "array" and "items" in rule:
        if not all(type(value) is list for value in values):
            return False
        sizes = set(map(len, values)) or {rule.get("minItems", 0)}
        fits = rule.get("minItems", 0) <= min(sizes) and max(sizes) <= rule.get("maxItems", max(sizes))
        return fits and surely_fit(list(chain.from_iterable(values)), rule["items"], definitions)
    return _scalars_fit(values, rule)


def _scalars_fit(values: list[Any], rule: Mapping[str, Any]) -> bool:
    kinds = [rule["type"]] if isinstance(rule["type"], str) else rule["type"]
    if not all(kind in PYTHON_TYPES for kind in kinds):
        return False
    if not set(map(type, values)) <= frozenset().union(*(PYTHON_TYPES[kind] for kind in kinds)):
        return False
    limited = "minimum" in rule or "maximum" in rule
    if not limited or not values:
        return True
    return kinds in (["number"], ["integer"]) and bool(
        rule.get("minimum", min(values)) <= min(values) and max(values) <= rule.get("maximum", max(values))
    )
