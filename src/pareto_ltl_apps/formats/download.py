"""Download of bytes over HTTP: retries, resumption after a broken connection, limits of time and size.

Downloaded data is never executed. Addresses begin with https:// or http://; redirects from https to http
or to another scheme (``file:``, ``ftp:``) are refused.
"""

from __future__ import annotations

import http.client
import logging
import re
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from careful_io.messages import shown_text
from pareto_ltl.support.errors import DataError

LOG = logging.getLogger("pareto_ltl.formats.download")
TIMEOUT = 30.0  # [s] without a byte
LONGEST = 600.0  # [s] for one request with its retries
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0  # [s] before a request is repeated; doubled each time
BLOCK = 2**16  # bytes read at a time
SCHEMES = ("https", "http")
GONE = (401, 403, 404, 410)  # S3 answers 403 for a file that does not exist
BUSY = (408, 425, 429)


class NotThereError(DataError):
    """The server has no such file, or refuses to send it."""


@dataclass(frozen=True, slots=True)
class ByteRange:
    """Bytes ``first`` to ``last`` of a file, both included; ``last`` None means the end of the file."""

    first: int
    last: int | None

    @property
    def header(self) -> str:
        """The value of the ``Range`` header of a request."""
        return f"bytes={self.first}-{'' if self.last is None else self.last}"


class _BrokenError(Exception):
    """The connection broke or the server is busy; the request may be repeated."""


class _SameSchemeRedirects(urllib.request.HTTPRedirectHandler):
    """Follow only redirects that keep the scheme or go from http to https."""

    max_redirections = 5

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        old, new = urlsplit(req.full_url).scheme, urlsplit(newurl).scheme
        if new not in ("https", old):
            fp.close()
            raise DataError(f"{req.full_url} leads to {shown_text(newurl)}, which is not fetched: not https")
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def fetch_bytes(url: str, limit: int, part: ByteRange | None = None, retries: int = 4) -> bytes:
    """Download the content of ``url``, or a ``part`` of it, at most ``limit`` bytes.

    After a broken connection or a busy server, the request is repeated after 1, 2, 4, ... s (at most 30 s),
    at most ``retries`` times without progress. With ``part``, it continues at the first missing byte.

    Raises
    ------
    NotThereError
        If the server has no such file.
    DataError
        If the server cannot be reached, ignores the range or sends more than ``limit`` bytes, or if retries
        or time run out.
    """
    if urlsplit(url).scheme not in SCHEMES:
        raise DataError(f"{shown_text(url)} is not a web address; expected https://...")
    got = bytearray()
    end = time.monotonic() + LONGEST
    failures = 0
    while True:
        before = len(got)
        try:
            _fetch_rest(url, part, got, limit, end)
            return bytes(got)
        except _BrokenError as error:
            failures = 1 if len(got) > before else failures + 1
            if part is None:
                got.clear()  # a request without a range begins again
            if failures > retries or time.monotonic() > end:
                raise DataError(f"{url} cannot be fetched ({error}); try again later") from None
            pause = min(FIRST_PAUSE * 2.0 ** (failures - 1), LONGEST_PAUSE)
            LOG.info("%s: %s; asked again in %g s", url, error, pause)
            time.sleep(pause)


def _fetch_rest(url: str, part: ByteRange | None, got: bytearray, limit: int, end: float) -> None:
    """Append the missing content to ``got``."""
    before = len(got)
    request = urllib.request.Request(url, headers={"User-Agent": "pareto_ltl", "Accept-Encoding": "identity"})
    rest = None if part is None else ByteRange(part.first + len(got), part.last)
    if rest is not None:
        if rest.last is not None and rest.first > rest.last:
            return
        request.add_header("Range", rest.header)
    try:
        with urllib.request.build_opener(_SameSchemeRedirects()).open(request, timeout=TIMEOUT) as answer:
            length = _checked_length(url, answer, rest, limit - len(got))
            _read_answer(url, answer, got, limit, end)
    except urllib.error.HTTPError as error:
        error.close()
        _refuse_status(url, error.code, str(error.reason))
    except (urllib.error.URLError, http.client.HTTPException, OSError) as error:
        reason = getattr(error, "reason", None) or error
        raise _BrokenError(shown_text(str(reason) or type(error).__name__)) from None
    if rest is not None and rest.last is not None:
        length = rest.last - rest.first + 1
    if length is not None and len(got) < before + length:
        raise _BrokenError(f"ended after {len(got)} of {before + length} bytes")


def _checked_length(url: str, answer: Any, rest: ByteRange | None, limit: int) -> int | None:
    """Bytes from the start of the request to the end of the file; None if the answer does not state it."""
    announced = answer.headers.get("Content-Length", "")
    length = int(announced) if announced.isdecimal() and len(announced) < 20 else None
    total = None
    if rest is not None:
        if answer.status != 206:
            raise DataError(
                f"{url}: the server ignores byte ranges (status {answer.status}; expected 206) and would "
                "send the whole file; use another server (wind.base_url), or wind.source=grib with the file"
            )
        match = re.match(r"bytes (\d{1,19})-\d{1,19}/(\d{1,19})?", answer.headers.get("Content-Range", ""))
        if match is None or int(match[1]) != rest.first:
            raise DataError(f"{url}: the server sends other bytes than requested; use another server")
        total = int(match[2]) - rest.first if match[2] else None
    if length is not None and length > limit:
        raise DataError(f"{url} has {length:,} bytes, more than the limit of {limit:,}")
    return length if rest is None else total


def _read_answer(url: str, answer: Any, got: bytearray, limit: int, end: float) -> None:
    while block := answer.read1(BLOCK):
        got += block
        if len(got) > limit:
            raise DataError(f"{url} has more than {limit:,} bytes, which is the limit")
        if time.monotonic() > end:
            raise DataError(f"{url} takes longer than {LONGEST:g} s; try again later")


def _refuse_status(url: str, status: int, reason: str) -> None:
    answer = f"status {status} {shown_text(reason)}".strip()
    if status in GONE:
        raise NotThereError(f"{url} is not there ({answer})")
    if status in BUSY or status >= 500:
        raise _BrokenError(answer)
    raise DataError(f"{url} cannot be fetched ({answer})")
