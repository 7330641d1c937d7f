"""The page as one HTML file: template, style and script of this folder, plotly.js of its wheel, and data.

Everything is in the file: it loads nothing else, and a policy in its head forbids loading.
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pareto_ltl.report.page.content import Content
from pareto_ltl.support.errors import DataError

if TYPE_CHECKING:
    from jinja2 import Template

FOLDER = "pareto_ltl.report.page"
SCRIPTS = ("basics.js", "map.js", "charts.js", "machine.js", "files.js", "main.js")
MARKUP = str.maketrans(
    {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}
)


def page_bytes(content: Content) -> bytes:
    """The file; the same content gives the same bytes."""
    template = page_template()
    return template.render(
        **content.texts, data=json_for_script(content.data), plotly=plotly_script()
    ).encode()


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
    environment.globals["style"] = Markup(folder.joinpath("page.css").read_text(encoding="utf-8"))
    scripts = (folder.joinpath(name).read_text(encoding="utf-8") for name in SCRIPTS)
    environment.globals["script"] = Markup("\n".join(scripts))
    return environment.from_string(folder.joinpath("page.html").read_text(encoding="utf-8"))


@lru_cache(maxsize=1)
def plotly_script() -> str:
    """plotly.js from the data of the plotly package, whose Python code is not needed for it."""
    found = find_spec("plotly")
    if found is None or found.origin is None:
        raise DataError("the page needs plotly: install pareto-ltl again, or set report.page=false")
    path = Path(found.origin).parent / "package_data" / "plotly.min.js"
    return path.read_text(encoding="utf-8")
