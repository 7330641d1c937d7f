"""Fetching over HTTP: what breaks is taken up again, what is wrong is refused in one line."""

from __future__ import annotations

import io
import urllib.request

import pytest

from noaa_server import NoaaServer, serving
from pareto_ltl.support.errors import DataError
from pareto_ltl_apps.formats import download
from pareto_ltl_apps.formats.download import ByteRange, NotThereError, fetch_bytes

DATA = bytes(range(256)) * 400


@pytest.fixture(autouse=True)
def hasty(monkeypatch):
    monkeypatch.setattr(download, "FIRST_PAUSE", 0.01)
    monkeypatch.setattr(download, "TIMEOUT", 5.0)
    for name in ("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)


def fetched(server, part=None, most=2**20, **more):
    return fetch_bytes(f"{server.address}/file", most, part, **more)


@pytest.mark.parametrize("fault", [None, "slow"])
@pytest.mark.parametrize("part", [None, ByteRange(0, 99), ByteRange(1000, 70_000), ByteRange(90_000, None)])
def test_a_part_is_the_bytes_that_were_asked_for(part, fault):
    with serving(NoaaServer({"file": DATA}, lambda path, count: fault)) as server:
        last = None if part is None or part.last is None else part.last + 1
        assert fetched(server, part) == DATA[0 if part is None else part.first : last]


@pytest.mark.parametrize("part", [ByteRange(1000, 70_000), ByteRange(5, None)])
@pytest.mark.parametrize(
    "faults", [["cut"], ["short"], ["cut", "cut", 503], ["drop", "cut"], [500, 429, "cut"]]
)
def test_a_broken_connection_is_taken_up_where_it_ended(faults, part):
    plan = dict(enumerate(faults, 1))
    with serving(NoaaServer({"file": DATA}, lambda path, count: plan.get(count))) as server:
        last = None if part.last is None else part.last + 1
        assert fetched(server, part) == DATA[part.first : last]
        begins = [int(told.removeprefix("bytes=").split("-")[0]) for _, told in server.ranges]
    assert begins == sorted(begins)
    assert begins[-1] > part.first  # the first half is not fetched twice
    assert len(begins) == len(faults) + 1


def test_progress_counts_as_a_new_beginning_and_no_progress_ends_it():
    with serving(NoaaServer({"file": DATA}, lambda path, count: "cut" if count < 9 else None)) as server:
        assert fetched(server, ByteRange(0, len(DATA) - 1), retries=2) == DATA
    with serving(NoaaServer({"file": DATA}, lambda path, count: "drop")) as server:
        with pytest.raises(DataError, match=r"/file cannot be fetched \(.*\); try again later"):
            fetched(server, ByteRange(0, 9), retries=2)
        assert server.asked["file"] == 3


@pytest.mark.parametrize(
    ("fault", "words", "kind"),
    [
        (404, "is not there", NotThereError),
        (403, "is not there", NotThereError),
        (416, "cannot be fetched", DataError),
        (503, "cannot be fetched .*; try again later", DataError),
        ("whole", "the server ignores byte ranges", DataError),
        ("file:///etc/passwd", "cannot be fetched .*is not allowed", DataError),
        ("ftp://localhost/x", "which is not fetched: not https", DataError),
    ],
)
def test_a_server_that_gives_no_part_is_named_in_one_line(fault, words, kind):
    made = NoaaServer({"file": DATA}, lambda path, count: fault)
    with serving(made) as server, pytest.raises(kind, match=words) as caught:
        fetched(server, ByteRange(0, 9), retries=1)
    assert "\n" not in str(caught.value)


def test_a_file_above_the_limit_is_not_fetched():
    with serving(NoaaServer({"file": DATA})) as server:
        with pytest.raises(DataError, match=r"has 102,400 bytes, more than the limit of 1,000"):
            fetched(server, most=1000)
        with pytest.raises(DataError, match="more than the limit"):
            fetched(server, ByteRange(0, None), most=1000)


def test_a_server_that_takes_too_long_is_left(monkeypatch):
    monkeypatch.setattr(download, "LONGEST", 0.05)
    made = NoaaServer({"file": DATA}, lambda path, count: "slow")
    with serving(made) as server, pytest.raises(DataError, match=r"takes longer than 0.05 s"):
        fetched(server)


def test_a_server_that_is_not_there_is_named():
    with serving(NoaaServer()) as server:
        address = server.address
    with pytest.raises(DataError, match=r"cannot be fetched \(.*refused.*\); try again later"):
        fetch_bytes(f"{address}/file", 100, retries=0)


@pytest.mark.parametrize("url", ["file:///etc/passwd", "ftp://x/y", "/etc/passwd", "data:,x"])
def test_only_web_addresses_are_fetched(url):
    with pytest.raises(DataError, match="is not a web address"):
        fetch_bytes(url, 100)


@pytest.mark.parametrize("there", ["http://localhost/x", "file:///etc/passwd", "ftp://localhost/x"])
def test_a_redirect_from_https_to_http_is_refused(there):
    request = urllib.request.Request("https://localhost/y")
    answer = io.BytesIO()
    with pytest.raises(DataError, match="which is not fetched: not https"):
        download._SameSchemeRedirects().redirect_request(request, answer, 302, "", {}, there)  # noqa: SLF001
    assert answer.closed
