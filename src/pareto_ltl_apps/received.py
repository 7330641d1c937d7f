"""What the settings of a results directory may do, which may come from another person: the rule, once.

Settings are values. Those that act (connect to a cluster or a server, continue another run, read a file
elsewhere) count only if the user writes them on the command line. A file that they name is read in three more
cases: it lies in the directory, it is part of the package, or it is the file that the run read, by the
SHA-256 in ``run.json``. To compare that, it is opened; nothing else of it is used. ``rerun`` refuses all else
(:func:`allowed_settings`). All other commands make a run whose settings cannot act (``Run.open``).
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

from careful_io.fingerprints import unchanged
from careful_io.links import is_below
from careful_io.messages import shown_text, shown_value
from pareto_ltl import Settings
from pareto_ltl.extend import ALL_WIND, wind_source, wind_sources
from pareto_ltl.settings.wind import LAW_WORDS
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.resources import PACKAGE
from pareto_ltl_apps.formats.map_formats import linked_files

GRANTED = (  # settings that a user may write after the directory
    "evaluation.cluster", "evaluation.resume", "wind.source", "wind.base_url", "wind.offline", "wind.path",
    "wind.forecast_error", "scene.file", "scene.zones", "mission.automaton", "selection.extra_paths",
    "hindcast.truth", "forecast_test.truth",
)  # fmt: skip
LINKED = "read {}, to which a map links, and which is not what the run read"
LONGEST_PATH = 4096  # characters
OTHER_MACHINE = ("//", "\\\\")  # Windows opens a connection for such a path


class Act(NamedTuple):
    """What a setting would do."""

    key: str
    value: Any
    deed: str

    @property
    def word(self) -> str:
        """The setting as a word of the command line: whole, since a user is to copy it."""
        return shlex.quote(shown_text(f"{self.key}={self.value}", LONGEST_PATH))


def allowed_settings(directory: Path, inputs: Mapping[str, Any], words: Sequence[str]) -> Settings:
    """The settings of ``directory`` with the user's ``words``, each ``KEY=VALUE`` with a key of GRANTED.

    ``inputs`` are the SHA-256 of the files that the run read, by name.

    Raises
    ------
    ConfigError
        If a word is none of these, or a setting would act without one.
    """
    given = granted_settings(words)
    settings = Settings.of_file(directory / "config_resolved.yaml", given)
    known = KnownFiles(directory, inputs)
    refused = [act for act in acts(settings, known, given) if act.key not in given]
    if refused:
        raise ConfigError(
            f"{directory}: its settings would {' and '.join(act.deed for act in refused)}, and nothing was "
            f"done; to allow it, add {' '.join(act.word for act in refused)}, or another value"
        )
    return settings


def granted_settings(words: Sequence[str]) -> dict[str, Any]:
    """The values of words ``KEY=VALUE``; ConfigError for a key that is not in :data:`GRANTED`."""
    import yaml

    given = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not equals or key not in GRANTED:
            raise ConfigError(
                f"{shown_value(word)} is not known; expected KEY=VALUE with one of {', '.join(GRANTED)}; "
                "the directory has all other settings"
            )
        try:
            given[key] = yaml.safe_load(text)
        except (yaml.YAMLError, ValueError, RecursionError):
            given[key] = text
    return given


def acts(settings: Settings, known: KnownFiles, given: Mapping[str, Any]) -> Iterator[Act]:
    """What ``settings`` would do beyond their directory."""
    wind = settings.wind
    for section in sorted(settings.sections(), key=lambda section: section is wind):  # the wind's come last
        for name, deed in section.acts.items():
            if (value := getattr(section, name)) is not None:
                yield Act(f"{section.section}.{name}", value, deed.format(_shown(value)))
    if wind.base_url is None and wind.source not in wind_sources():
        yield Act("wind.source", wind.source, f"run the wind source {_shown(wind.source)} of another package")
    elif wind.base_url is None and _downloads(settings) and "wind.offline" not in given:
        yield Act("wind.source", wind.source, "download a forecast")
    for key, name in named_files(settings):
        if key not in given and not known.knows(name):
            yield Act(key, name, f"read {_shown(name)}, which is not there or not what the run read")
    drawn, zones = settings.scene.file, settings.scene.zones
    if "scene.file" not in given and drawn and (link := known.unknown_link([drawn])):
        yield Act("scene.file", drawn, LINKED.format(_shown(link)))
    if "scene.zones" not in given:
        deed = f"read {_shown(', '.join(zones))}, not all of which are there and what the run read"
        link = known.unknown_link(zones)
        if link or not all(map(known.knows, zones)):
            yield Act("scene.zones", f"[{','.join(zones)}]", LINKED.format(_shown(link)) if link else deed)
    reads_path = "wind.path" not in given and wind.path is not None and _reads_path(settings)
    if reads_path and not known.knows_wind(settings):
        deed = f"read {_shown(wind.path)}, which is not there or not what the run read"
        yield Act("wind.path", wind.path, deed)


def named_files(settings: Settings) -> Iterator[tuple[str, str]]:
    """Key and value of each setting that names a file or folder which the run reads, without the wind's."""
    places = {
        "scene.file": settings.scene.file,
        "mission.automaton": settings.mission.automaton,
        "selection.extra_paths": settings.selection.extra_paths,
        "wind.forecast_error": law_file(settings),
    }
    for study in ("hindcast", "forecast_test"):
        if study in settings.pipelines.stages:
            places[f"{study}.truth"] = getattr(settings, study).truth
    yield from ((key, name) for key, name in places.items() if name is not None)


def law_file(settings: Settings) -> str | None:
    """The file of ``wind.forecast_error``; None if it is a word."""
    name = settings.wind.forecast_error
    return None if name in LAW_WORDS else name


def _downloads(settings: Settings) -> bool:
    return wind_sources()[settings.wind.source].live and not settings.wind.offline


def _reads_path(settings: Settings) -> bool:
    kind = wind_sources().get(settings.wind.source)
    return kind is not None and kind.reads_path


def _shown(value: object) -> str:
    return shown_text(str(value))


class KnownFiles:
    """The files that a received directory may name: in it, in the package, or unchanged since the run.

    Parameters
    ----------
    directory : Path or None
        The results directory.
    inputs : mapping of str to str
        The SHA-256 of the files that the run read, by name.
    """

    def __init__(self, directory: Path | None, inputs: Mapping[str, Any]) -> None:
        self.folders = [os.path.realpath(place) for place in (PACKAGE, directory) if place is not None]
        self.inputs = {str(Path(name)): str(digest) for name, digest in inputs.items()}

    def knows(self, name: str) -> bool:
        """Whether the file ``name`` may be read; it is opened only if ``run.json`` lists it."""
        if name.startswith(OTHER_MACHINE):
            return False
        path = Path(name).expanduser()
        if any(is_below(os.path.realpath(path), folder) for folder in self.folders):
            return True
        return any(
            str(one) in self.inputs and self._unchanged(str(one)) for one in (path, path / "front.npz")
        )

    def unknown_link(self, names: Sequence[str]) -> Path | None:
        """A file that may not be read and to which one of the maps ``names`` links; None: there is none."""

        def may_read(path: Path) -> bool:
            return self.knows(str(path))

        maps = [Path(name).expanduser() for name in names if self.knows(name)]
        links = (link for path in maps for link in linked_files(path, may_read))
        return next((link for link in links if not may_read(link)), None)

    def knows_wind(self, settings: Settings) -> bool:
        """Whether all files of ``wind.path``, a file, a folder or a pattern, may be read."""
        name = str(settings.wind.path)
        if self.knows(name):
            return True
        path = str(Path(name).expanduser())
        listed = [one for one in self.inputs if one.startswith(path + os.sep) or fnmatch(one, path)]
        if name.startswith(OTHER_MACHINE) or not listed or not all(map(self._unchanged, listed)):
            return False
        return set(map(str, wind_files(settings))) <= set(listed)

    def _unchanged(self, name: str) -> bool:
        if not re.fullmatch(r"[0-9a-f]{64}", self.inputs[name]):
            return False
        try:
            return unchanged({name: self.inputs[name]})
        except (DataError, ValueError):  # a pipe or a device; a NUL in the name
            return False


def wind_files(settings: Settings) -> tuple[Path, ...]:
    """The files of ``wind.path``; none if there are none."""
    try:
        return wind_source(settings.wind).files(settings.wind, ALL_WIND)
    except DataError:
        return ()
