"""The mathematics and the bibliography hold what code, settings and pages cite."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MATHEMATICS = ("mathematics.md", "mathematics_methods.md")
BIBLIOGRAPHY = DOCS / "bibliography.md"
CITING = ("src/**/*.py", "conf/**/*.yaml", "docs/*.md", "benchmarks/**/*.py", "tests/**/*.py", "README.md")
DEFINITION = re.compile(r"\\tag\{(M\d+[a-z]?)\}$", re.MULTILINE)
LINK = re.compile(r"\[(?:Eqs?\. )?\((M\d+[a-z]?)\)\]\((?:(\w+\.md))?#(\w+)\)")
CITATION = re.compile(r"Eqs?\. (\(M\d+[a-z]?\)(?: and \(M\d+[a-z]?\))*) of docs/(\w+\.md)")
ARXIV = re.compile(r"arXiv:\d{4}\.\d{4,5}")
YEAR = re.compile(r"((?:[A-Z][a-zöü]+(?:, | and ))*[A-Z][a-zöü]+)(?: et al\.)?,? \(?((?:19|20)\d\d)\)?[,):.]")
MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]


def sources() -> Iterator[tuple[str, str]]:
    """Every text that may cite, by its path."""
    for pattern in CITING:
        for path in sorted(ROOT.glob(pattern)):
            if path != BIBLIOGRAPHY and path != Path(__file__):
                yield str(path.relative_to(ROOT)), path.read_text()


def identifiers(text: str) -> set[str]:
    """DOIs, without the punctuation of the sentence around them, and arXiv numbers."""
    found = set(ARXIV.findall(text))
    for match in re.findall(r"doi:(10\.\d{4,9}/[^\s`\"']+)", text):
        doi = match
        while doi[-1] in ".,;:)|" and not (doi[-1] == ")" and doi.count(")") <= doi.count("(")):
            doi = doi[:-1]
        found.add(f"doi:{doi}")
    return found


def equations() -> dict[str, list[str]]:
    """The numbers that each page of mathematics defines, in order."""
    return {page: DEFINITION.findall((DOCS / page).read_text()) for page in MATHEMATICS}


def test_every_equation_has_a_number_of_its_own() -> None:
    numbers = Counter(number for found in equations().values() for number in found)
    assert len(numbers) > 60
    assert [number for number, count in numbers.items() if count > 1] == []


@pytest.mark.parametrize("page", MATHEMATICS)
def test_every_equation_has_one_anchor_of_its_name(page: str) -> None:
    text = (DOCS / page).read_text()
    anchors = re.findall(r'<a id="(m\d+[a-z]?)"></a>', text)
    assert sorted(anchors) == sorted(number.lower() for number in DEFINITION.findall(text))


def test_every_number_in_the_mathematics_is_that_of_an_equation() -> None:
    known = {number for found in equations().values() for number in found}
    for page in MATHEMATICS:
        named = set(re.findall(r"\((M\d+[a-z]?)\)", (DOCS / page).read_text()))
        assert named - known - {"M1a"} == set(), page  # M1a: the example of a number


def test_links_to_equations_lead_to_the_page_that_defines_them() -> None:
    defined, links = equations(), 0
    for path, text in sources():
        for number, page, anchor in LINK.findall(text):
            links += 1
            assert number in defined[page or Path(path).name], (path, number)
            assert anchor == number.lower(), (path, number)
    assert links > 10


def test_code_cites_equations_by_the_page_that_defines_them() -> None:
    defined, cited = equations(), set[str]()
    known = {number for found in defined.values() for number in found}
    for path in sorted((ROOT / "src").rglob("*.py")):
        text = " ".join(path.read_text().split())  # citations may be wrapped
        for numbers, page in CITATION.findall(text):
            named = set(re.findall(r"M\d+[a-z]?", numbers))
            assert named <= set(defined[page]), (path.name, numbers, page)
        found = set(re.findall(r"\((M\d+[a-z]?)\)", text))
        assert found <= known, path.name
        cited |= found
    assert len(cited) > 55


def test_every_doi_and_arxiv_number_stands_in_the_bibliography() -> None:
    known, cited = identifiers(BIBLIOGRAPHY.read_text()), set[str]()
    for path, text in sources():
        missing = identifiers(text) - known
        assert missing == set(), path
        cited |= identifiers(text)
    assert len(cited) > 20


def test_every_author_named_with_a_year_stands_in_the_bibliography() -> None:
    known = BIBLIOGRAPHY.read_text()
    for path, text in sources():
        if not path.startswith("src/"):
            continue
        for names, year in YEAR.findall(text):
            for name in re.findall(r"[A-Z][a-zöü]+", names):
                assert name[:3] in MONTHS or name in known, (path, names, year)


def test_the_bibliography_names_a_source_once() -> None:
    text = BIBLIOGRAPHY.read_text()
    doubled = [key for key, count in Counter(re.findall(r"doi:(10\.\S+)", text)).items() if count > 1]
    items = re.findall(r"^- (.+(?:\n  .+)*)", text, re.MULTILINE)
    assert doubled == []
    assert len(items) == len(set(items)) > 90


def test_every_test_that_a_page_names_exists() -> None:
    defined = {
        name
        for path in ROOT.glob("tests/**/*.py")
        for name in re.findall(r"def (test_\w+)", path.read_text())
    }
    named = 0
    for page in sorted(DOCS.glob("*.md")):
        found = set(re.findall(r"`(test_\w+)`", page.read_text()))
        assert found - defined == set(), page.name
        named += len(found)
    assert named > 30


def test_the_paper_cites_what_its_bibliography_and_ours_have() -> None:
    entries = (ROOT / "paper" / "paper.bib").read_text()
    assert set(re.findall(r"@(\w+\d{4})", (ROOT / "paper" / "paper.md").read_text())) == set(
        re.findall(r"^@\w+\{(\w+),", entries, re.MULTILINE)
    )
    ours = BIBLIOGRAPHY.read_text()
    assert [doi for doi in re.findall(r"doi = \{(.+)\}", entries) if f"doi:{doi}" not in ours] == []
