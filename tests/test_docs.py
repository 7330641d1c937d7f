"""The docs site: built without a warning and without a network, its links hold, its tables are complete."""

from __future__ import annotations

import html
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import pytest
from playwright.sync_api import sync_playwright

import pareto_ltl
from declared_settings import declarations
from documents import DOCUMENTS, ROOT
from pareto_ltl.settings import Settings
from pareto_ltl.support.resources import PACKAGE
from pareto_ltl.support.schemas import SCHEMA_NAMES, schema_text

SITE = ROOT / "release" / "docs_site"
CHROMIUM = shutil.which("chromium")
APPLICATIONS = PACKAGE.with_name("pareto_ltl_apps")
JOURNEY = re.compile(r"^ *(?P<names>\w[\w.*>, -]*?) {2,}(?P<file>[\w/]+\.py)", re.MULTILINE)


@dataclass
class PageParts(HTMLParser):
    """What a page of the site has: anchors, links, files that it loads, words."""

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what one element names."""
        told = {name: value or "" for name, value in attrs}
        self.anchors.add(told.get("id", ""))
        if tag == "a" and "href" in told:
            self.links.append(told["href"])
        elif "src" in told or (tag == "link" and "href" in told):
            self.loaded.append(told.get("src") or told["href"])


@dataclass(frozen=True)
class Site:
    """A built site."""

    place: Path

    @cached_property
    def pages(self) -> dict[Path, PageParts]:
        """The parts of every page."""
        return {path: page_parts(path) for path in sorted(self.place.rglob("*.html"))}

    def text(self, name: str) -> str:
        """The HTML of a page."""
        return (self.place / name).read_text(encoding="utf-8")

    def leads_nowhere(self, page: Path, link: str) -> bool:
        """Whether the site lacks the file or the anchor that a link of ``page`` names."""
        parts = urlsplit(link)
        if parts.scheme or parts.netloc:
            return False
        target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
        if not target.is_file():
            return True
        return bool(parts.fragment) and unquote(parts.fragment) not in self.pages[target].anchors


def page_parts(path: Path) -> PageParts:
    """Read a page."""
    parts = PageParts()
    parts.feed(path.read_text(encoding="utf-8"))
    return parts


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    """The site, built with warnings as errors, where every connection is refused."""
    work = tmp_path_factory.mktemp("site").resolve()
    guard = os.pathsep.join((str(ROOT / "tests" / "guard"), str(ROOT / "src")))
    done = subprocess.run(
        [sys.executable, str(SITE), "--work", str(work / "work"), "--out", str(work / "built")],
        cwd=ROOT,
        env={
            "PYTHONPATH": guard, "PARETO_LTL_NOTES": str(work / "notes"), "PATH": "", "LC_ALL": "C.UTF-8",
        },
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    assert not (work / "notes").exists()
    return Site(work / "built")


def maker(name: str) -> ModuleType:
    """A module of release/docs_site."""
    spec = importlib.util.spec_from_file_location(name, SITE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def built_name(source: str) -> str:
    """The name of a page on the site, or a link to it, from the name of its Markdown file."""
    return source.replace("README.md", "index.html").replace(".md", ".html")


FORMULA = re.compile(
    r'<div class="formula"><div>(<math.*?</math>)</div>(?:<span class="formula-number">(.*?)</span>)?'
)
MATHEMATICS = ("mathematics", "mathematics_methods", "wind_error", "follow")


@pytest.mark.parametrize("page", MATHEMATICS)
def test_every_formula_is_drawn_and_has_its_number(page: str, site: Site) -> None:
    """No command of LaTeX is left, and nothing is broken into lines in the middle."""
    source = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    drawn = FORMULA.findall(site.text(f"{page}.html"))
    assert len(drawn) == source.count("\n$$\n") / 2 > 0
    numbers = [f"({number})" for number in re.findall(r"\\tag\{(\w+)\}", source)]
    assert [number for _, number in drawn if number] == numbers
    assert re.findall(r"<em [^>]*>", site.text(f"{page}.html")) == []  # of two underscores in a line
    for formula, _ in drawn:
        ElementTree.fromstring(formula)
        assert "\\" not in formula
        assert "newline" not in formula


def test_every_link_and_anchor_of_the_site_holds(site: Site) -> None:
    broken = [
        f"{page.relative_to(site.place)}: {link}"
        for page, parts in site.pages.items()
        if page.name != "404.html"  # its links begin at the root of a server
        for link in (*parts.links, *parts.loaded)
        if site.leads_nowhere(page, link)
    ]
    assert broken == []


def test_a_page_loads_nothing_from_elsewhere(site: Site) -> None:
    loaded = {link for parts in site.pages.values() for link in parts.loaded}
    assert {link for link in loaded if urlsplit(link).netloc} == set()


def test_links_in_the_repository_hold_on_the_site(site: Site) -> None:
    """With their anchors, also in the README, of which the site has only a part."""
    outside = maker("outside")
    for document in DOCUMENTS:
        source = document.relative_to(ROOT).as_posix()
        text = outside.site_links(document.read_text(encoding="utf-8"), source, outside.site_path(source))
        page = site.place / built_name(outside.site_path(source))
        for link in re.findall(r"\]\(([^)\s]+)\)", text):
            if document.suffix == ".md" and not urlsplit(link).netloc:
                assert not site.leads_nowhere(page, built_name(link)), f"{source}: {link}"


def test_every_document_is_in_the_navigation(site: Site) -> None:
    outside = maker("outside")
    pages = {built_name(outside.site_path(d.relative_to(ROOT).as_posix())) for d in DOCUMENTS}
    assert pages <= set(site.pages[site.place / "maps.html"].links)


# --- generated tables ------------------------------------------------------------------------


def settings_sections(section: object) -> Iterator[object]:
    """A section of the settings and those inside it."""
    yield section
    for value in vars(section).values():
        if hasattr(value, "section"):
            yield from settings_sections(value)


def test_every_setting_has_its_line(site: Site) -> None:
    text, anchors = site.text("settings.html"), site.pages[site.place / "settings.html"].anchors
    for section in settings_sections(Settings()):
        for item, declared in declarations(section):
            key = f"{section.section}.{item.name}".removeprefix(".")
            assert key in anchors
            line = text.split(f'id="{key}"', 1)[1].split("</tr>", 1)[0]
            assert f"<td>{declared.unit or ''}</td>" in line
            for words in (declared.meaning, declared.range_text()):
                assert words.replace("`", "") in html.unescape(re.sub("<[^>]*>", "", line)), key


def test_a_setting_that_a_page_names_is_a_link_to_its_line(site: Site) -> None:
    assert (
        '<a class="setting" href="settings.html#selection.alpha"><code>selection.alpha</code></a>'
        in site.text("front.html")
    )


def test_every_key_of_a_schema_has_its_line(site: Site) -> None:
    text = site.text("schemas.html")
    for name in SCHEMA_NAMES:
        section = text.split(f'<h2 id="{name}">', 1)[1].split("<h2", 1)[0]
        for key, found in json.loads(schema_text(name)).get("properties", {}).items():
            assert f"<code>{key}</code>" in section, (name, key)
            assert found.get("description", "") in html.unescape(section), (name, key)


def test_public_names_and_the_records_of_a_result_are_on_the_page_of_the_interface(site: Site) -> None:
    anchors = site.pages[site.place / "api.html"].anchors
    assert {f"pareto_ltl.{name}" for name in pareto_ltl.__all__ if not name.startswith("__")} <= anchors
    shown = {anchor.rpartition(".")[2] for anchor in anchors}
    for name, row in pareto_ltl.Run.rows().items():
        assert name in shown
        returned = set(re.findall(r"[A-Z]\w+", str(row.make.__annotations__["return"])))
        assert returned <= {*shown, "Path", "Mapping", "Sequence", "None"}, returned


def test_docstrings_are_shown_without_markup_of_other_tools(site: Site) -> None:
    assert re.findall(r":(?:func|class|data|attr|meth|mod):", site.text("api.html")) == []


def test_the_journey_of_a_run_names_functions_where_they_are() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    steps = [(found["names"], found["file"]) for found in JOURNEY.finditer(text)]
    assert len(steps) > 40
    for names, file in steps:
        place = APPLICATIONS / file.removeprefix("apps/") if file.startswith("apps/") else PACKAGE / file
        place = place if place.is_file() else PACKAGE.parent / file
        code = place.read_text(encoding="utf-8")
        for name in re.findall(r"[\w.*]+", re.split(r"->|  +", names)[-1]):
            pattern = name.rpartition(".")[2].replace("*", r"\w+")
            assert re.search(rf"\b(def|class) {pattern}\b", code), (name, file)


@pytest.mark.parametrize("name", ["architecture.md", "adding.md", "reproducing.md"])
def test_the_files_that_a_page_about_the_code_names_are_there(name: str) -> None:
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    files = re.findall(r"`([\w-]+/[\w/]+\.(?:py|yaml))`", text)
    assert len(files) > 10
    missing = [
        file for file in files if not any((at / file).is_file() for at in (ROOT, PACKAGE, APPLICATIONS))
    ]
    assert {file for file in missing if "NAME" not in file and "harbour" not in file} == set()


# --- in a browser ----------------------------------------------------------------------------


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_the_search_works_in_a_site_that_is_opened_as_files(site: Site) -> None:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--headless", "--no-sandbox"])
        page = browser.new_page()
        said: list[str] = []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto((site.place / "index.html").as_uri())
        page.click("input.md-search__input")
        page.keyboard.type("landmark")
        page.wait_for_selector(".md-search-result__link", state="attached", timeout=60_000)
        found = page.eval_on_selector_all(".md-search-result__link", "links => links.map(link => link.href)")
        browser.close()
    assert any("maps.html" in link for link in found)
    assert said == []
