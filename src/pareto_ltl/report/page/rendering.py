"""The page as one HTML file: template, style and scripts of this folder and of the components, and data.

Everything is in the file: it loads nothing else, and a policy in its head forbids loading.
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from pareto_ltl.report.components import MODULES, STYLE, bundled, component
from pareto_ltl.report.page.content import Content

if TYPE_CHECKING:
    from jinja2 import Template

FOLDER = "pareto_ltl.report.page"
SCRIPTS = ("basics.js", "layers.js", "files.js", "main.js")
MARKUP = str.maketrans(
    {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
)


def page_bytes(content: Content) -> bytes:
    """The file; the same content gives the same bytes."""
    template = page_template()
    return template.render(**content.texts, data=json_for_script(content.data)).encode()


def json_for_script(data: dict[str, Any]) -> str:
    """``data`` as JSON for a script element: markup characters are escaped, so that no text can end it."""
    return json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=False).translate(MARKUP)


@lru_cache(maxsize=1)
def page_template() -> Template:
    """The template, with style and scripts of this folder inserted; it escapes everything else."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    folder = files(FOLDER)
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    own = {name: folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.css", *SCRIPTS)}
    environment.globals["style"] = Markup(component(STYLE) + own["page.css"])
    parts = [*map(component, MODULES), *(own[name] for name in SCRIPTS)]
    environment.globals["script"] = Markup(bundled(parts))
    return environment.from_string(folder.joinpath("page.html").read_text(encoding="utf-8"))
