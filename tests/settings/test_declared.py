"""Defaults and ranges of all settings are those of ``declared.txt``: each was chosen, and a page states many.

After a change that is meant, ``python tests/settings/test_declared.py`` writes the file anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from declared_settings import declarations
from pareto_ltl.settings import Settings

KEPT = Path(__file__).parent / "declared.txt"


def lines(section: Any) -> Iterator[str]:
    """``key = default  range`` of each setting; ``distinct`` where a list may not repeat an item."""
    for item, declared in declarations(section):
        key = f"{section.section}.{item.name}".lstrip(".")
        choices = "|".join((*declared.choices, *declared.words))
        words = (declared.within, choices, declared.unit or "", "distinct" * declared.distinct)
        yield " ".join([f"{key} = {getattr(section, item.name)!r}", *filter(None, words)])
    for item in fields(section):
        if is_dataclass(inner := getattr(section, item.name)):
            yield from lines(inner)


def test_defaults_and_ranges_are_those_that_were_chosen() -> None:
    found, kept = list(lines(Settings())), KEPT.read_text(encoding="utf-8").splitlines()
    assert found == kept, "if this is meant: python tests/settings/test_declared.py"


if __name__ == "__main__":
    KEPT.write_text("".join(f"{line}\n" for line in lines(Settings())), encoding="utf-8")
