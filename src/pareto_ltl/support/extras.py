"""Extras: packages that only some uses need, and the command that installs them if they are missing."""

from __future__ import annotations

import shlex
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from pareto_ltl.support.errors import ConfigError

MODULES = {  # of each extra in pyproject.toml that the package imports, except launchers of Hydra
    "netcdf": ("xarray", "cf_xarray"),
    "grib": ("cfgrib", "eccodes"),
    "serve": ("starlette", "uvicorn", "PIL", "pmtiles", "mapbox_vector_tile"),
    "follow": ("pymavlink", "serial"),
    "scores": ("scores",),
    "sim": ("jsbsim",),
    "dask": ("distributed",),
}


def require_extra(extra: str, use: str) -> None:
    """Raise ConfigError with the command that installs ``extra`` if one of its packages is missing."""
    if missing := [name for name in MODULES[extra] if find_spec(name) is None]:
        raise ConfigError(missing_extra(extra, use, missing))


def missing_extra(extra: str, use: str, modules: list[str] | None = None) -> str:
    """The line for a ``use`` without the packages ``modules`` of ``extra``; all of them by default."""
    return f"{use} needs {' and '.join(modules or MODULES[extra])}: {install_command(extra)}"


def install_command(extra: str) -> str:
    """What to type to add ``extra`` to this environment."""
    return install_words(f'"pareto-ltl[{extra}]"')


def install_words(package: str) -> str:
    """What to type to install ``package`` here, also if the ``pip`` on PATH belongs to another one.

    A package with brackets is given in double quotation marks: ``cmd`` of Windows does not know single ones.
    """
    install = f"pip install {package}"
    python, pip = Path(sys.executable), shutil.which("pip")
    if find_spec("pip") is None and shutil.which("uv") is not None:  # environments that uv makes have no pip
        return f"uv {install} --python {shlex.quote(str(python))}"
    if pip is not None and Path(pip).parent == python.parent:
        return install
    return f"{shlex.quote(str(python))} -m {install}"
