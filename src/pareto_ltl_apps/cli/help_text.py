"""The texts of ``--help``: short, complete, and for one command."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from pareto_ltl import Settings
from pareto_ltl.extend import Declaration
from pareto_ltl.support.errors import ConfigError
from pareto_ltl.support.resources import CONF, resource_folder
from pareto_ltl_apps.cli.command_table import COMMANDS, PipelineCommand

Groups = Mapping[str, list[str]]

WIDTH = 110
COLUMN = 36  # column at which explanations begin
ADDED_GROUPS = ("experiment", "sweep")  # written with a + before them
COMMON_GROUPS = ("experiment", "fidelity", "wind", "selection", "report")
COMMON_SETTINGS = (
    "name", "seed", "mission.formula", "planner.n_max", "planner.trees", "robot.dt", "robot.u_max",
    "selection.alpha", "scene.file", "wind.path",
)  # fmt: skip
ABOUT = "Risk-aware temporal-logic mission planning in uncertain wind, without position fixes."
EXAMPLES = """\
  pareto-ltl plan +experiment=phi1                         plan one of the ready missions
  pareto-ltl plan +experiment=phi1 "mission.formula='F(a & F b)'" planner.n_max=5000
  pareto-ltl sweep +experiment=phi2 'seed=range(0,99)' hydra/launcher=joblib"""
FLAGS = """\
  -m, --multirun  run every combination of key=value1,value2 or key=range(first,beyond)
  --config-dir    a folder with your own choices; --hydra-help: flags of Hydra
  --cfg job       show the settings of a command line, and run nothing
  --help          this text; --help=all: every choice and every setting; --version: the version
  --json          one JSON document on stdout; --quiet: paths alone; --verbose: a longer summary"""
MORE = """\
  pareto-ltl COMMAND --help                the settings of one command
  pareto-ltl --help=all                    every choice and every setting, with unit, range and meaning
  eval "$(pareto-ltl -sc install=bash)"    tab completion (also zsh and fish)"""


def short_help(groups: Groups) -> str:
    """Usage, commands, and the choices and settings that are used most."""
    everything = {key: entry for part in _sections(Settings()) for key, entry in _described(part)}
    settings = [_entry(key, *everything[key]) for key in COMMON_SETTINGS]
    return _general_help(
        ("Choices used most", _group_lines({name: groups.get(name, []) for name in COMMON_GROUPS})),
        ("Settings used most", "\n".join(settings)),
    )


def full_help(settings: Settings, groups: Groups) -> str:
    """Every choice of every group and every setting: its value, meaning, unit and range."""
    return _general_help(
        ("Choices (group=choice; +experiment=choice, +sweep=choice)", _group_lines(groups, plus=False)),
        ("Settings (key=value; values as set by this command line)", _section_lines(settings)),
    )


def _general_help(*parts: tuple[str, str]) -> str:
    commands = [f"  {command.name:<14}{command.meaning}" for command in COMMANDS]
    return _page(
        ("", ABOUT),
        ("Usage", "  pareto-ltl [COMMAND] [group=choice ...] [key=value ...] [flags]"),
        ("Commands (plan, where none is given)", "\n".join(commands)),
        ("Examples", EXAMPLES),
        *parts,
        ("Flags", FLAGS),
        ("More", MORE),
    )


def command_help(command: PipelineCommand, groups: Groups) -> str:
    """The help of a pipeline: its purpose, its stages, and the settings of its sections."""
    import yaml

    stages = yaml.safe_load((resource_folder("pipelines") / f"{command.name}.yaml").read_text())["stages"]
    settings = Settings()
    own = "\n".join(_section_lines(getattr(settings, name)) for name in command.sections)
    return _page(
        ("", f"pareto-ltl {command.name}: {command.meaning}."),
        ("Usage", f"  pareto-ltl {command.name} [group=choice ...] [key=value ...] [flags]\n"
                  f"  The same as pareto-ltl pipelines={command.name} ..."),
        ("Stages", f"  {', '.join(stages)}"),
        ("Choices used most", _group_lines({name: groups.get(name, []) for name in COMMON_GROUPS})),
        ("Settings", own),
        ("Flags", FLAGS),
        ("More", MORE),
    )  # fmt: skip


def group_choices(config_path: str | None, config_dir: str | None) -> dict[str, list[str]]:
    """Every group with its choices, of the package and of ``--config-dir``; nested as ``hydra/launcher``."""
    roots = [Path(config_path) if config_path else resource_folder("conf")]
    roots += CONF.added_folders()
    if config_dir is not None:
        roots.append(Path(config_dir))
    found: dict[str, set[str]] = {
        "pipelines": {path.stem for path in resource_folder("pipelines").glob("*.yaml")}
    }
    for root in roots:
        if not root.is_dir():
            raise ConfigError(f"{root}: there is no such folder")
        for path in root.rglob("*.yaml"):
            if path.parent != root:
                found.setdefault(path.parent.relative_to(root).as_posix(), set()).add(path.stem)
    return {group: sorted(names) for group, names in sorted(found.items())}


# --- pieces ----------------------------------------------------------------------------------


def _page(*parts: tuple[str, str]) -> str:
    return "\n\n".join(f"{title}\n{body}" if title else body for title, body in parts if body)


def _group_lines(groups: Groups, *, plus: bool = True) -> str:
    lines = []
    for group, names in groups.items():
        key = f"+{group}=" if group in ADDED_GROUPS else f"{group}="
        listed = ", ".join(names)
        lines += (
            textwrap.wrap(listed, WIDTH, initial_indent=f"  {key:<14}", subsequent_indent=" " * 16)
            if plus
            else [f"  {group}: {listed}"]
        )
    return "\n".join(lines)


def _section_lines(section: Any) -> str:
    """The help of a section and of the sections inside it."""
    lines = []
    for part in _sections(section):
        title = " ".join((type(part).__doc__ or "").split())
        lines.append(f"\n  {part.section}: {title}" if part.section else "")
        lines += [_entry(key, *entry) for key, entry in _described(part)]
    return "\n".join(lines)


def _sections(section: Any) -> Iterator[Any]:
    """A section, then the sections inside it."""
    yield section
    for item in fields(section):
        if is_dataclass(value := getattr(section, item.name)):
            yield from _sections(value)


def _described(section: Any) -> Iterator[tuple[str, tuple[Any, Declaration]]]:
    """Keys of a section as a user types them, each with its value and declaration."""
    prefix = f"{section.section}." if section.section else ""
    for item in fields(section):
        if (declared := Settings.by_key()[f"{prefix}{item.name}"].declared) is not None:
            yield f"{prefix}{item.name}", (getattr(section, item.name), declared)


def _entry(key: str, value: Any, declared: Declaration) -> str:
    """``key=value`` and its meaning, wrapped into two columns."""
    unit = f" [{declared.unit}]" if declared.unit else ""
    limits = declared.range_text()
    text = f"{declared.meaning}{unit}{f'; {limits}' if limits else ''}"
    left = f"  {key}={_shown(value)}"
    blank = " " * COLUMN
    lines = textwrap.wrap(text, WIDTH, initial_indent=blank, subsequent_indent=blank)
    if len(left) + 2 <= COLUMN:
        lines[0] = left + lines[0][len(left) :]
        return "\n".join(lines)
    return "\n".join([left, *lines])


def _shown(value: Any) -> str:
    """A value as it is typed, cut if it is long."""
    text = value if isinstance(value, str) else json.dumps(value, separators=(",", ":"))
    return text if len(text) <= 60 else f"{text[:57]}..."
