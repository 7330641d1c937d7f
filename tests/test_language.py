"""Documents, notebooks, messages and docstrings use the standard terms of the field, in literal English."""

from __future__ import annotations

import ast
import io
import json
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from functools import cache
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
# Phrases that stand for a thing without its name. Texts older than this rule have some, by file or folder:
# nothing is added to this table, and an entry becomes smaller when a sentence of it is mended.
VAGUE = re.compile(
    r"\b(?:that|those) of\b|\bof (?:its|their) own\b|\bwh(?:at|ich)\b[^.;:]{0,40}\bbuys?\b", re.IGNORECASE
)
REMAINING = {  # a text in plan.json, and its check
    "src/pareto_ltl/wind/coverage.py": 1,
    "src/pareto_ltl_verify/claims/texts.py": 1,
}
MAX_REMAINING = 2


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


def comments(source: str) -> Iterator[str]:
    """Every comment of a Python file."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def all_texts() -> Iterator[tuple[str, str]]:
    """Name and words of documents, of literals and comments in ``src``, and of comments in ``conf``."""
    for path in TEXTS:
        yield str(path.relative_to(ROOT)), document_text(path)
    for path in SOURCES:
        source = path.read_text(encoding="utf-8")
        for text in (*python_texts(source), *comments(source)):
            yield str(path.relative_to(ROOT)), text
    for path in sorted((ROOT / "conf").rglob("*.yaml")):
        for line in path.read_text(encoding="utf-8").splitlines():
            yield str(path.relative_to(ROOT)), line.partition("#")[2]


def vague_phrases(texts: Iterator[tuple[str, str]]) -> dict[str, list[str]]:
    """The phrases of each file, or of its folder in :data:`REMAINING`, with the words around them."""
    hits: dict[str, list[str]] = {}
    for name, text in texts:
        plain = re.sub(r"\s+", " ", text)
        place = next((entry for entry in REMAINING if name == entry or name.startswith(f"{entry}/")), name)
        for hit in VAGUE.finditer(plain):
            around = plain[max(0, hit.start() - 40) : hit.end() + 40]
            hits.setdefault(place, []).append(f"{name}: {around}")
    return hits


@cache
def vague_phrases_of_all() -> dict[str, list[str]]:
    """The phrases of :func:`all_texts`."""
    return vague_phrases(all_texts())


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
    texts = {path: " ¶ ".join(python_texts(path.read_text(encoding="utf-8"))) for path in SOURCES}
    assert [hit for path, text in texts.items() for hit in findings(path, text)] == []


@pytest.mark.parametrize(
    "text",
    [
        "The rate is that of\nflights.",
        "times are those of the plan",
        "a file of its own",
        "What a detour buys",
    ],
)
def test_a_vague_phrase_is_counted(text: str) -> None:
    assert len(vague_phrases(iter([("docs/new.md", text), ("docs/new.md", text)]))["docs/new.md"]) == 2


def test_what_has_its_name_is_not_vague() -> None:
    assert not vague_phrases(
        iter([("docs/new.md", "A package of your own. That often helps. It buys time.")])
    )


def test_no_text_gains_a_vague_phrase() -> None:
    hits = vague_phrases_of_all()
    more = {place: lines for place, lines in hits.items() if len(lines) > REMAINING.get(place, 0)}
    assert more == {}, "name the thing: 'the rate is that of flights' -> 'the rate comes from flights'"


def test_the_table_of_vague_phrases_does_not_grow() -> None:
    assert sum(REMAINING.values()) <= MAX_REMAINING
    counted = Counter({place: len(lines) for place, lines in vague_phrases_of_all().items()})
    assert {place for place in REMAINING if not counted[place]} == set(), "no phrase is left: drop the entry"
