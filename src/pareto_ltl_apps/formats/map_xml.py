"""XML of map files as elements, with limits; tags come without prefixes.

A document type declaration is refused, since entities can expand a small file to fill the memory.
"""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from careful_io.reading import MAX_DEPTH
from pareto_ltl.support.errors import DataError

MOST_ELEMENTS = 1_000_000


def parsed_xml(where: str, data: bytes) -> Element:
    """The root element of an XML text; DataError if it is not XML or has a document type."""
    parser, builder, depth, count = expat.ParserCreate(), TreeBuilder(), 0, 0

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > MAX_DEPTH or count > MOST_ELEMENTS:
            raise DataError(f"{where} is nested too deeply or has more than {MOST_ELEMENTS:,} elements")
        builder.start(name.rpartition(":")[2], attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name.rpartition(":")[2])

    def refuse(*_: Any) -> None:
        raise DataError(f"{where} has a document type (DOCTYPE), which no map needs; remove it")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = builder.data, refuse
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # the latter two: an unknown encoding
        raise DataError(f"{where} is not XML as KML is written ({error}); correct the map") from None
    return builder.close()


def text_of(element: Element | None) -> str:
    """The text of ``element`` without spaces around it; empty for None."""
    return "" if element is None else (element.text or "").strip()
