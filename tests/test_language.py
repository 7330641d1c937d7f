"""Documents, notebooks, messages and docstrings use the standard terms of the field, in literal English."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from documents import DOCUMENTS, ROOT

TEXTS = [*DOCUMENTS, *sorted((ROOT / "examples").glob("*.ipynb"))]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
# Pattern, what to write instead, and a text that the pattern must find.
IDIOMS = (
    (r"\bof full fidelity\b", "with `fidelity=full`", "Of full fidelity the covariance is"),
    (r"\bkeeps? not\b", "breaks, or does not satisfy", "False where it keeps not to epsilon"),
    (r"\bmotors? off\b", "with zero airspeed", "the mean with the motors off"),
    (r"\bnothing at all\b", "say what happens and when", "nothing at all where a step is short"),
    (r"\bnobody\b", "name who, or use the passive: 'is not known'", "where nobody looks"),
    (r"\bdo(?:es)? (?:no )?harm\b", "is harmful, is ignored", "a label that does harm"),
    (r"\b(?:its|their|the|less|more|another|without|in) doubt\b", "uncertainty, standard deviation",
     "expected wind and its doubt"),
    (r"\b(?:fails?|failed) (?:at most )?so often\b", "with at most this failure rate",
     "the shortest that fails at most so often"),
    (r"\btells? (?:no|nothing|how|what|when|where|whether|why)\b", "states, reports",
     "the file tells no energy"),
    (r"\b(?:is|are) told\b", "is reported, is stated", "no energy is told"),
    (r"\btold by\b", "given by, stated in", "a level told by the file"),
    (r"\bwhat it is to\b", "say it directly", "what it is to fail"),
    (r"\ball the same\b", "in any case", "names its path all the same"),
    (r"\b(?:is|are) there twice\b", "occurs twice", "a name is there twice"),
    (r"\bless is better\b", "lower is better", "less is better"),
    (r"\b(?:planned|written|planning) anew\b", "again", "the rest is planned anew"),
    (r"\bstands? for a time\b", "is active for a limited time", "an obstacle that stands for a time"),
    (r"\bas good as it gets\b", "the best possible", "as good as it gets"),
    (r"\b(?:needs|gives?|holds?|takes?|makes?|reads?|counts?|says?|knows?) not\b(?! only)",
     "does not need", "a run that needs not wait"),
    (r"\basked of\b", "required of, taken from", "what is asked of a plan"),
    (r"\bkeeps? to\b", "satisfies, follows, stays inside", "half planes that a flight keeps to"),
    (r"\bwork(?:s|ed|ing)? (?:it |them )?out\b", "computes", "R is worked out for each path"),
    (r"\bholds? on to\b", "follows", "feedback holds on to the mean"),
    (r"\bwhoever\b", "the person who, each process that", "whoever can write the folder"),
    (r"\bnothing but\b", "only", "differ in nothing but the time"),
    (r"\bby turns\b", "alternately", "bend and fly by turns"),
    (r"\b(?:vertices|nodes|bytes|modes|flights|steps|rows?|draws|jobs|ms|kB) an? (?:second|vertex|tree|path|"
     r"step|component|solve|flight|seed|job|task|value|width|slot)\b", "per", "200,000 vertices a second"),
    (r"\bknows? (?:no|nothing|neither)\b", "has no, does not support", "programs that know no wind"),
    (r"\bfor (?:a time or )?for good\b", "permanently", "excluded for a time or for good"),
    (r"\bdo(?:es)? without\b", "does not use, does not import", "later runs do without cvxpy"),
    (r"\bmeant to\b", "intended to, must", "a change that is meant to change results"),
    (r"\bbears? (?:no|neither|a)\b", "has", "a copy that bears no title"),
    (r"\bspells?\b", "period", "fields of a spell"),
    (r"\bwithout a word\b", "without a result, without a message", "ended without a word"),
    (r"\bin the race\b", "survives the race", "paths that stay in the race"),
    (r"\btold (?:apart|from|where|when|how)\b", "distinguished from",
     "cannot be told from a true one"),
    (r"\b(?:nursery|habits|duties)\b", "tree state, growth settings, obligations", "the duties of a state"),
)  # fmt: skip


def shown(place: Path, text: str) -> str:
    return f"{place.relative_to(ROOT)}: {' '.join(text.split())}"


def findings(place: Path, text: str) -> Iterator[str]:
    """Each idiom in ``text``, with the words around it and what to write instead."""
    plain = re.sub(r"\s+", " ", text)
    for pattern, instead, _ in IDIOMS:
        for hit in re.finditer(pattern, plain, re.IGNORECASE):
            around = plain[max(0, hit.start() - 40) : hit.end() + 40]
            yield f"{shown(place, around)!r}: write {instead}"


def document_text(path: Path) -> str:
    """The words of a document: of a notebook its text cells; code blocks and `code` are left out."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    return re.sub(r"```.*?```|`[^`\n]*`", " ", text, flags=re.DOTALL)


def python_texts(source: str) -> Iterator[str]:
    """Every literal with a space in it: docstrings, messages, help; an f-string without its values."""
    tree = ast.parse(source)
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "X" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
            yield node.value


@pytest.mark.parametrize(("pattern", "sample"), [(pattern, sample) for pattern, _, sample in IDIOMS])
def test_each_idiom_is_found_where_it_stands(pattern: str, sample: str) -> None:
    page = ROOT / "docs" / "page.md"
    assert re.search(pattern, sample, re.IGNORECASE)
    assert list(findings(page, f"# A page\n\nText before, {sample.replace(' ', chr(10), 1)}, text after."))
    code = f'def f():\n    """Return x.\n\n    {sample}."""\n    raise ValueError(f"{{x}}: {sample}")\n'
    assert sum(bool(list(findings(page, text))) for text in python_texts(code)) == 2


def test_plain_words_are_left_alone() -> None:
    text = "No doubt remains. The wind is drawn anew. The map has a table; it says what the file is for."
    assert not list(findings(ROOT / "README.md", text))


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_document_is_in_plain_words(path: Path) -> None:
    assert list(findings(path, document_text(path))) == []


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_document_has_no_marks_of_a_merge(path: Path) -> None:
    assert re.findall(r"^(?:<{7}|>{7}) .*$", path.read_text(encoding="utf-8"), re.MULTILINE) == []


def test_messages_and_docstrings_are_in_plain_words() -> None:
    found = [
        hit
        for path in SOURCES
        for text in python_texts(path.read_text(encoding="utf-8"))
        for hit in findings(path, text)
    ]
    assert found == []
