"""Page budgets: report.html of phi2 is written within 2 s, and opened to its first picture within 2 s.

python -m pytest benchmarks/bench_page.py
"""

from __future__ import annotations

import shutil

import pytest

import pareto_ltl
from pareto_ltl.run.results import load_results
from pareto_ltl_apps.view.page.content import page_bytes, page_content
from pareto_ltl_apps.view.page_stage import write_page
from pareto_ltl_apps.view.showing import shown_results
from problems import MISSIONS

CHROMIUM = shutil.which("chromium")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A run of phi2 with default settings, with its page."""
    place = tmp_path_factory.mktemp("page") / "phi2"
    pareto_ltl.plan("phi2", MISSIONS["phi2"], robot={"dt": 1800.0}, out=place)
    return place


def test_page_is_written(benchmark, result, tmp_path):
    """500 flights of each point, rendering and writing; the records exist, as at the end of a run."""
    shown = shown_results(load_results(result))
    benchmark.extra_info["budget"] = 2.0
    path = benchmark.pedantic(write_page, (tmp_path / "report.html", shown), rounds=5, warmup_rounds=1)
    benchmark.extra_info["megabytes"] = path.stat().st_size / 1e6


def test_page_is_rendered(benchmark, result):
    content = page_content(shown_results(load_results(result)))
    benchmark.extra_info["budget"] = 0.3
    benchmark.pedantic(page_bytes, (content,), rounds=5, warmup_rounds=1)


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_page_is_opened_to_its_first_picture(benchmark, result):
    """Time from the address to the drawn map, in a browser that runs already; the file is on a local disk."""
    from playwright.sync_api import sync_playwright

    benchmark.extra_info["budget"] = 2.0
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1440, "height": 900})

        def opened():
            page.goto((result / "report.html").as_uri())
            page.wait_for_selector("html[data-ready=page]")

        benchmark.pedantic(opened, rounds=5, warmup_rounds=1)
        browser.close()
