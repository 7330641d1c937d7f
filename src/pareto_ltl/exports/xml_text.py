"""XML files with the same bytes for the same content."""

from __future__ import annotations

import re
from xml.etree import ElementTree as Xml

FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # in XML 1.0, even escaped


def add(parent: Xml.Element, tag: str, text: str | None = None, **attributes: str) -> Xml.Element:
    """A new last child of ``parent``; characters that XML cannot hold become question marks."""
    child = Xml.SubElement(parent, tag, {key: FORBIDDEN.sub("?", value) for key, value in attributes.items()})
    if text is not None:
        child.text = FORBIDDEN.sub("?", text)
    return child


def xml_bytes(root: Xml.Element) -> bytes:
    """The file of ``root``, one element on each line."""
    Xml.indent(root)
    text: bytes = Xml.tostring(root, "utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text + b"\n"
