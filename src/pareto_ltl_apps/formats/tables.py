"""Tables of readings as text: comma, semicolon or tab, decimal points or commas, comments, several encodings.

Programs and spreadsheets write the same table in many ways. This module finds the header and returns the
cells; what the columns mean is left to the readers of winds and of stations.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import IO, NamedTuple

from careful_io.times import seconds
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.file_formats import format_of, refuse_other_format

MAX_UNPACKED = 2**28  # [bytes] of a table; of a compressed one, when unpacked
MAX_ROWS = 1_000_000  # of a table; a row takes 1 kB of memory while it is read
SMALLER_TABLE = "keep the rows near the map and the hours of the flight"
MAX_HEADER_LINES = 30  # lines before the header: METAR caches begin with a few lines about the request
MAX_COLUMNS = 2000  # of a header that is searched for
DELIMITERS = ",;\t|"
COMMENTS = ("#", "//", "%", "!")
BYTE_ORDERS = (b"\xff\xfe", b"\xfe\xff")  # marks of UTF-16, which spreadsheets call Unicode text
ZONES = re.compile(r"(?:\s*(?:Z|UTC|GMT)|[+-]\d\d(?::?\d\d)?)$", re.I)
CLOCKS = (
    "%d.%m.%Y %H:%M:%S",
    "%d.%m.%Y %H:%M",
    "%d.%m.%Y",
    "%Y/%m/%d %H:%M:%S",
    "%Y/%m/%d %H:%M",
    "%Y/%m/%d",
)
DIGITS = {10: "%Y%m%d%H", 12: "%Y%m%d%H%M", 14: "%Y%m%d%H%M%S"}  # times without signs, by their length
EPOCH = re.compile(r"1\d{9}(\d{3})?(\.\d+)?")  # seconds, or milliseconds, from 2001 to 2033


class Table(NamedTuple):
    """The cells below a header: titles in lower case, rows with their line numbers, and the delimiter."""

    titles: list[str]
    rows: list[tuple[int, list[str]]]
    delimiter: str

    def number(self, text: str) -> float:
        """The number in a cell, with a decimal comma if commas do not divide cells; else ValueError."""
        text = text.strip()
        try:
            return float(text)
        except ValueError:
            if self.delimiter != "," and re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", text):
                return float(text.replace(",", "."))
            raise


def read_table(file: Path, expected: str, fits: Callable[[list[str]], bool]) -> Table:
    """The table in ``file``; ``fits`` says whether a line is its header.

    If no line fits, the first line that is no comment is the header. A line of units below the header is the
    caller's. ``expected`` is for messages.
    """
    with open_table(file, expected) as stream:
        text = stream.read()
        first: Table | None = None
        for delimiter in DELIMITERS:
            reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
            head = _header(reader, fits)
            if head is None or (head[1] is False and first is not None and len(head[0]) <= len(first.titles)):
                continue
            titles, found = head
            rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
            rows = [row for row in rows if not row[1][0].lstrip().startswith(COMMENTS)]
            first = Table(titles, rows, delimiter)
            if found:
                break
    return first or Table([], [], ",")


def _header(reader: Iterator[list[str]], fits: Callable[[list[str]], bool]) -> tuple[list[str], bool] | None:
    """The titles of the header and whether they fit; of lines that do not, the first that is no comment."""
    first: list[str] | None = None
    for _, row in zip(range(MAX_HEADER_LINES), reader, strict=False):
        if not any(cell.strip() for cell in row):
            continue
        titles = [cell.strip().strip('"').lower() for cell in row]
        comment = titles[0].startswith(COMMENTS)
        titles[0] = titles[0].lstrip("#/%! ")
        if len(titles) <= MAX_COLUMNS and fits(titles):
            return titles, True
        if first is None and not comment and titles[0][:4] != "sep=":
            first = titles
    return None if first is None else (first, False)


def seconds_of(text: str) -> tuple[float, bool]:
    """Seconds since 1970 of a time in a cell, and whether it states its zone; without one, it is in UTC.

    ISO 8601, day.month.year, year/month/day, or seconds since 1970. ValueError for other texts, such as
    month/day/year, which day/month/year is written like.
    """
    text = text.strip()
    if EPOCH.fullmatch(text) and not text.startswith("20"):
        whole = float(text)
        return (whole / 1000.0 if whole > 1e11 else whole), True
    plain = re.sub(r"\s*(UTC|GMT|Z)$", "", text, flags=re.I)
    if plain != text:
        return _plain_seconds(plain), True
    zoned = len(text) > 10 and ZONES.search(text[10:]) is not None
    return _plain_seconds(text), zoned


def _plain_seconds(text: str) -> float:
    for clock in (*CLOCKS, DIGITS.get(len(text), "")) if not re.match(r"\d{4}-", text) else ():
        try:
            stamp = datetime.strptime(text, clock)
        except ValueError:
            continue
        return seconds(stamp.isoformat())
    return seconds(text)


@contextmanager
def open_table(file: Path, expected: str) -> Iterator[IO[str]]:
    """In the block, the text of ``file``, which may be gzip-compressed; read errors become a DataError."""
    try:
        with _open_text(file) as stream:
            yield stream
    except OSError as error:
        raise DataError(f"wind file {file} cannot be read: {error.strerror or error}") from None
    except (EOFError, zlib.error) as error:
        raise DataError(f"wind file {file} is damaged or cut off ({error}); fetch it again") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"wind file {file} is not CSV text ({error}); expected {expected}") from None


def _open_text(file: Path) -> IO[str]:
    with file.open("rb") as raw:
        head = raw.read(64)
    packed = file.suffix.lower() == ".gz"
    if format_of(head) != "packed with gzip" or not packed:
        refuse_other_format(f"wind file {file}", head, "a CSV table")
    with gzip.open(file) if packed else file.open("rb") as content:
        data = content.read(MAX_UNPACKED + 1)
    size = f"{MAX_UNPACKED / 2**20:g} MiB"
    if packed and len(data) > MAX_UNPACKED:
        raise DataError(f"wind file {file} unpacks to more than {size}; {SMALLER_TABLE}")
    if len(data) > MAX_UNPACKED or data.count(b"\n") > MAX_ROWS:
        raise DataError(f"wind file {file} has more than {MAX_ROWS:,} rows or {size}; {SMALLER_TABLE}")
    return io.StringIO(_decoded(data), newline="")


def _decoded(data: bytes) -> str:
    """UTF-8 or UTF-16 text; else Windows-1252 text, if it has no control characters."""
    if data.startswith(BYTE_ORDERS):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        if re.search(rb"[\x00-\x08\x0e-\x1f]", data):
            raise
        return data.decode("cp1252")
