"""Fonts of figures: names of places may be in any script, and DejaVu Sans has not all of them."""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from matplotlib.font_manager import fontManager

LOG = logging.getLogger(__name__)
FIRST_FONT = "DejaVu Sans"  # comes with matplotlib: the same letters on every machine
OTHER_FONTS = (  # of Linux, macOS and Windows, for letters that the first font does not have
    "Noto Sans CJK JP", "Noto Sans CJK SC", "Noto Sans CJK KR", "Noto Sans JP", "Noto Sans SC",
    "Noto Sans KR", "Noto Sans Devanagari", "Noto Sans Bengali", "Noto Sans Tamil", "Noto Sans Thai",
    "Noto Sans Ethiopic", "Hiragino Sans", "PingFang SC", "Apple SD Gothic Neo", "Yu Gothic",
    "Microsoft YaHei", "Malgun Gothic", "Nirmala UI", "WenQuanYi Zen Hei", "Arial Unicode MS",
    "Unifont",
)  # fmt: skip
MISSING = r"Glyph (\d+) .*missing from font"


def font_families() -> list[str]:
    """The fonts of figures that are installed: each letter is drawn by the first one that has it."""
    installed = {font.name for font in fontManager.ttflist}
    return [FIRST_FONT, *(name for name in OTHER_FONTS if name in installed)]


@contextmanager
def missing_letters_reported() -> Iterator[None]:
    """In the block, letters that no font has are one warning of the log; they are drawn as boxes."""
    with warnings.catch_warnings(record=True) as said:
        warnings.filterwarnings("always", MISSING)
        yield
    missing = {chr(int(found[1])) for each in said if (found := re.match(MISSING, str(each.message)))}
    for each in said:
        if not re.match(MISSING, str(each.message)):
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
    if missing:
        LOG.warning(
            "figures have boxes in place of %s, which no installed font has; install one that has them, "
            "for example Noto Sans CJK", " ".join(sorted(missing)),
        )  # fmt: skip
