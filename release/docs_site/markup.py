r"""What Python's Markdown and mkdocstrings show differently from what the sources mean, in HTML.

Inside code in a table, ``\|`` stands for ``|``, as on the forges. Of a parameter of several types,
``(str, Path or Scene)``, the brackets come from mkdocstrings and not from the docstring.
"""

from __future__ import annotations

import re

PIPE_CODE = re.compile(r"<code>[^<\n]*\\\|[^<\n]*</code>")
LISTED_TYPES = re.compile(r"<code>\((?P<types>(?:(?!</?code>).)*)\)</code>", re.DOTALL)


def mended(html: str) -> str:
    """Mend the HTML of a page."""
    html = PIPE_CODE.sub(lambda found: found[0].replace(r"\|", "|"), html)
    return LISTED_TYPES.sub(r"<code>\g<types></code>", html) if "doc-contents" in html else html
