r"""Displayed formulas: LaTeX between lines of ``$$`` becomes MathML when the site is built.

Browsers draw MathML themselves: the site loads no script and no font for it, and needs no network. The forges
draw the same LaTeX in another way. A number, ``\tag{M1}``, stands at the right of the formula.
"""

from __future__ import annotations

import re
from html import escape

from latex2mathml.converter import convert

BLOCK = re.compile(r"^\$\$\n(?P<latex>.*?)\n\$\$$", re.DOTALL | re.MULTILINE)
BARS = re.compile(r"<mo>(?=&#x(?:02016|0007C);)")  # of norms, which browsers stretch on one side only
NUMBER = re.compile(r"\s*\\tag\{(?P<number>\w+)\}")


def with_formulas(markdown: str) -> str:
    """Put in the MathML of each formula."""
    return BLOCK.sub(lambda found: formula_html(found["latex"]), markdown)


def formula_html(latex: str) -> str:
    """A formula and its number, on one line of HTML."""
    number = NUMBER.search(latex)
    body = NUMBER.sub("", latex).replace("{aligned}", "{align*}")  # which the converter knows
    shown = f'<span class="formula-number">({escape(number["number"])})</span>' if number else ""
    drawn = BARS.sub('<mo stretchy="false" lspace="0" rspace="0">', convert(body, display="block"))
    return f'<div class="formula"><div>{drawn}</div>{shown}</div>'
