"""Paths of the data files of the package, in a checkout, an editable install or a wheel."""

from __future__ import annotations

from pathlib import Path

from declared_settings import Choices
from pareto_ltl.support import extensions
from pareto_ltl.support.errors import DataError

PACKAGE = Path(__file__).resolve().parents[1]
SAMPLE_WINDS = PACKAGE / "support" / "data" / "gfs_conus_20181009.csv"


def checkout() -> Path | None:
    """The root folder of the checkout that this code runs from; None if it was installed from a wheel."""
    root = PACKAGE.parents[1]
    return root if PACKAGE.parent.name == "src" and (root / "pyproject.toml").is_file() else None


def resource_folder(name: str) -> Path:
    """Folder ``name`` (``conf`` or ``pipelines``): in a checkout at top level, in a wheel in the package.

    DataError if it is missing.
    """
    roots = [root for root in (checkout(), PACKAGE) if root is not None]
    for root in roots:
        if (root / name).is_dir():
            return root / name
    raise DataError(f"folder {name}/ is missing beside {PACKAGE}: reinstall pareto-ltl")


def _choice_folder(group: str) -> Path:
    return resource_folder("pipelines") if group == "pipelines" else resource_folder("conf") / group


CONF = Choices(_choice_folder, extensions.CONF)


def kind_names(folder: str) -> tuple[str, ...]:
    """The names of kinds of which each has one file in the package, in ``folder`` below ``pareto_ltl``."""
    return tuple(sorted(path.stem for path in (PACKAGE / folder).glob("[!_]*.py")))
