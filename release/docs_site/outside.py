"""Files outside of docs/ on the site: pages, downloads, parts of the README, and links to all of them.

A file of the repository has the same path on the site, without ``docs/``: ``examples/ozarks.geojson`` is a
download, ``CHANGELOG.md`` a page. README.md is the front page. Links are written as they hold in the
repository; they are turned into links of the site here. A comment ``<!-- README.md: ## A ... ## B -->``
stands for the lines of that file from the heading A (without it) to the heading B.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SINGLE_FILES = (
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "CODE_OF_CONDUCT.md",
    "RELEASING.md",
    "CITATION.cff",
    "LICENSE",
)
FOLDERS = ("examples", "src/pareto_ltl/support/data/schemas")
SUFFIXES = (".csv", ".geojson", ".ipynb", ".json", ".md", ".py", ".toml", ".yaml")
FRONT_PAGE = {"README.md": "index.md"}
LINK = re.compile(r"(?P<before>\]\(|\b(?:src|href)=\")(?P<target>[^)\"\s#]+)(?P<anchor>#[^)\"\s]*)?")
PART = re.compile(r"<!-- (?P<file>[\w./]+): (?P<first>#+ .+?) \.\.\. (?P<beyond>#+ .+?) -->")


def with_parts(markdown: str, place: str) -> str:
    """Put in the parts of other files, and turn links within the repository into links within the site.

    ``place`` is the page of the site, e.g. ``maps.md``.
    """
    source = repository_path(place)
    return PART.sub(lambda found: _part(found, source), site_links(markdown, source, place))


def outside_files() -> Iterator[Path]:
    """Files outside of docs/ that are on the site."""
    yield from (path for name in SINGLE_FILES if (path := ROOT / name).is_file())
    for path in sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*")):
        hidden = any(part.startswith((".", "__pycache__")) for part in path.relative_to(ROOT).parts)
        if path.is_file() and path.suffix in SUFFIXES and not hidden:
            yield path


def repository_path(place: str) -> str:
    """Where a page of the site is in the repository, e.g. ``docs/maps.md``."""
    return place if not (ROOT / "docs" / place).is_file() and (ROOT / place).is_file() else f"docs/{place}"


def site_path(path: str) -> str:
    """Where a file of the repository is on the site."""
    return FRONT_PAGE.get(path, path.removeprefix("docs/"))


def site_links(markdown: str, source: str, place: str) -> str:
    """``markdown`` of the file ``source`` for the page ``place``; other targets stay."""

    def turned(found: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), found["target"]))
        if "://" in found["target"] or path.startswith("..") or not (ROOT / path).is_file():
            return found[0]
        target = posixpath.relpath(site_path(path), posixpath.dirname(place) or ".")
        return f"{found['before']}{target}{found['anchor'] or ''}"

    return LINK.sub(turned, markdown)


def _part(found: re.Match[str], place: str) -> str:
    """The lines between two headings of a file, with its links as ``place`` needs them."""
    lines = (ROOT / found["file"]).read_text(encoding="utf-8").splitlines()
    part = lines[lines.index(found["first"]) + 1 : lines.index(found["beyond"])]
    return site_links("\n".join(part), found["file"], site_path(place))
