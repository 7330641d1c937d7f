"""The results directory of a run: locked while the run works, and cleared of files of an earlier run."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from careful_io.files import FULL_DISK, remove_dead_drafts
from careful_io.locks import claim_folder
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.run_status import RUN_LOCK, RUN_LOG

BOOKKEEPING = (  # the first is removed first: without it, the other files are no result
    "metrics.json", "run.json", "config_resolved.yaml", RUN_LOG,
    ".hydra/config.yaml", ".hydra/hydra.yaml", ".hydra/overrides.yaml",
)  # fmt: skip
OTHER_FILES = ("replan.json",)  # of no stage
EARLY_FILES = ("scene.json", "cells.json", "automaton.json", "automaton.hoa", RUN_LOCK)
STUDY_FOLDERS = ("parts", "starts", "recommended")  # of studies, whose content stays


@contextmanager
def claimed_directory(directory: Path, written: Collection[str]) -> Iterator[None]:
    """Reserve ``directory`` for one run: make it if it is missing, lock it, remove files of an earlier run.

    Parts of a study stay: their names are fingerprints of all that they depend on, and a run that is
    resumed reads them.

    Parameters
    ----------
    written : collection of str
        Patterns of the files of all stages that a run may have (``Pipeline.files``).

    Raises
    ------
    ConfigError
        If another run is at work in it.
    DataError
        If ``directory`` is a file, or one of its folders is a link.
    """
    if directory.exists() and not directory.is_dir():
        raise DataError(f"{directory} is a file, and results need a folder: give the name of a folder")
    refuse_links(directory, written)
    with claim_folder(directory / RUN_LOCK, "a run", "name another folder (hydra.run.dir=FOLDER)"):
        clear_results(directory, written)
        try:
            yield
        except OSError as error:  # Hydra's error for a full disk names no file
            if error.errno not in FULL_DISK or error.filename:
                raise
            raise OSError(error.errno, error.strerror, str(directory)) from error


def discard_try(directory: Path) -> bool:
    """Remove ``directory``, and its parents if they are empty, if a run failed in it before a tree grew.

    Returns whether it is gone. A directory with any other file than :data:`EARLY_FILES` stays.
    """
    inside = {path.relative_to(directory).as_posix() for path in directory.rglob("*") if not path.is_dir()}
    if not inside <= {*BOOKKEEPING, *EARLY_FILES}:
        return False
    shutil.rmtree(directory, ignore_errors=True)
    with suppress(OSError):  # other runs are in them
        directory.parent.rmdir()
        directory.parent.parent.rmdir()
    return not directory.exists()


def _patterns(written: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*BOOKKEEPING, *OTHER_FILES, *written)))


def _folders(written: Iterable[str]) -> tuple[str, ...]:
    """The folders of these files."""
    return tuple(dict.fromkeys(name.partition("/")[0] for name in _patterns(written) if "/" in name))


def refuse_links(directory: Path, written: Iterable[str]) -> None:
    """Raise DataError if a folder that a run writes to in ``directory`` is a link to another place."""
    for pattern in (*_folders(written), *STUDY_FOLDERS):
        for folder in sorted(directory.glob(pattern)):
            if folder.is_symlink():
                raise DataError(
                    f"{folder} is a link, and a run writes nothing through links; remove the link, or name "
                    "another folder for the results"
                )


def clear_results(directory: Path, written: Collection[str]) -> None:
    """Remove files of a run, also unfinished ones, from ``directory``, whose folders are no links.

    All other files stay.
    """
    for folder in (directory, *(directory / name for name in _folders(written))):
        remove_dead_drafts(folder)
    for pattern in _patterns(written):
        for path in directory.glob(pattern):
            if path.is_symlink() or path.is_file():
                path.unlink()
