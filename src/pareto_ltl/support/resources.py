"""Paths of the data files of the package, in a checkout, an editable install or a wheel."""

from __future__ import annotations

from pathlib import Path

from careful_io.messages import shown_value
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.extensions import extension_folders

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


def added_folders() -> tuple[Path, ...]:
    """Folders of YAML choices that other packages add.

    Raises
    ------
    ConfigError
        If an added choice has the name of a built-in choice or of one of another package.
    """
    places = extension_folders()
    if not places:
        return ()
    seen = {f"conf/{path.parent.name}/{path.stem}" for path in resource_folder("conf").glob("*/*.yaml")}
    seen |= {f"conf/pipelines/{path.stem}" for path in resource_folder("pipelines").glob("*.yaml")}
    for place in places:
        for path in sorted(place.glob("*/*.yaml")):
            name = f"conf/{path.parent.name}/{path.stem}"
            if name in seen:
                raise ConfigError(f"{path}: there is another choice {name}; rename this one, or uninstall it")
            seen.add(name)
    return places


def choice_folders(group: str) -> list[Path]:
    """Folders with the YAML files of ``group``: first the built-in one, then folders of other packages."""
    own = resource_folder("pipelines") if group == "pipelines" else resource_folder("conf") / group
    return [own, *(place / group for place in added_folders())]


def choices(group: str) -> list[str]:
    """Names of the YAML files in ``group``: a folder of ``conf/``, or ``pipelines``."""
    return sorted({path.stem for place in choice_folders(group) for path in place.glob("*.yaml")})


def choice_file(group: str, name: str) -> Path:
    """The YAML file of choice ``name`` in ``group``.

    Raises
    ------
    ConfigError
        If there is none; the message lists the choices.
    """
    for place in choice_folders(group):
        for path in place.glob("*.yaml"):  # names are compared, as ``name`` may not be a valid file name
            if path.stem == name:
                return path
    raise ConfigError(f"there is no {group} {shown_value(name)}; there are {', '.join(choices(group))}")


def kind_names(folder: str) -> tuple[str, ...]:
    """The names of kinds of which each has one file in the package, in ``folder`` below ``pareto_ltl``."""
    return tuple(sorted(path.stem for path in (PACKAGE / folder).glob("[!_]*.py")))
