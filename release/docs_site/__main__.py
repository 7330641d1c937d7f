"""Build the site of the documentation: ``python release/docs_site [--builder zensical] [--out FOLDER]``.

1. All pages are written as plain Markdown into ``WORK/pages``: those of ``docs/``, and what is made from
   settings, schemas, packages, formulas and files outside of ``docs/``.
2. A builder turns them into HTML in ``WORK/site``. It runs no code of this project but ``docstrings.py``, so
   that another one can take its place (docs/decisions/site.md).
3. In the HTML, settings become links to their line, and what Markdown shows wrongly is mended.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import formulas
import markup
import outside
import package_tables
import schema_tables
import settings_tables

ROOT = outside.ROOT

BUILDERS: dict[str, tuple[str, ...]] = {
    "mkdocs": ("mkdocs", "build", "--strict", "--quiet", "--config-file"),
    "zensical": ("zensical", "build", "--strict", "--clean", "--config-file"),
}
STEPS: tuple[Callable[[str], str], ...] = (
    settings_tables.with_settings,
    schema_tables.with_schemas,
    package_tables.with_packages,
    formulas.with_formulas,
)


def main(words: list[str]) -> None:
    """Write the pages, run the builder, finish its HTML."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--builder", choices=BUILDERS, default="mkdocs")
    parser.add_argument("--work", type=Path, default=ROOT / "build" / "docs", help="folder of pages")
    parser.add_argument("--out", type=Path, default=ROOT / "site", help="folder of the site")
    arguments = parser.parse_args(words)
    work = arguments.work.resolve()
    shutil.rmtree(work, ignore_errors=True)
    write_pages(work / "pages")
    build(arguments.builder, work)
    finish(work / "site")
    shutil.rmtree(arguments.out, ignore_errors=True)
    (work / "site").rename(arguments.out)


def write_pages(folder: Path) -> None:
    """The Markdown of every page of the site, and the files that pages show or lead to, into ``folder``."""
    docs = ROOT / "docs"
    for path in sorted(path for path in docs.rglob("*") if path.is_file()):
        _write(path, path.relative_to(docs).as_posix(), folder)
    for path in outside.outside_files():
        _write(path, path.relative_to(ROOT).as_posix(), folder)


def page_text(markdown: str, place: str) -> str:
    """The Markdown of a page of the site, from that of its source."""
    markdown = outside.with_parts(markdown, place)
    for step in STEPS:
        markdown = step(markdown)
    return markdown


def build(builder: str, work: Path) -> None:
    """Run a builder on ``work/pages``, with the settings of mkdocs.yml; the site is ``work/site``."""
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for folder in ("src", "release/docs_site/docstrings.py"):
        settings = settings.replace(f"[{folder}]", f"[{(ROOT / folder).as_posix()}]")
    (work / "mkdocs.yml").write_text(settings, encoding="utf-8")
    program, *words = BUILDERS[builder]
    command = [sys.executable, "-m", program, *words, str(work / "mkdocs.yml")]
    done = subprocess.run(command, cwd=work, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, check=False)
    if done.returncode:
        raise SystemExit(done.returncode)


def finish(site: Path) -> None:
    """Mend the HTML of every page of ``site``, and link the settings that it names."""
    for path in sorted(site.rglob("*.html")):
        html = path.read_text(encoding="utf-8")
        new = settings_tables.with_setting_links(markup.mended(html), path.relative_to(site).as_posix())
        if new != html:
            path.write_text(new, encoding="utf-8")


def _write(source: Path, place: str, folder: Path) -> None:
    target = folder / place
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.suffix == ".md":
        target.write_text(page_text(source.read_text(encoding="utf-8"), place), encoding="utf-8")
    else:
        shutil.copyfile(source, target)


if __name__ == "__main__":
    main(sys.argv[1:])
