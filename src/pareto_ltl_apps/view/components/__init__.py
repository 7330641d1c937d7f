"""Scripts and style of maps and charts that the page of a result and the planning desk share.

``bundled`` joins modules into one script for a page that is one file; the desk serves them one by one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment

FOLDER = "pareto_ltl_apps.view.components"
STYLE = "components.css"
# Each module comes after those that it imports.
MODULES = (
    "shapes.js", "geo.js", "map.js", "ground.js", "wind.js", "flight.js", "branches.js", "front.js",
    "risk.js", "machine.js", "player.js",
)  # fmt: skip
IMPORT = re.compile(r'^import \{[^}]*\} from "\./[a-z]+\.js";\n', re.MULTILINE)
EXPORT = re.compile(r"^export (?=(async )?(const|function|class) )", re.MULTILINE)


def component(name: str) -> str:
    """The text of one of ``MODULES`` or of ``STYLE``."""
    return files(FOLDER).joinpath(name).read_text(encoding="utf-8")


def page_environment() -> Environment:
    """For templates of pages: it escapes each text, and refuses names that have no value."""
    from jinja2 import Environment, StrictUndefined

    return Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)


def bundled(modules: Iterable[str]) -> str:
    """The texts of modules, in this order, as one classic script: without imports and exports.

    All their names are then in one scope, so that no two modules may have a name in common.
    """
    return '"use strict";\n' + "\n".join(EXPORT.sub("", IMPORT.sub("", text)) for text in modules)
