"""False values on the page of a result."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lies.editing import Lie, in_text

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


TEXTS, MAP, OTHER = "page: all texts", "page: map", "page: other numbers"
LAND = "page: coasts and cities"


def in_html(pattern: str, new: str) -> Callable[[Path], Any]:
    """Replace what a pattern matches first in the page."""
    return in_text("report.html", pattern, new)


def _without_obstacle(data: dict[str, Any]) -> None:
    shapes = data["map"]["shapes"]
    shapes.remove(next(one for one in shapes if one["role"] == "obstacle"))


def _moved_obstacle(data: dict[str, Any]) -> None:
    for place in next(one for one in data["map"]["shapes"] if one["role"] == "obstacle")["ring"]:
        place[0] += 0.01


def _covers_all(data: dict[str, Any]) -> None:
    data["notCovered"] = ""


def _no_tight_places(data: dict[str, Any]) -> None:
    data["places"] = []


def _no_failures(data: dict[str, Any]) -> None:
    data["flights"]["failures"] += 1


PAGE_LIES = (
    Lie(
        "the limits are not on the page",
        in_html(r'<section class="more" aria-labelledby="limits-title">.*?</section>', ""),
        (TEXTS,),
    ),
    Lie("a row is not on the page", in_html(r'<tr><th scope="row">.*?</tr>', ""), (TEXTS,)),
    Lie("the page is certified", in_html("</header>", "<p>Certified by the FAA</p></header>"), (TEXTS,)),
    Lie("the title is certified", in_html("<h1>", "<h1>FAA certified: "), (TEXTS,)),
    Lie("the page covers all errors", in_html(r"<h3>Not covered</h3><p>.*?</p>", ""), (TEXTS,)),
    Lie("the page covers storms", in_html(r"<h3>Covered</h3><p>", "<h3>Covered</h3><p>storms; "), (TEXTS,)),
    Lie("the page hides its limits", in_html("<style>", "<style>#limits-title{display:none}"), (TEXTS,)),
    Lie("the page hides a row", in_html(r'<tr><th scope="row">', '<tr hidden><th scope="row">'), (TEXTS,)),
    Lie("the page has another script", in_html(r'"use strict";', '"use strict";void 0;'), (TEXTS,)),
    Lie(
        "the page names another seed",
        in_html(r'(<th scope="row">seed</th><td>)\d+', r"\g<1>77"),
        (TEXTS,),
    ),
    Lie("the length of the page is shorter", in_html(r"(<dt>length</dt><dd>)\d", r"\g<1>"), (TEXTS,)),
    Lie("the page counts other failures", in_html(r"flights: (\d+) met", r"flights: 9\1 met"), (TEXTS,)),
    Lie("the map of the page has no first obstacle", in_page(_without_obstacle), (MAP,)),
    Lie("an obstacle of the page is elsewhere", in_page(_moved_obstacle), (MAP,)),
    Lie(
        "a city of the page lies elsewhere",
        in_page(lambda data: data["geography"]["cities"][3].__setitem__(2, 35.0)),
        (LAND,),
    ),
    Lie(
        "a coast of the page lies elsewhere",
        in_page(lambda data: data["geography"]["land"][0][5].__setitem__(0, -95.123)),
        (LAND,),
    ),
    Lie("the script of the page covers all errors", in_page(_covers_all), (OTHER,)),
    Lie("the page has no tight places", in_page(_no_tight_places), (OTHER,), "full"),
    Lie("the page draws other flights", in_page(_no_failures), (OTHER,)),
    Lie(
        "the page has a point less",
        in_page(lambda data: data["points"].pop()),
        ("page: points of the front",),
    ),
    Lie("the points of the page fail half as often", in_page(_safer_points), ("page: points of the front",)),
    Lie("the page names another wind law", in_page(_other_law), ("page: points of the front",)),
    Lie("the page draws another path", in_page(_other_path), ("page: paths and promise",)),
    Lie("the page promises less failure", in_page(_safer_promise), ("page: paths and promise",), "full"),
    Lie("the headline of the page is better", _headline, ("page: rate in the headline",), "full"),
)
