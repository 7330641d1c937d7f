"""Outputs that README.md and the documents show are those of ``docs/numbers.json``."""

from __future__ import annotations

import json
import re
import sys

import pytest

from documents import ROOT

sys.path.insert(0, str(ROOT / "release"))
import docs_numbers

NUMBERS = json.loads(docs_numbers.NUMBERS.read_text(encoding="utf-8"))
SHOWN = [
    (document.relative_to(ROOT).as_posix(), name, text)
    for document in docs_numbers.DOCUMENTS
    for name, text in docs_numbers.blocks(document.read_text(encoding="utf-8"))
]
RATE = re.compile(r"\d[\d.,]*(?= %| of (?:100|10,000)\b)")
SOURCES = (
    "docs/why_believe.md",
    "docs/results.md",
    "docs/forecast_test.md",
    "benchmarks/published/README.md",
)


def test_there_are_blocks_on_the_first_page_and_in_the_tutorial() -> None:
    assert {"README.md", "docs/start.md"} <= {document for document, _, _ in SHOWN}
    assert set(NUMBERS["outputs"]) == set(docs_numbers.OUTPUTS)


@pytest.mark.parametrize(("document", "name", "text"), SHOWN)
def test_a_block_is_what_the_command_printed(document: str, name: str, text: str) -> None:
    assert name in docs_numbers.OUTPUTS, document
    assert text == docs_numbers.block(NUMBERS["outputs"], name), f"{document}: run make docs-numbers"
    assert NUMBERS["outputs"][name]["command"].split()[1:] == list(docs_numbers.OUTPUTS[name].words)


def test_the_numbers_name_their_commit() -> None:
    assert re.fullmatch(r"[0-9a-f]{40}", NUMBERS["commit"])


def test_every_rate_of_the_first_page_stands_where_it_was_computed() -> None:
    readme = docs_numbers.BLOCK.sub("", (ROOT / "README.md").read_text(encoding="utf-8"))
    known = json.dumps(NUMBERS) + "".join((ROOT / source).read_text(encoding="utf-8") for source in SOURCES)
    rates = set(RATE.findall(readme))
    assert len(rates) > 8
    assert {
        rate for rate in rates if not re.search(rf"(?<![\d.]){re.escape(rate)}(?![\d.]*\d)", known)
    } == set()


def test_a_summary_is_shown_without_the_time_of_a_machine_and_its_coverage() -> None:
    said = "One fails.\n  phi2  \n\n\n  length   1 km\n  in all   3.2 s\n\nPoint 1."
    text = f"{said}\nCovered: wind\nNot covered: x\n"
    assert docs_numbers.summary(text) == ["One fails.", "  phi2", "", "  length   1 km", "", "Point 1."]
