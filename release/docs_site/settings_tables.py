"""The page of settings, from the dataclasses, and a link to it wherever a page names a setting.

``<!-- settings -->`` stands for one table for each section of :class:`pareto_ltl.Settings`.
"""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from html import escape
from typing import Any

from declared_settings import Declaration, declarations, field_kinds, kind_text
from pareto_ltl.settings import Settings

PLACE = "settings.html"
WITHOUT_LINKS = (PLACE, "CHANGELOG.html", "schemas.html")  # old names; keys of files that are named alike
MARK = "<!-- settings -->"
BAR = r"\|"  # that is no border of a cell
HEAD = "| setting | default | type and range | unit | meaning |\n|---|---|---|---|---|"
LINKED = r"<a\b.*?</a>|<h\d.*?</h\d>|<pre\b.*?</pre>"
NAMED = r"<code>(?P<key>[a-z_]+\.[a-z_.]+)(?:=[^<]*)?</code>"
CODE = re.compile(f"(?P<linked>{LINKED})|{NAMED}", re.DOTALL)


def with_settings(markdown: str) -> str:
    """Put in the tables."""
    return markdown.replace(MARK, settings_text())


def with_setting_links(html: str, page: str) -> str:
    """Link the settings that a page of the site names to their line in the tables."""
    if page in WITHOUT_LINKS:
        return html
    place = posixpath.relpath(PLACE, posixpath.dirname(page) or ".")

    def linked(found: re.Match[str]) -> str:
        if found["linked"] or found["key"] not in keys():
            return found[0]
        return f'<a class="setting" href="{place}#{found["key"]}">{found[0]}</a>'

    return CODE.sub(linked, html)


@cache
def keys() -> frozenset[str]:
    """Every setting as it is typed."""
    return frozenset(
        f"{section.section}.{item.name}"
        for section in sections(Settings())
        for item, _ in declarations(section)
    )


def sections(section: Any) -> Iterator[Any]:
    """A section and those inside it."""
    yield section
    for item in fields(section):
        if is_dataclass(value := getattr(section, item.name)):
            yield from sections(value)


def settings_text() -> str:
    """A heading and a table for each section."""
    return "\n\n".join(
        _section_text(section) for section in sections(Settings()) if any(declarations(section))
    )


def _section_text(section: Any) -> str:
    title = f"`{section.section}`" if section.section else "The run"
    about = " ".join((type(section).__doc__ or "").split()) if section.section else "Keys without a section."
    rows = [_row(section, item.name, declared) for item, declared in declarations(section)]
    return "\n".join([f"## {title} {{ #{section.section or 'the-run'} }}", "", about, "", HEAD, *rows])


def _row(section: Any, name: str, declared: Declaration) -> str:
    key = f"{section.section}.{name}" if section.section else name
    kind = kind_text(field_kinds(type(section))[name]).replace("Any", "a value")
    limits = declared.range_text()
    cells = (
        f'<a id="{key}"></a>`{key}`', _value(getattr(section, name)),
        escape(f"{kind}; {limits}" if limits else kind), declared.unit or "", escape(declared.meaning),
    )  # fmt: skip
    return f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"


def _value(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return f"`{text}`" if text else "empty"
