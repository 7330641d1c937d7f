"""Colours, sizes, fonts and ticks of all figures, and files with reproducible bytes.

Figures have the width of a column (3.5 in) or a page (7.16 in), so that 7 pt in the file is 7 pt in print.
The colours are taken from Okabe and Ito (2008), which colour-blind readers can distinguish; the colour maps
``cividis`` and ``viridis`` are chosen for the same reason.
"""

from __future__ import annotations

import io
import logging
import math
import re
import threading
import unicodedata
import warnings
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import findSystemFonts, fontManager
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath

from careful_io.files import write_bytes
from pareto_ltl.support.arrays import FloatArray

LOG = logging.getLogger("pareto_ltl.view.style")
FIRST_FONT = "DejaVu Sans"  # comes with matplotlib: the same letters on every machine
OTHER_FONTS = (  # of Linux, macOS and Windows, for letters that the first font does not have
    "Noto Sans CJK JP", "Noto Sans CJK SC", "Noto Sans CJK KR", "Noto Sans JP", "Noto Sans SC",
    "Noto Sans KR", "Noto Sans Devanagari", "Noto Sans Bengali", "Noto Sans Tamil", "Noto Sans Thai",
    "Noto Sans Ethiopic", "Noto Sans Malayalam", "Noto Sans Telugu", "Noto Sans Kannada",
    "Noto Sans Gujarati", "Noto Sans Gurmukhi", "Noto Sans Sinhala", "Noto Sans Khmer", "Noto Sans Lao",
    "Noto Sans Myanmar", "Noto Sans Georgian", "Noto Sans Armenian", "Lohit Malayalam", "Hiragino Sans",
    "PingFang SC", "Apple SD Gothic Neo", "Yu Gothic", "Microsoft YaHei", "Malgun Gothic", "Nirmala UI",
    "WenQuanYi Zen Hei", "Arial Unicode MS", "Unifont",
)  # fmt: skip
EAST_ASIAN = ("HIRAGANA", "KATAKANA", "HANGUL", "FULLWIDTH", "IDEOGRAPHIC", "BOPOMOFO")
MISSING = r"Glyph (\d+) .*missing from font"

COLUMN_WIDTH, PAGE_WIDTH = 3.5, 7.16  # widths of a column and of a page [in]

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
LAW_COLOURS = {"independent": BLUE, "coherent": ORANGE}  # in every figure
LAW_MARKS = {"independent": "o", "coherent": "s"}
LAW_DASHES: dict[str, Any] = {"independent": "-", "coherent": (0, (5.0, 1.2))}
FAILED = "#7A0018"  # darker than any colour of a law, in grey too; failed flights also end in a cross
INK, STONE, MIST = "#333333", "#8C8C8C", "#B8B8B8"

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

RC_SETTINGS: dict[str, Any] = {
    "font.family": [FIRST_FONT],
    "font.size": 7.0,
    "axes.labelsize": 7.0,
    "axes.titlesize": 7.0,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "ytick.minor.size": 1.5,
    "axes.labelpad": 2.5,
    "hatch.linewidth": 0.5,
    "svg.hashsalt": "pareto_ltl",  # without it, ids in SVG files are random
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # TrueType: journals refuse fonts of type 3
}

# A default run's four pictures are compressed in 0.15 s instead of 0.29 s, and 8 % larger.
ENCODING: dict[str, Any] = {"png": {"pil_kwargs": {"compress_level": 3}}}

NO_ORIGIN: dict[str, dict[str, None]] = {  # metadata of a file without date and version
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
}

_STYLE_LOCK = threading.Lock()  # the settings of matplotlib are global to the process


def font_families() -> list[str]:
    """The fonts of figures that are installed: each letter is drawn by the first one that has it."""
    installed = {font.name for font in fontManager.ttflist}
    if not installed.intersection(
        OTHER_FONTS
    ):  # the list of matplotlib is older than what was installed since
        _add_new_fonts()
        installed = {font.name for font in fontManager.ttflist}
    return [FIRST_FONT, *(name for name in OTHER_FONTS if name in installed)]


@lru_cache(maxsize=1)  # once in a process
def _add_new_fonts() -> None:
    """Add the files of ``OTHER_FONTS`` that are on this machine and not in matplotlib's list."""
    known = {font.fname for font in fontManager.ttflist}
    wanted = tuple(
        name.replace(" ", "").removesuffix("JP").removesuffix("SC").lower() for name in OTHER_FONTS
    )
    for file in sorted(set(findSystemFonts()) - known):
        if Path(file).stem.replace("-", "").replace("_", "").lower().startswith(wanted):
            with suppress(OSError, RuntimeError, ValueError):  # a damaged font
                fontManager.addfont(file)


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
            "for example %s", " ".join(sorted(missing)), " and ".join(sorted({*map(font_for, missing)})),
        )  # fmt: skip


def font_for(letter: str) -> str:
    """A font of Noto that has ``letter``, by the script in its name in Unicode."""
    script = unicodedata.name(letter, "").partition(" ")[0]
    return "Noto Sans CJK" if script in ("", "CJK", *EAST_ASIAN) else f"Noto Sans {script.title()}"


@contextmanager
def report_style() -> Iterator[None]:
    """Apply our settings and ignore the matplotlibrc of the user; one thread at a time."""
    settings = RC_SETTINGS | {"font.family": font_families()}
    with _STYLE_LOCK, matplotlib.style.context(["default", settings]):
        yield


def blank_figure(width: float, height: float) -> Figure:
    """An empty figure of ``width`` x ``height`` [in] that needs no display."""
    figure = Figure(figsize=(width, height), facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Axes at ``left``, ``bottom`` of ``width`` x ``height``, all in inches."""
    w, h = figure.get_size_inches()
    return figure.add_axes((left / w, bottom / h, width / w, height / h))


def text_at(figure: Figure, left: float, bottom: float, text: str, **kwargs: Any) -> None:
    """Text at ``left``, ``bottom`` [in]; ``$`` and ``_`` have no special meaning."""
    w, h = figure.get_size_inches()
    figure.text(left / w, bottom / h, text, parse_math=False, **kwargs)


def mark_key(label: str, marker: str, size: float, face: str, edge: str, width: float = 0.6) -> Line2D:
    """An entry of a legend for a mark of ``size`` with an outline of ``width`` [pt]."""
    return Line2D([], [], ls="", marker=marker, ms=size, mfc=face, mec=edge, mew=width, label=label)


def legend_at(
    figure: Figure, keys: Sequence[Artist], corner: tuple[float, float], columns: int, **look: Any
) -> None:
    """Legend with ``columns``, whose corner ``loc`` (default upper left) is at ``corner`` [in]."""
    w, h = figure.get_size_inches()
    plain: dict[str, Any] = {
        "loc": "upper left", "borderaxespad": 0.0, "borderpad": 0.0, "handlelength": 1.8,
        "columnspacing": 1.1, "labelspacing": 0.35,
    }  # fmt: skip
    at = (corner[0] / w, corner[1] / h)
    legend = figure.legend(handles=list(keys), ncols=columns, bbox_to_anchor=at, **(plain | look))
    for text in legend.get_texts():
        text.set_parse_math(False)


def white_halo(width: float = 1.6) -> list[withStroke]:
    """A white outline that keeps text and markers readable on any background."""
    return [withStroke(linewidth=width, foreground="white")]


def law_colour(law: str) -> str:
    """Line colour of a wind law."""
    return LAW_COLOURS.get(law, PURPLE)


def law_mark(law: str) -> str:
    """Marker of a wind law."""
    return LAW_MARKS.get(law, "D")


def law_dashes(law: str) -> Any:
    """Line style of flights in a wind law."""
    return LAW_DASHES.get(law, (0, (1.5, 1.0)))


NARROWEST = 0.15  # width of the narrowest letter, in font sizes


@lru_cache(maxsize=1000)  # headings of one run have many words in common
def text_width(text: str, size: float) -> float:
    """Width of ``text`` [in] in letters of ``size`` [pt]."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", MISSING)
        outline = TextPath((0.0, 0.0), text.replace("$", r"\$"), size=size, usetex=False)
    # The extreme points of letters are vertices. ``get_extents``, which also examines the curves between
    # vertices, takes 8 times as long, 0.2 s for the heading of a map.
    drawn = outline.vertices[np.asarray(outline.codes) != outline.CLOSEPOLY, 0]
    return float(np.ptp(drawn)) / 72.0 if len(drawn) else 0.0


def fitted_lines(text: str, width: float, size: float, most: int = 2) -> list[str]:
    """``text`` in at most ``most`` lines of ``width`` [in], broken after spaces and ``&`` or ``|``.

    Text that does not fit is cut, with ``...`` at the end.
    """
    lines = [""]
    for piece in re.findall(r"[^\s&|]+[&|]*\s*|[&|]+\s*", text):
        if lines[-1] and text_width((lines[-1] + piece).rstrip(), size) > width:
            lines.append("")
        lines[-1] += piece
    shown = [_cut(line.rstrip(), width, size, mark="") for line in lines[:most]]
    if len(lines) > most:
        shown[-1] = _cut(shown[-1], width, size, mark=" ...")
    return shown


def _cut(line: str, width: float, size: float, mark: str) -> str:
    """The longest beginning of ``line`` that fits into ``width`` [in] with ``mark`` after it."""
    longest = int(width * 72.0 / (NARROWEST * size))
    if len(line) <= longest and text_width(line + mark, size) <= width:
        return line + mark
    mark = mark or "..."
    lengths = range(min(len(line), longest) + 1)  # measuring an outline takes a millisecond per letter
    fitting = bisect_right(lengths, width, key=lambda n: text_width(line[:n] + mark, size)) - 1
    return line[: max(fitting, 0)].rstrip() + mark


def figure_bytes(figure: Figure, kind: str, dpi: int) -> bytes:
    """``figure`` as a file of the format ``kind``; equal figures give equal bytes: no date, no version."""
    content = io.BytesIO()
    with missing_letters_reported():
        figure.savefig(content, format=kind, dpi=dpi, metadata=NO_ORIGIN[kind], **ENCODING.get(kind, {}))
    return content.getvalue()


def save_figure(
    figure: Figure, folder: Path, name: str, dpi: int, formats: Sequence[str] = ("png", "svg")
) -> tuple[Path, ...]:
    """Write ``figure`` as ``name``.png, ``name``.svg, ... into ``folder``; return the paths."""
    paths = tuple(folder / f"{name}.{kind}" for kind in formats)
    for kind, path in zip(formats, paths, strict=True):
        write_bytes(path, figure_bytes(figure, kind, dpi))
    return paths


def round_below(value: float) -> float:
    """The largest number 1, 2 or 5 times 10^k that is at most ``value`` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * next(m for m in (5.0, 2.0, 1.0) if m * power <= value * (1 + 1e-9) or m == 1.0)


def log_axis_end(values: FloatArray, least: float = 1e-9) -> tuple[float, bool]:
    """Lower end of a logarithmic axis of probabilities, and whether some values lie below it.

    The end is the power of ten below the smallest value that is at least ``least``. Smaller probabilities are
    below the accuracy of the wind model, and 0 cannot be shown on the axis.
    """
    shown = values[values >= least]
    end = 10.0 ** (math.floor(math.log10(shown.min()) + 1e-9)) if len(shown) else least
    hidden = bool(np.any(values < end))
    return (max(end / 10.0, least) if hidden else end), hidden
