"""Extras: packages that only some uses of a program need, and the command that installs them."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from careful_io.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Extras:
    """The optional dependencies of a ``distribution``: of each extra the ``modules`` that it imports."""

    distribution: str
    modules: Mapping[str, tuple[str, ...]]

    def require(self, extra: str, use: str) -> None:
        """Raise ConfigError with the command that installs ``extra`` if one of its packages is missing."""
        if missing := [name for name in self.modules[extra] if find_spec(name) is None]:
            raise ConfigError(self.missing(extra, use, missing))

    def missing(self, extra: str, use: str, modules: Iterable[str] = ()) -> str:
        """The line for a ``use`` without the packages ``modules`` of ``extra``; all of them by default."""
        names = " and ".join(tuple(modules) or self.modules[extra])
        return f"{use} needs {names}: {self.install_command(extra)}"

    def install_command(self, extra: str) -> str:
        """What to type to add ``extra`` to this environment."""
        return install_command(f'"{self.distribution}[{extra}]"')


def install_command(package: str) -> str:
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
