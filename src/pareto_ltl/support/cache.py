"""What is remembered between runs: fits of the wind, by their content, up to a size.

The folder is ``PARETO_LTL_CACHE``, or the user's cache; the limit ``PARETO_LTL_CACHE_MIB``. ``pareto-ltl
cache`` shows and clears it. Jobs at work together share it: who needs an entry first makes it, others wait.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

from pareto_ltl.support.errors import ConfigError, ParetoLtlError

LIMIT = 1024  # [MiB]
LOCKS = "locks"


def root() -> Path:
    """The folder of everything that is remembered."""
    named = os.environ.get("PARETO_LTL_CACHE")
    if named:
        return Path(named)
    import platformdirs

    return Path(platformdirs.user_cache_dir("pareto_ltl"))


def limit() -> int:
    """How large it may grow [bytes]."""
    text = os.environ.get("PARETO_LTL_CACHE_MIB", str(LIMIT))
    if not text.isdecimal():
        raise ConfigError(f"PARETO_LTL_CACHE_MIB must be a whole number of MiB, got {text!r}")
    return int(text) * 2**20


@contextmanager
def alone(key: str) -> Iterator[None]:
    """One process at a time for ``key``; where locks cannot be had, all go on without waiting."""
    folder = root() / LOCKS
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / key, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError:
        yield
        return
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def size(folder: Path) -> tuple[int, int]:
    """Files and bytes below ``folder``; what vanishes meanwhile does not count."""
    files = total = 0
    for path in folder.rglob("*"):
        with suppress(OSError):
            if path.is_file():
                files, total = files + 1, total + path.stat().st_size
    return files, total


def clear(folder: Path) -> None:
    """Remove what is remembered; a job that reads it meanwhile makes its entry again."""
    for name in ("wind", LOCKS):
        if (folder / name).exists():
            shutil.rmtree(folder / name)


def main(argv: list[str]) -> int:
    """``pareto-ltl cache``: its place and size; ``pareto-ltl cache clear``: gone."""
    try:
        options = _arguments().parse_args(argv)
        folder = root()
        files, total = size(folder)
        if options.action == "clear":
            clear(folder)
            print(f"cleared {total / 2**20:.1f} MiB from {folder}")
        else:
            print(f"{folder}: {files} files, {total / 2**20:.1f} of {limit() / 2**20:.0f} MiB")
    except SystemExit as leave:  # --help
        return int(leave.code or 0)
    except (ParetoLtlError, OSError) as error:
        print(f"pareto-ltl: {error}", file=sys.stderr)
        return 2
    return 0


class _Arguments(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ConfigError(f"{message}; see pareto-ltl cache --help")


def _arguments() -> argparse.ArgumentParser:
    parser = _Arguments(
        prog="pareto-ltl cache",
        description="What is remembered between runs: its place and size, or none of it any more.",
    )
    parser.add_argument("action", nargs="?", choices=("size", "clear"), default="size")
    return parser
