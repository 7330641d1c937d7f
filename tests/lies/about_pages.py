"""False values on the page of a result."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lies.editing import Lie

DATA = re.compile(r'(<script type="application/json" id="page-data">)(.*?)(</script>)', re.DOTALL)


def in_page(change: Callable[[dict[str, Any]], Any]) -> Callable[[Path], Any]:
    """Change the numbers that the script of the page reads."""

    def edit(place: Path) -> None:
        text = (place / "report.html").read_text(encoding="utf-8")
        begin, written, end = DATA.findall(text)[0]
        data = json.loads(written)
        change(data)
        new = json.dumps(data).replace("<", "\\u003c")
        (place / "report.html").write_text(text.replace(begin + written + end, begin + new + end))

    return edit


def _safer_points(data: dict[str, Any]) -> None:
    for point in data["points"]:
        point["failure"] *= 0.5


def _other_law(data: dict[str, Any]) -> None:
    for point in data["points"]:
        point["law"] = "independent" if point["law"] == "coherent" else "coherent"


def _safer_promise(data: dict[str, Any]) -> None:
    data["promise"]["failure"] *= 0.5


def _other_path(data: dict[str, Any]) -> None:
    for place in data["paths"][str(data["chosen"])]["line"]:
        place[0] += 0.3


def _headline(place: Path) -> None:
    path = place / "report.html"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("<dt>fails</dt><dd>", "<dt>fails</dt><dd>0."))


PAGE_LIES = (
    Lie(
        "the page has a point less",
        in_page(lambda data: data["points"].pop()),
        ("page: points of the front",),
    ),
    Lie("the points of the page fail half as often", in_page(_safer_points), ("page: points of the front",)),
    Lie("the page names another wind law", in_page(_other_law), ("page: points of the front",)),
    Lie("the page draws another path", in_page(_other_path), ("page: path and promise",)),
    Lie("the page promises less failure", in_page(_safer_promise), ("page: path and promise",), "full"),
    Lie("the headline of the page is better", _headline, ("page: rate in the headline",), "full"),
)
