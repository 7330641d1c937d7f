"""Outputs that README.md and the documents show are those of ``docs/numbers.json``."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

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
RATE_OF_FLIGHTS = re.compile(r"\d\.\d+ %")
WITHOUT_STAMP = ("front.md", "peers.md")  # the test above is for the first; a benchmark writes the other
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


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="a source archive has no history")
def test_the_numbers_are_not_older_than_the_last_release() -> None:
    """``make docs-numbers`` belongs to a release: the last tag is in the history of their commit."""
    tag = git("describe", "--tags", "--abbrev=0", "--match", "v*")
    if git("cat-file", "-e", NUMBERS["commit"]) is None:
        pytest.skip("a shallow clone has no history")
    assert git("merge-base", "--is-ancestor", NUMBERS["commit"], "HEAD") is not None
    assert tag is None or git("merge-base", "--is-ancestor", tag, NUMBERS["commit"]) is not None


def git(*words: str) -> str | None:
    """What git prints; None if it fails, for example without a tag."""
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return None if done.returncode else done.stdout.strip()


def measured_pages() -> list[Path]:
    """Pages with a table of rates in which no command of ``docs_numbers`` has its place."""
    pages = []
    for page in sorted((ROOT / "docs").glob("*.md")):
        text = docs_numbers.BLOCK.sub("", page.read_text(encoding="utf-8"))
        rows = [line for line in text.splitlines() if line.startswith("|") and RATE_OF_FLIGHTS.search(line)]
        if rows and page.name not in WITHOUT_STAMP:
            pages.append(page)
    return pages


@pytest.mark.parametrize("page", measured_pages(), ids=lambda page: page.name)
def test_a_page_of_measured_rates_says_of_which_commit_they_are(page: Path) -> None:
    commits = re.findall(r"(?<=`)[0-9a-f]{7,8}(?=`)", page.read_text(encoding="utf-8"))
    assert commits, f"{page.name}: name the commit of its figures"
    if git("rev-parse", "--is-shallow-repository") == "false":
        assert [commit for commit in commits if git("cat-file", "-e", f"{commit}^{{commit}}") is None] == []


def test_rates_in_tables_are_rounded_and_columns_are_aligned() -> None:
    rows = [("paper", "coherent", "2,165", "35 %"), ("smoothed", "independent", "1,629", "0.060 %")]
    assert docs_numbers.in_columns(("planner", "winds", "km", "failed"), rows) == [
        "planner   winds           km   failed",
        "paper     coherent     2,165     35 %",
        "smoothed  independent  1,629  0.060 %",
    ]


@pytest.mark.parametrize("page", ["docs/start.md", "docs/front.md"])
def test_a_tutorial_has_no_rate_beside_its_blocks(page: str) -> None:
    """But those that a user chooses, and levels of intervals."""
    text = docs_numbers.BLOCK.sub("", (ROOT / page).read_text(encoding="utf-8"))
    assert set(re.findall(r"\d[\d.,]* %", text)) <= {"95 %", "97.5 %", "98.9 %", "5 %", "1 %", "0.1 %"}


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
    assert docs_numbers.summary(text, ROOT) == ["One fails.", "  phi2", "", "  length   1 km", "", "Point 1."]
