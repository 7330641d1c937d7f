"""Pages of the documentation are wrapped at 100 columns, and nothing but prose is."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import markdown

ROOT = Path(__file__).parents[1]
wrap: dict[str, Any] = runpy.run_path(str(ROOT / "release" / "wrap_docs.py"))
PAGE = """
# A heading that is longer than a line of one hundred columns, which stays as it is, being a heading

Words with `code that must not be divided` and [a link with words](page.md#of-some-length), $x + y$ and.
- an item that is so long that it needs a second line, which begins below its first word and not at the margin
    1. an item in it

| a | table with a row that is longer than one hundred columns, in which a line break would begin a row |
|---|---|

```
code that is longer than a line of one hundred columns and must stay as it is, because it is a command line
```

$$
x = a + b + c + d + e + f + g + h + i + j + k + l + m + n + o + p + q + r + s + t + u + v + w + \\tag{M1}
$$
"""


def rendered(text: str) -> str:
    return re.sub(r"\s+", " ", markdown.markdown(text, extensions=["tables", "fenced_code"]))


def test_every_page_is_wrapped() -> None:
    pages = wrap["pages"]()
    assert len(pages) > 40
    text = {page: page.read_text(encoding="utf-8") for page in pages}
    loose = [str(page.relative_to(ROOT)) for page in pages if wrap["wrapped_page"](text[page]) != text[page]]
    assert loose == [], "python release/wrap_docs.py"


def test_only_prose_is_wrapped_and_the_page_is_the_same() -> None:
    done = wrap["wrapped_page"](PAGE)
    assert wrap["wrapped_page"](done) == done
    assert rendered(done) == rendered(PAGE)
    for line in PAGE.splitlines():
        if line.startswith(("#", "|", "code", "x =")):
            assert line in done.splitlines()
    for whole in (
        "`code that must not be divided`",
        "[a link with words](page.md#of-some-length)",
        "$x + y$",
    ):
        assert whole in done
    prose = [line for line in done.splitlines() if line and not line.startswith(("#", "|", "code", "x ="))]
    assert max(map(len, prose)) <= 100


def test_a_word_that_would_begin_a_list_does_not_begin_a_line() -> None:
    text = f"{'word ' * 19}word - and + these 3. begin nothing # new > here"
    done = wrap["wrapped_page"](text)
    assert rendered(done) == rendered(text)
    assert len(done.splitlines()) == 2
