"""What a request may set at the desk: plain values of an allow-list of settings, and choices by their names.

A number, a word of a list or a time can be set in every section of ``SECTIONS``. A setting with free text
could name a file or an address: it is closed unless ``TEXTS`` or ``PATHS`` lists it, so that a new one is
closed. Nothing of a request is read as Hydra's grammar: values become Python values here, and texts get
quotes when they become words of a command line.
"""

from __future__ import annotations

import math
import re
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import NoneType, UnionType
from typing import Any

from careful_io.messages import shown_text, shown_value
from careful_io.reading import shown_json
from pareto_ltl import Settings
from pareto_ltl.extend import Setting
from pareto_ltl.settings.wind import LAW_WORDS
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF
from pareto_ltl_apps.desk.folder import DeskFolder

GROUPS = (
    "experiment", "scene", "mission", "robot", "wind", "planner", "fidelity", "selection", "deployment",
    "exports", "report",
)  # fmt: skip
SECTIONS = (
    "", "scene", "scene.random", "mission", "robot", "robot.power", "wind", "logic", "planner", "fidelity",
    "smoothing", "refine", "selection", "deployment", "exports", "report", "departure", "branch",
    "limits",
)  # fmt: skip
TEXTS = frozenset({
    "scene.name", "scene.bounds", "scene.start", "scene.regions", "scene.obstacles", "scene.windows",
    "scene.landmarks", "mission.formula", "mission.start_time", "mission.pattern", "mission.goals",
    "mission.avoid", "mission.order", "robot.level", "robot.a", "robot.b", "robot.power.points", "wind.level",
    "wind.cycle", "selection.least", "departure.starts", "departure.first", "departure.last",
    "departure.arrive_by",
})  # fmt: skip
PATHS: Mapping[str, tuple[str, ...]] = {  # settings that name files, with their words that name none
    "scene.file": (), "mission.automaton": (), "wind.path": (), "selection.extra_paths": (),
    "wind.forecast_error": LAW_WORDS,
}  # fmt: skip
OF_THE_COMMAND = ("name", "pipelines.stages")  # texts that choices set, and that name no files
KEY = re.compile(r"[A-Za-z]\w*(?:\.\w+)*", re.ASCII)
MAPPING_NAME = re.compile(r"(?!_\w*_$)\w+", re.ASCII)  # _target_ is no name
NUMBER = re.compile(r"[+-]?(?:\d+|\d*\.\d+|\d+\.)(?:[eE][+-]?\d{1,4})?", re.ASCII)
WORDS = {"null": None, "true": True, "false": False}
MOST_DIGITS = 300
DEPTH = 12  # of lists in lists


@dataclass(frozen=True, slots=True)
class Leaf(Setting):
    """A setting at the desk."""

    @property
    def plain(self) -> bool:
        """Whether its values are numbers, true, false or words of a list: none of them can name a file."""
        listed = self.declared is not None and (self.declared.built_in or self.declared.words)
        return bool(listed) or _item_kinds(self.kind) <= {int, float, bool}

    @property
    def open(self) -> bool:
        """Whether a request may set it."""
        free = self.plain or self.key in TEXTS or self.key in PATHS
        return free and self.key.rpartition(".")[0] in SECTIONS and self.key not in OF_THE_COMMAND

    def get(self, settings: Any) -> Any:
        """Its value in ``settings``."""
        for name in self.key.split("."):
            settings = getattr(settings, name)
        return settings


def _item_kinds(kind: Any) -> set[Any]:
    """The types of the single values of a setting of type ``kind``, without null."""
    if isinstance(kind, UnionType) or typing.get_origin(kind) is list:
        return {one for arm in typing.get_args(kind) for one in _item_kinds(arm)} - {NoneType}
    return {kind}


@lru_cache
def leaves() -> Mapping[str, Leaf]:
    """All settings by their keys."""
    found = (one for one in Settings.by_key().values() if not one.is_section)
    return {one.key: Leaf(one.key, one.kind, one.declared) for one in found}


# --- from a request to the words of a command line --------------------------------------------------------


def setting_words(folder: DeskFolder, pairs: Iterable[tuple[str, Any]]) -> list[str]:
    """Words of a command line for ``pairs`` of keys and values; of a key, the last pair counts.

    Raises
    ------
    ConfigError
        If a key is not open at the desk, or a value is not of its type, out of range, a substitution, or a
        path that leads out of the folder.
    """
    found = {key: _written(folder, key, value) for key, value in pairs}
    return sorted(found.values(), key=_rank)  # choices first: a value replaces what a choice sets


def _rank(word: str) -> int:
    key = word.partition("=")[0]
    return 0 if key == "+experiment" else 1 if key in GROUPS else 2


def parted(word: str) -> tuple[str, Any]:
    """Key and value of a word of a command line; ConfigError if it is none, or its key is not open."""
    key, sign, text = word.partition("=")
    key = re.sub(r"^\+{1,2}", "", key)
    if not sign or not KEY.fullmatch(key):
        raise ConfigError(f"{shown_value(word)} is not known; expected KEY=VALUE, e.g. +experiment=phi2")
    leaf = _opened(key)
    return key, text if leaf is None else _value(leaf.kind, text.strip(), key)


def _opened(key: str) -> Leaf | None:
    """The setting ``key``, or the mapping that has this name in it; None for a group."""
    if key in GROUPS:
        return None
    leaf, parent = leaves().get(key), leaves().get(key.rpartition(".")[0])
    held = leaf is None and parent is not None and typing.get_origin(parent.kind) is dict and parent.open
    if held and MAPPING_NAME.fullmatch(key.rpartition(".")[2]):
        return Leaf(key, Any, None)
    if leaf is None or not leaf.open:
        raise ConfigError(
            f"{shown_text(key)} cannot be set at the desk; docs/desk.md says what can, "
            "and the command line sets it"
        )
    return leaf


def _written(folder: DeskFolder, key: str, value: Any) -> str:
    """The word that sets ``key`` to ``value``, checked."""
    if not KEY.fullmatch(key):
        raise ConfigError(f"{shown_text(key)} is not the name of a setting")
    leaf = _opened(key)
    if leaf is None:
        if not isinstance(value, str) or value not in CONF.names(key):
            raise ConfigError(f"{key} must be one of {', '.join(CONF.names(key))}; got {shown_json(value)}")
        return f"{'+' if key == 'experiment' else ''}{key}={value}"
    _refuse_odd(key, value)
    replace(leaf, key=key).check(value)
    if key in PATHS and value is not None and value not in PATHS[key]:
        value = folder.path_of(key, value)
    added = "" if key in leaves() else "++"
    return f"{added}{key}={value_text(_as_floats(leaf.kind, value))}"


def _refuse_odd(key: str, value: Any, depth: int = 0) -> None:
    """ConfigError for substitutions, odd signs and names, numbers that are not finite, and deep lists."""
    if depth > DEPTH:
        raise ConfigError(f"{key}: lists are nested deeper than {DEPTH} levels")
    if isinstance(value, str):
        if "${" in value:
            raise ConfigError(f"{key}: the desk takes no substitutions, got {shown_value(value)}")
        if not value.replace("\n", " ").replace("\t", " ").isprintable():
            raise ConfigError(f"{key} has a sign that cannot be printed: {shown_value(value)}")
    elif isinstance(value, dict):
        for name, item in value.items():
            if not MAPPING_NAME.fullmatch(name):
                raise ConfigError(f"{key}: {shown_value(name)} is not a name; use letters, digits and '_'")
            _refuse_odd(key, item, depth + 1)
    elif isinstance(value, list):
        for item in value:
            _refuse_odd(key, item, depth + 1)
    elif isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{key} must be finite, got {value}")


def _as_floats(kind: Any, value: Any) -> Any:
    """Whole numbers as floats where the type is that: Hydra refuses ``[1, 2]`` for a list of floats."""
    arms = typing.get_args(kind) if isinstance(kind, UnionType) else (kind,)
    if float in arms and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if list[float] in arms and isinstance(value, list):
        return [float(item) for item in value]
    return value


def value_text(value: Any) -> str:
    """A value as Hydra reads it back; texts have quotes, so that nothing in them is a function or a list."""
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, list):
        return f"[{','.join(map(value_text, value))}]"
    if isinstance(value, dict):
        return f"{{{','.join(f'{name}:{value_text(item)}' for name, item in value.items())}}}"
    return next((word for word, known in WORDS.items() if known is value), repr(value))


def quoted(text: str) -> str:
    """``text`` as a value that Hydra reads as text."""
    return (
        "'"
        + re.sub(r"(?<!\\)(\\*)('|\Z)", lambda found: 2 * found[1] + ("\\'" if found[2] else ""), text)
        + "'"
    )


# --- values in words --------------------------------------------------------------------------------------


def _value(kind: Any, text: str, key: str) -> Any:
    """The value of ``text`` for a setting of type ``kind``; lists and mappings are written as in YAML."""
    arms = typing.get_args(kind) if isinstance(kind, UnionType) else (kind,)
    if text == "null" and NoneType in arms:
        return None
    if str in arms:
        return _unquoted(text, key)
    if text[:1] in ("[", "{", "'", '"'):
        return _flow(text, key, texts=_item_kinds(kind) == {str})
    return _scalar(text, key)


def _unquoted(text: str, key: str) -> str:
    if len(text) < 2 or text[0] not in "'\"" or text[-1] != text[0]:
        return text
    if re.search(rf"(?<!\\)(?:\\\\)*{text[0]}", text[1:-1]):
        raise ConfigError(f"{key}: {shown_value(text)} has a quotation mark inside of its quotes")
    return re.sub(r"\\(['\"\\])", r"\1", text[1:-1])


def _scalar(text: str, key: str) -> Any:
    if text in WORDS:
        return WORDS[text]
    if not NUMBER.fullmatch(text):
        return text
    if len(text) > MOST_DIGITS:
        raise ConfigError(f"{key}: the number has too many digits for a setting")
    return int(text) if text.lstrip("+-").isdigit() else float(text)


def _flow(text: str, key: str, *, texts: bool) -> Any:
    """A list or a mapping in YAML's flow style; ``texts``: its items are texts, also if they have digits."""
    import yaml

    def made(node: Any, depth: int) -> Any:
        if isinstance(node, yaml.SequenceNode):
            return [made(item, depth + 1) for item in node.value]
        if isinstance(node, yaml.MappingNode):
            pairs = [(made(name, depth + 1), made(item, depth + 1)) for name, item in node.value]
            return {str(name): item for name, item in pairs}
        return node.value if texts or node.style in ("'", '"') else _scalar(node.value, key)

    try:
        depth = 0
        for event in yaml.parse(text, Loader=yaml.BaseLoader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            named = getattr(event, "anchor", None) or getattr(event, "tag", None)
            if depth > DEPTH or named or isinstance(event, yaml.DirectiveToken):
                raise ConfigError(
                    f"{key}: {shown_value(text)} is neither a list nor a mapping of plain values"
                )
        return made(yaml.compose(text, Loader=yaml.BaseLoader), 0)
    except (yaml.YAMLError, RecursionError):
        raise ConfigError(
            f"{key}: cannot read {shown_value(text)}; expected e.g. [a, b] or {{name: value}}"
        ) from None


# --- after composition -------------------------------------------------------------------------------------


def check_composed(folder: DeskFolder, settings: Settings) -> None:
    """Refuse composed settings that a desk cannot have, whatever way they came.

    Raises
    ------
    ConfigError
        If a path leads out of the folder, or a setting with a text that the desk does not open differs from
        its default.
    """
    usual = Settings()
    for leaf in leaves().values():
        value = leaf.get(settings)
        if leaf.key in PATHS and value is not None and value not in PATHS[leaf.key]:
            folder.path_of(leaf.key, value)
        closed = not leaf.open and not leaf.plain and leaf.key not in OF_THE_COMMAND
        if closed and value != leaf.get(usual) and not _numbers_only(value):
            raise ConfigError(f"{leaf.key} cannot be set at the desk, got {shown_value(value)}")


def _numbers_only(value: Any) -> bool:
    if isinstance(value, list):
        return all(map(_numbers_only, value))
    return isinstance(value, int | float)
