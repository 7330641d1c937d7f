"""Wind files on the command line: ``wind=FILE``, and ``wind.path=FILE`` without a source."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from careful_io.messages import shown_text
from pareto_ltl.extend import wind_sources
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF


def wind_file_words(words: Sequence[str]) -> list[str]:
    """``words`` with ``wind=FILE`` as the source that reads the file, a folder or a pattern, and its path."""
    found = []
    for word in words:
        key, _, value = word.partition("=")
        place = value.strip().strip("'\"")
        if key != "wind" or place in CONF.names("wind") or not _is_place(place):
            if key == "wind" and len(Path(place).parts) > 1 and "," not in place:
                raise ConfigError(
                    f"wind={shown_text(place)}: there is no such file or folder; expected a file of winds, "
                    f"or one of {', '.join(CONF.names('wind'))}"
                )
            found.append(word)
            continue
        found += [f"wind={_source(place)}", "wind.path='" + place.replace("'", "\\'") + "'"]
    return found


def unread_wind_source(config: DictConfig, words: Sequence[str]) -> str | None:
    """The source for ``wind.path`` if the configured one reads no file and no word names one; else None."""
    if any(word.partition("=")[0].lstrip("+") in ("wind", "wind.source") for word in words):
        return None
    path, source = (OmegaConf.select(config, f"wind.{key}") for key in ("path", "source"))
    kind = wind_sources().get(str(source))
    if not isinstance(path, str) or kind is None or kind.reads_path:
        return None
    return _source(path)


def _is_place(place: str) -> bool:
    return Path(place).expanduser().exists() or any(letter in place for letter in "*?[")


def _source(place: str) -> str:
    from pareto_ltl_apps.formats.content import source_of_path  # takes 0.3 s, and few command lines need it

    return source_of_path(place)
