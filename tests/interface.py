"""The stable interface, kept in ``interface.json`` and checked by ``test_interface_kept.py``.

Names and parameters of ``pareto_ltl``, commands, settings with their types, the keys of the JSON files, the
columns of the tables.
After an addition, write the file again; for another change, follow "Deprecation" in RELEASING.md first:

    python tests/interface.py
"""

from __future__ import annotations

import inspect
import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pareto_ltl
from declared_settings import field_kinds
from pareto_ltl.planning.costs import COSTS, cost_named
from pareto_ltl.planning.plan_files import FRONT_HEADER, TABLE_HEADER
from pareto_ltl.settings import Settings
from pareto_ltl.support.schemas import SCHEMA_NAMES, schema_text
from pareto_ltl_apps.cli.command_table import COMMANDS
from pareto_ltl_apps.exports.kinds import FORMATS
from pareto_ltl_apps.exports.tables import CARD_COLUMNS, TABLE_COLUMNS

KEPT = Path(__file__).with_name("interface.json")


def python_names() -> dict[str, list[str]]:
    """The parameters of each public function and class, by its name."""
    return {name: _parameters(getattr(pareto_ltl, name)) for name in pareto_ltl.__all__}


def _parameters(item: Any) -> list[str]:
    """The parameters; ``?`` marks those with a default, ``*`` those that must be named."""
    if not callable(item) or (isinstance(item, type) and issubclass(item, Exception)):
        return []
    return [
        f"{'*' * (p.kind == p.KEYWORD_ONLY)}{name}{'?' * (p.default is not p.empty)}"
        for name, p in inspect.signature(item).parameters.items()
    ]


def setting_kinds(schema: Any = Settings, place: str = "") -> dict[str, str]:
    """The type of each setting, by its key."""
    found: dict[str, str] = {}
    for item in fields(schema):
        kind = field_kinds(schema)[item.name]
        inner = is_dataclass(kind)
        found |= setting_kinds(kind, f"{place}{item.name}.") if inner else {place + item.name: _kind(kind)}
    return found


def _kind(kind: Any) -> str:
    return kind.__name__ if isinstance(kind, type) and not hasattr(kind, "__args__") else str(kind)


TREE = "#/$defs/branches"  # the definition of an object that contains itself: its keys are listed once


def file_keys(schema: Any, place: str = "", whole: Any = None) -> list[str]:
    """The keys of a JSON file by its schema, as pointers; ``!`` marks a key that is always there."""
    found: list[str] = []
    whole = schema if whole is None else whole
    if schema.get("$ref") == TREE and place.count("/branches") == 1:
        schema = whole["$defs"]["branches"]
    for name, inner in schema.get("properties", {}).items():
        found.append(f"{place}/{name}{'!' * (name in schema.get('required', ()))}")
        found += file_keys(inner, f"{place}/{name}", whole)
    if isinstance(items := schema.get("items"), dict):
        found += file_keys(items, f"{place}/*", whole)
    return found


def interface() -> dict[str, Any]:
    """The whole interface as JSON."""
    return {
        "python": python_names(),
        "commands": sorted(command.name for command in COMMANDS),
        "settings": setting_kinds(),
        "files": {name: file_keys(json.loads(schema_text(name))) for name in SCHEMA_NAMES},
        "tables": {
            "front.csv": [*FRONT_HEADER],
            "front.csv, further costs": [cost_named(name).column for name in COSTS],
            "plan.csv": [*TABLE_HEADER],
            "dead_reckoning.csv": [*TABLE_COLUMNS],
            "flight_card.csv": [*CARD_COLUMNS],
        },
        "exports": {name: one.file for name, one in FORMATS.items()},
    }


if __name__ == "__main__":
    KEPT.write_text(json.dumps(interface(), indent=1) + "\n")
