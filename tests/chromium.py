"""Pages in Chromium without a network: what the browser says and asks for while one is open."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

CHROMIUM = shutil.which("chromium")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",  # the network is cut
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
MOST, PAUSE = 120_000, 50  # [ms] that a slow machine may take, and between two looks
expect.set_options(timeout=MOST)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


@dataclass
class Opened:
    """A page, and what the browser said and asked for while it was open."""

    page: Page
    address: str
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def value(self, script: str) -> Any:
        return self.page.evaluate(script)

    def wait(self, condition: str) -> None:
        """Until ``condition`` holds and the map is drawn; the page's policy forbids ``wait_for_function``."""
        self.becomes(f"Boolean({condition})", True)

    def becomes(self, script: str, expected: object) -> None:
        """Until the value of ``script`` is ``expected``, and the map is drawn.

        What follows an action is read with this or with Playwright's ``expect``, never once: the page may
        answer later (``test_browser_tests.py``).
        """
        value = None
        for _ in range(MOST // PAUSE):
            value = self.value(script)
            if value == expected:
                return self.drawn()
            self.page.wait_for_timeout(PAUSE)
        said = self.page.inner_text("body")
        pytest.fail(f"not within {MOST} ms: {script} is {value!r}, not {expected!r}; the page says {said}")

    def drawn(self) -> None:
        """Until what was changed is drawn: a map is drawn with the next picture of the browser."""
        self.value("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def launched() -> Iterator[Browser]:
    """A browser, for a fixture."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield browser
        browser.close()


@contextmanager
def opened_page(
    browser: Browser,
    address: str,
    size: tuple[int, int],
    ready: str,
    kind: type[Opened] = Opened,
    **more: Any,
) -> Iterator[Any]:
    """A new page that is ``ready``; afterwards, nothing was asked of others, and no error was logged.

    ``kind`` is the class of what is yielded; ``more`` are settings of the browser's context.
    """
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **more)
    shown = kind(context.new_page(), address)
    shown.page.set_default_timeout(MOST)
    shown.page.on("console", lambda message: shown.said.append(f"{message.text} {message.location['url']}"))
    shown.page.on("pageerror", lambda error: shown.said.append(str(error)))
    shown.page.on("request", lambda request: shown.asked.append(request.url))
    shown.page.goto(address)
    shown.page.wait_for_selector(f"html[data-ready={ready}]")
    shown.drawn()
    yield shown
    own = address.partition("?")[0]
    mine = (own, "data:", f"blob:{own}", "blob:null") if own.startswith("http") else (own, "data:", "blob:")
    assert [url for url in shown.asked if not url.startswith(mine)] == []
    assert not shown.said, shown.said
    context.close()
