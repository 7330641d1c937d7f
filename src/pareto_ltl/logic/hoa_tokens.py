"""Tokens of HOA text."""

from __future__ import annotations

import re
from typing import NamedTuple, NoReturn

from pareto_ltl.support.errors import DataError
from pareto_ltl.support.messages import shown_line

STRING, MARK = r'"(?:[^"\\]|\\.)*"', r"--(?:BODY|END|ABORT)--"
TOKEN = re.compile(
    rf"\s+|(?P<string>{STRING})|(?P<mark>{MARK})|(?P<head>[A-Za-z_][\w-]*:)"
    r"|(?P<alias>@[\w-]+)|(?P<int>\d+)|(?P<word>[A-Za-z_][\w-]*)|(?P<sign>[][{}()!&|])",
)
KNOWN = re.compile(rf"[]\s\d[{{}}()!&|]+|{STRING}|{MARK}|[A-Za-z_][\w-]*:?|@[\w-]+")  # runs of tokens
COMMENT_PARTS = re.compile(rf'{STRING}|/\*|\*/|[^"/*\n]+|.|\n')


class Token(NamedTuple):
    """``kind`` is a group of ``TOKEN``, or ``end``."""

    kind: str
    text: str
    line: int


class Tokens:
    """A text that is read token by token; ``here`` is the next token.

    Construction raises a DataError for text that is not a token. Tokens are made on demand, so that a label
    that was read before can be skipped as text.
    """

    def __init__(self, text: str, source: str) -> None:
        self.source = source
        self.text = without_comments(text)
        self.line, self.behind = 1, 0
        self._refuse_unknown()
        self.here = self._next()

    def refuse(self, reason: str, line: int) -> NoReturn:
        """Raise :class:`DataError` with the file, the line and the reason."""
        raise DataError(shown_line(f"{self.source}, line {line}: {reason}"))

    def advance(self) -> None:
        """Go to the next token; the last one is ``end``, which repeats."""
        self.here = self._next()

    def upcoming(self, end: str) -> str:
        """The text between ``here`` and the next sign ``end``; ``end`` itself if there is none."""
        place = self.text.find(end, self.behind)
        return end if place < 0 else self.text[self.behind : place]

    def skip(self, text: str) -> None:
        """Skip ``text``, which follows ``here``, and the sign after it."""
        self.line += text.count("\n")
        self.behind += len(text) + 1
        self.here = self._next()

    def _next(self) -> Token:
        while match := TOKEN.match(self.text, self.behind):
            text, line = match[0], self.line
            self.behind = match.end()
            if "\n" in text:
                self.line += text.count("\n")
            if match.lastgroup:
                return Token(match.lastgroup, text, line)
        return Token("end", "the end of the file", self.line)

    def _refuse_unknown(self) -> None:
        position = 0
        while match := KNOWN.match(self.text, position):
            position = match.end()
        if position < len(self.text):
            line = 1 + self.text.count("\n", 0, position)
            self.refuse(f"'{self.text[position]}' has no meaning here", line)


def without_comments(text: str) -> str:
    """``text`` without (nested) comments; line breaks are kept for the line numbers of errors."""
    if "/*" not in text:
        return text
    outside, depth = [], 0
    for part in COMMENT_PARTS.findall(text):
        depth += part == "/*"
        if depth == 0 or part == "\n":
            outside.append(part)
        depth = max(0, depth - (part == "*/"))
    return "".join(outside)
