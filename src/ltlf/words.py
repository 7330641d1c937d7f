r"""The words of formulas: operators as this package, other tools, papers and TeX write them.

A text becomes tokens, each an operator in its canonical spelling, a constant, a name or a time span. Accepted
besides the canonical spellings are

- constants ``1 0 tt ff True False TRUE FALSE ⊤ ⊥``;
- operators of Spot, Spin, NuSMV and PRISM: ``/\ \/ => <=> --> <--> ^ ~ <> []``, ``X[!]`` for ``X``;
- words: ``not and or xor implies iff next eventually finally always globally until release``;
- signs: ``¬ ∧ ∨ ⊕ → ⇒ ↔ ⇔ ≡ ◇ □ ○`` and letters of mathematical alphabets, such as 𝒰;
- TeX: ``\land \lor \neg \to \Diamond \Box \bigcirc \mathcal{U}`` and others, with ``$``, ``\,``, ``\left``.

A name that is one of these words stands in double quotes.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass

from ltlf.advice import Advice
from ltlf.texts import QUOTED, shown_text

BYTE_ORDER_MARK = "\ufeff"  # at the start of a text that was saved on Windows
STRONG_NEXT = "[!]"  # X[!] of LTL on finite words; our X is strong, too

_WORDS = {  # by operator: words and signs other than its canonical spelling
    "!": "~ not NOT ¬ ∼ ˜",
    "X": "next ○ ◯ ∘ ⃝",
    "F": "eventually finally <> ◇ ♢ ⋄ ◊ ⬦",
    "G": "always globally [] □ ◻ ☐ ⬜ ▢",
    "U": "until",
    "R": "release",
    "&": "&& and AND /\\ ∧ ⋀",
    "|": "|| or \\/ ∨ ⋁",
    "xor": "^ XOR ⊕ ⊻",
    "->": "--> => ==> implies → ⇒ ⟶ ⟹ ⊃",
    "<->": "<--> <=> <==> iff ↔ ⇔ ⟷ ⟺ ≡",
    "true": "1 tt True TRUE ⊤",
    "false": "0 ff False FALSE ⊥",
    "W": "", "M": "", "(": "", ")": "",
}  # fmt: skip
SPELLINGS = {word: op for op, words in _WORDS.items() for word in (op, *words.split())}

_TEX = {
    "!": "lnot neg",
    "X": "bigcirc circ Circle",
    "F": "Diamond diamond lozenge Finally Eventually",
    "G": "Box square Globally Always",
    "U": "until Until",
    "R": "release Release",
    "&": "land wedge bigwedge",
    "|": "lor vee bigvee",
    "xor": "oplus veebar",
    "->": "to rightarrow Rightarrow implies longrightarrow Longrightarrow",
    "<->": "leftrightarrow Leftrightarrow iff longleftrightarrow Longleftrightarrow equiv",
    "true": "top",
    "false": "bot",
}
TEX_SPELLINGS = {f"\\{word}": op for op, words in _TEX.items() for word in words.split()}

_FONT = r"\\(?:math\w+|text\w*|operatorname|mbox)\s*\{\s*(?P<inner>\w+)\s*\}"
_SPACE = re.compile(
    r"\s|^\s*\$+|\$+\s*$|\\(?:[,;:! ]|left(?![a-zA-Z])|right(?![a-zA-Z])|quad|qquad)|" + BYTE_ORDER_MARK
)
_SIGNS = sorted(
    (w for w in SPELLINGS if not re.fullmatch(r"\w+", w) and w not in "()"), key=len, reverse=True
)
_TOKEN = re.compile(rf"{_FONT}|{'|'.join(map(re.escape, _SIGNS))}|\[[^\[\]]*\]|[()]|{QUOTED}|\\[a-zA-Z]+|\w+")
OPERAND_TEXT = "a proposition, 'true', 'false', '(' or one of ! X F"

_FOREIGN = (  # other kinds of formulas: a pattern of the text, what it is, the way out
    (r"^\s*HOA:", "an automaton in the HOA format", "read it as an automaton"),
    (r"^\s*(LTL|CTL|INVAR|PSL)?SPEC\b", "a specification of NuSMV",
     "write the formula alone, after the word"),
    (r"^\s*ltl\s+\w*\s*\{", "a claim of Spin", "write the formula alone, what stands between { and }"),
    (r"\b[PRS]\s*(min|max)?\s*(=\s*\?|[<>]=?\s*[\d.])", "a property of PRISM (PCTL)",
     "write the path formula alone, what stands between [ and ]"),
    (r"\b[FGXURW]\s*[<>]=?\s*\d", "an operator with a limit in steps",
     "write limits as times, such as F[0,6h] a"),
    (r"[FGXURW◇□]\s*_\s*[\[{(]|\\(Box|Diamond|square)\s*_", "an operator with a subscript, as in "
     "signal temporal logic", "write time limits after F and G, such as F[0,6h] a"),
    (r"\[\s*\d+\s*:\s*\d*\s*\]|\[\s*\d+\s*\.\.", "an operator with a range of steps",
     "write time limits, such as F[0,6h] a, or X for each step"),
    (r"^\s*\(\s*(and|or|not|always|sometime|forall|exists)\b[^)]*\(", "a goal of PDDL",
     "write operators between their operands, as in F a & F b"),
    (r"\b[AE]\s*\[|\b[AE]\s*[FGX]\b|\b[AE][FGX](?=\s+[\w(!]|\()", "a formula of CTL",
     "leave out A and E: a formula is about one word, as in F a"),
    (r"[\w)\]]\s*(<=|>=|<|>|==|!=)\s*-?[\d.]+", "a comparison of numbers, as in signal temporal logic",
     "write a proposition that holds where the comparison does"),
    (r"[∀∃]|\\(forall|exists)\b", "a quantifier", "write one formula for each case, joined by & or |"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FormulaToken:
    """A token: canonical operator, ``name``, ``span`` or ``end``; its word, and its zero-based column."""

    op: str
    word: str
    column: int

    def __str__(self) -> str:
        return "the end of the formula" if self.op == "end" else f"'{shown_text(self.word)}'"


class WordError(ValueError):
    """A text that begins with no token; ``column`` is its zero-based position."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


def formula_tokens(text: str) -> Iterator[FormulaToken]:
    """The tokens of ``text``, the last one ``end``; WordError for a character without a meaning."""
    column = 0
    while column < len(text):
        if space := _SPACE.match(text, column):
            column = space.end()
            continue
        match = _TOKEN.match(text, column)
        if match is None:
            raise WordError(_meaningless(text[column:]), column)
        yield _token(match, column)
        column = match.end()
    yield FormulaToken("end", "", len(text))


def _token(match: re.Match[str], column: int) -> FormulaToken:
    word = match["inner"] or match[0]
    if word.startswith("\\") and word not in SPELLINGS:
        if word not in TEX_SPELLINGS:
            raise WordError(
                f"'{shown_text(word)}' is no operator of TeX that is known here; write one of ! & | -> X F U",
                column,
            )
        return FormulaToken(TEX_SPELLINGS[word], match[0], column)
    plain = word if word.isascii() else unicodedata.normalize("NFKC", word)  # 𝒰 is U
    op = SPELLINGS.get(word) or SPELLINGS.get(plain)
    return FormulaToken(op or ("span" if word.startswith("[") else "name"), word, column)


def _meaningless(rest: str) -> str:
    hint = f"; expected {OPERAND_TEXT}"
    if rest.startswith("=="):
        return "'==' has no meaning in a formula; write '<->'"
    if rest[0] == '"':
        hint = '; a name in quotes ends with another ", and has no backslash in it'
    return f"'{shown_text(rest[0])}' has no meaning in a formula{hint}"


def foreign_format(text: str, advice: Advice) -> str:
    """What a text that is no formula seems to be, and the way out; empty if that is not known."""
    for pattern, kind, cure in _FOREIGN:
        if re.search(pattern, text):
            return f"; it looks like {kind}: {advice.foreign.get(kind, cure)}"
    return ""
