"""The border with Hydra: a command line becomes :class:`Settings`, and nothing past this file knows how.

Hydra composes ``conf/`` and makes the directories. What a user can get wrong is checked before it does,
so that a mistake costs one line, a second and no directory.
"""

from __future__ import annotations

import argparse
import difflib
import os
import re
import sys
import tempfile
import textwrap
import traceback
import typing
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

from hydra import compose, initialize_config_dir
from hydra import main as hydra_main
from hydra._internal.utils import get_args_parser
from hydra.core.config_loader import ConfigLoader
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from pareto_ltl.cli.summary import print_summary
from pareto_ltl.run import pipeline
from pareto_ltl.run.provenance import one_line
from pareto_ltl.settings import Settings
from pareto_ltl.support.errors import ConfigError, DataError, InfeasibleError, ParetoLtlError
from pareto_ltl.support.resources import choices, folder, groups

VERSION_BASE = "1.3"
LAUNCHERS = {"joblib": "sweep", "submitit_local": "cluster", "submitit_slurm": "cluster"}  # and their extras
GROUPS_ONLY = ("experiment", "sweep")  # groups that are no section of the settings
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")  # it names a folder
HELP = """\
Risk-aware temporal-logic mission planning in uncertain wind, without position fixes.

Usage
  pareto-ltl +experiment=phi1                              plan one of the ready missions
  pareto-ltl +experiment=phi2 planner.n_max=5000           with another setting
  pareto-ltl +experiment=phi1 "mission.formula='F(a & F b)'"
  pareto-ltl -m +experiment=phi2 +sweep=seeds              many runs, one table
  pareto-ltl -m +experiment=phi2 'seed=range(0,99)' hydra/launcher=joblib
  pareto-ltl rerun DIR                                     the same again, compared byte by byte
  pareto-ltl cache clear                                   forget fits of the wind
  pareto-ltl pipelines=ingest wind=grib wind.path=DIR      a wind table out of GRIB2 files
  pareto-ltl formula "F(a & F b)"                          what a formula means

Choices (group=option; +experiment=option, +sweep=option)
{choices}

Settings (key=value)
{settings}

Flags
  -m              run every combination of key=value1,value2 or key=range(first,beyond)
  --config-dir    a folder with choices of your own
  --cfg job       show the settings that a command line comes to, and run nothing
  --version       the version
  --hydra-help    Hydra's own flags"""
QUOTES = "a value with spaces or ( ) & | ! needs two pairs of quotes: \"mission.formula='F(a & F b)'\""


def main(argv: Sequence[str]) -> int:
    """Do what the command line asks for; return the exit code."""
    try:
        register()
        arguments = parse(argv)
        if arguments.help:
            print(help_text(arguments))
            return 0
        pinned = validate(arguments) if runs(arguments) else []
        return launch(argv, pinned)
    except (ParetoLtlError, HydraException, OmegaConfBaseException, OSError) as error:
        complain(explain(error))
        return 2
    except KeyboardInterrupt:
        complain("interrupted")
        return 130
    except Exception as error:
        complain(f"{one_line(error)} (this is a bug; the traceback is in {_traceback_file()})")
        return 1


def help_text(arguments: argparse.Namespace) -> str:
    """Usage, choices and settings. Ours, because listing the groups takes Hydra half a second."""
    with initialize_config_dir(str(folder("conf")), version_base=VERSION_BASE):
        settings = OmegaConf.to_yaml(compose("config", list(arguments.overrides)))
    lines = [f"  {group}: {', '.join(choices(group))}" for group in groups()]
    return HELP.format(choices="\n".join(lines), settings=textwrap.indent(settings.strip(), "  "))


def complain(line: str) -> None:
    print(f"pareto-ltl: {line}", file=sys.stderr)


def _traceback_file() -> str:
    """Where the traceback went of an error outside any results directory."""
    handle, path = tempfile.mkstemp(prefix="pareto_ltl_", suffix=".log")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(traceback.format_exc())
    return path


# --- schema and pipelines --------------------------------------------------------------------


def register() -> None:
    """Tell Hydra of the schema, and of the pipelines, which live in a folder of their own."""
    Plugins.instance()  # they bring their own settings along ...
    store = ConfigStore.instance()
    launchers = store.repo.get("hydra", {}).get("launcher", {})
    for name in LAUNCHERS:
        launchers.pop(f"{name}.yaml", None)  # ... for which there are better ones in conf/hydra/launcher
    store.store(name="settings", node=Settings)
    for name in choices("pipelines"):
        store.store(group="pipelines", name=name, node=OmegaConf.load(folder("pipelines") / f"{name}.yaml"))


# --- checks before anything is made ----------------------------------------------------------


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Hydra's own flags and the overrides; what cannot be read is refused in one line."""
    parser = get_args_parser()

    def refuse(message: str) -> NoReturn:
        raise ConfigError(f"{message}; --help shows what there is")

    parser.error = refuse  # type: ignore[method-assign]
    return parser.parse_args(list(argv))


def runs(arguments: argparse.Namespace) -> bool:
    """Whether stages will run, as against help or a look at the configuration."""
    shows = (arguments.help, arguments.hydra_help, arguments.cfg, arguments.info, arguments.shell_completion)
    return not any(shows) and arguments.experimental_rerun is None


def validate(arguments: argparse.Namespace) -> list[str]:
    """Compose what was asked for and run every check; of a sweep, for its first point and its last.

    Returns the overrides that keep all jobs of a sweep in one folder, whatever their names.
    """
    place = os.path.abspath(arguments.config_path) if arguments.config_path else str(folder("conf"))
    name = arguments.config_name or "config"
    with initialize_config_dir(place, version_base=VERSION_BASE):
        loader = GlobalHydra.instance().config_loader()
        search = _search_path(arguments.config_dir)
        overrides = OverridesParser.create(config_loader=loader).parse_overrides(arguments.overrides)
        for override in overrides:
            _refuse_unknown(override, loader)
        config = compose(name, search + _corner(overrides, first=True), return_hydra_config=True)
        if not (arguments.multirun or config.hydra.mode == RunMode.MULTIRUN):
            _refuse_sweep(overrides)
            if grid_of_its_own := _sweep_of(config):
                raise ConfigError(f"a sweep over {', '.join(grid_of_its_own)}: add -m to run it")
            check(settings_of(config))
            return []
        _check_launcher(config)
        folder_of_sweep = str(config.hydra.sweep._get_node("dir")._value())  # with ${name} still in it
        grid = OverridesParser.create(config_loader=loader).parse_overrides(_sweep_of(config)) + overrides
        grid = list(
            {override.get_key_element(): override for override in grid}.values()
        )  # the last word counts
        corners = [settings_of(compose(name, search + _corner(grid, first=first))) for first in (True, False)]
    for settings in corners:
        check(settings)
    names = "-".join(dict.fromkeys(settings.name for settings in corners))
    return [f"hydra.sweep.dir='{folder_of_sweep.replace('${name}', names)}'"]


def check(settings: Settings) -> None:
    """Checks across sections; those of one section ran when the settings were made."""
    if not NAME.fullmatch(settings.name):
        raise ConfigError(
            "name must be letters, digits, dots, dashes or underscores (it names a folder), "
            f"got {settings.name!r}"
        )
    pipeline.check(settings)


def settings_of(config: DictConfig) -> Settings:
    """The composed configuration as plain settings, which checks types and ranges."""
    if "hydra" in config:
        with open_dict(config):
            del config["hydra"]
    _refuse_extra(config, Settings, "")
    settings = OmegaConf.to_object(config)
    assert isinstance(settings, Settings)
    return settings


def _check_launcher(config: DictConfig) -> None:
    """A launcher that is not installed, in one line that says what to install."""
    module = str(config.hydra.launcher.get("_target_")).rpartition(".")[0]
    name = config.hydra.runtime.choices.get("hydra/launcher")
    try:
        found = find_spec(module) is not None
    except ModuleNotFoundError:
        found = False
    if not found and name in LAUNCHERS:
        raise ConfigError(
            f"hydra/launcher={name} is not installed; "
            f"it comes with pip install 'pareto-ltl[{LAUNCHERS[name]}]'"
        )


def read_settings(path: Path) -> Settings:
    """The settings that a run left in its ``config_resolved.yaml``."""
    try:
        config = OmegaConf.merge(OmegaConf.structured(Settings), OmegaConf.load(path))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); is this a results directory?") from error
    except Exception as error:
        raise DataError(f"{path}: not the settings of a run ({explain(error)})") from error
    assert isinstance(config, DictConfig)
    return settings_of(config)


def _search_path(config_dir: str | None) -> list[str]:
    if config_dir is None:
        return []
    if not Path(config_dir).is_dir():
        raise ConfigError(f"--config-dir {config_dir}: there is no such folder")
    return [f"hydra.searchpath=['file://{os.path.abspath(config_dir)}']"]


def _corner(overrides: Sequence[Override], *, first: bool) -> list[str]:
    """The first or the last point of the grid that ``overrides`` span."""
    return [
        _end(override, first=first) if override.is_sweep_override() else _line(override)
        for override in overrides
    ]


def _end(override: Override, *, first: bool) -> str:
    if not override.is_discrete_sweep():
        raise ConfigError(f"{_line(override)}: an interval cannot be swept; use range(first,beyond,step)")
    values = list(override.sweep_string_iterator())
    if not values:
        raise ConfigError(f"{_line(override)} holds no value to sweep")
    return f"{override.get_key_element()}={values[0 if first else -1]}"


def _line(override: Override) -> str:
    assert override.input_line is not None
    return override.input_line


def _sweep_of(config: DictConfig) -> list[str]:
    """The grid a configuration carries itself."""
    grid = OmegaConf.select(config, "hydra.sweeper.params") or {}
    return [f"{key}={value}" for key, value in grid.items()]


def _refuse_sweep(overrides: Sequence[Override]) -> None:
    for override in overrides:
        if override.is_sweep_override():
            key, value = override.get_key_element(), override.get_value_string()
            raise ConfigError(
                f"{key}={value} is several values: add -m to run each, or write a list as {key}=[{value}]"
            )


def _refuse_unknown(override: Override, loader: ConfigLoader) -> None:
    """Refuse a key that is no setting and no group, with what may have been meant."""
    key = override.key_or_group
    if key == "hydra" or override.is_hydra_override() or loader.get_group_options(key):
        return
    known: Any = Settings
    section = ""
    for part in key.split("."):
        if not is_dataclass(known):
            return  # inside a mapping or a list: values are checked when they are merged
        types = typing.get_type_hints(known)
        if part not in types:
            groups = [] if section else [name for name in GROUPS_ONLY if loader.get_group_options(name)]
            raise _unknown(section, part, [*types, *groups])
        known, section = types[part], f"{section}{part}."


def _refuse_extra(config: DictConfig, schema: Any, section: str) -> None:
    """Refuse keys that the schema lacks, wherever they came from: Hydra lets ``+`` and files add them."""
    types = typing.get_type_hints(schema)
    for key in config:
        if key not in types:
            raise _unknown(section, str(key), list(types))
        inner = config._get_node(key)
        if is_dataclass(types[str(key)]) and isinstance(inner, DictConfig):
            _refuse_extra(inner, types[str(key)], f"{section}{key}.")


def _unknown(section: str, part: str, known: list[str]) -> ConfigError:
    near = difflib.get_close_matches(part, known, n=1)
    hint = f"did you mean {section}{near[0]}?" if near else f"there are {', '.join(known)}"
    return ConfigError(f"unknown setting {section}{part}; {hint}")


# --- one line for every way to be wrong ------------------------------------------------------


def explain(error: BaseException) -> str:
    """What was wrong, in one line."""
    if isinstance(error, MissingConfigException) and error.options:
        group, _, choice = (error.missing_cfg_file or "").rpartition("/")
        return f"there is no {group.removesuffix('s')} {choice!r}; there are {', '.join(error.options)}"
    if isinstance(error, OverrideParseException):
        return f"cannot read {error.override!r} ({_first_line(error)}); {QUOTES}"
    if isinstance(error, MissingMandatoryValue):
        return f"a setting is missing: {_first_line(error)}"
    if isinstance(error, HydraException) and isinstance(error.__cause__, OmegaConfBaseException):
        return f"{_key(error.__cause__) or _first_line(error)}: {_first_line(error.__cause__)}"
    if isinstance(error, OmegaConfBaseException):
        return f"{_key(error)}: {_first_line(error)}" if _key(error) else _first_line(error)
    if isinstance(error, HydraException):
        return " ".join(str(error).split("full_key:")[0].split())
    return one_line(error)


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    return lines[0].strip() if lines else type(error).__name__


def _key(error: OmegaConfBaseException) -> str:
    return str(getattr(error, "full_key", None) or "")


# --- the run ---------------------------------------------------------------------------------


def launch(argv: Sequence[str], pinned: Sequence[str] = ()) -> int:
    """Hand over to Hydra, which calls back once a job; return the worst exit code."""
    job = Job(tuple(argv))
    with _as_program([*argv, *pinned]):
        hydra_main(config_path=str(folder("conf")), config_name="config", version_base=VERSION_BASE)(job)()
    return max(job.codes, default=0)


@dataclass
class Job:
    """What Hydra calls for each run, in this process or, pickled, in another."""

    argv: tuple[str, ...]
    codes: list[int] = field(default_factory=list)

    def __call__(self, config: DictConfig) -> int:
        one_of_many = not OmegaConf.is_missing(HydraConfig.get().job, "num")
        code = (run_once if one_of_many else run)(config, self.argv)
        self.codes.append(code)
        return code

    def finish(self, counts: Mapping[str, int]) -> None:
        """A sweep succeeds when all its jobs have an answer, be it that there is no plan."""
        self.codes[:] = [0 if set(counts) <= {"ok", "infeasible"} else 2]


@contextmanager
def _as_program(argv: Sequence[str]) -> Iterator[None]:
    """Hydra reads ``sys.argv``; told to, it raises errors instead of printing them and leaving."""
    kept, full = sys.argv, os.environ.get("HYDRA_FULL_ERROR")
    sys.argv = ["pareto-ltl", *argv]
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        yield
    finally:
        sys.argv = kept
        os.environ.pop("HYDRA_FULL_ERROR")
        if full is not None:
            os.environ["HYDRA_FULL_ERROR"] = full


def run(config: DictConfig, argv: Sequence[str]) -> int:
    """One job in the directory that Hydra made for it."""
    directory = Path(HydraConfig.get().runtime.output_dir)
    shown = _short(directory)
    try:
        settings = settings_of(config)
        check(settings)
        metrics = pipeline.run(settings, directory, argv, _overrides())
    except (ParetoLtlError, OmegaConfBaseException, OSError) as error:
        complain(f"{explain(error)} [{shown}]")
        return 2
    except Exception as error:
        complain(f"{one_line(error)} (this is a bug; the traceback is in {shown / 'run.log'})")
        return 1
    print_summary(settings.name, shown, metrics)
    return 0


def run_once(config: DictConfig, argv: Sequence[str]) -> int:
    """One job of a sweep, unless it has its answer; one line about it."""
    from pareto_ltl.studies.sweeps.runs import RunJob

    directory = Path(HydraConfig.get().runtime.output_dir)
    told = ", ".join(word for word in _overrides() if word not in argv) or settings_name(config)
    try:
        settings = settings_of(config)
        metrics: dict[str, float] = {}

        def work() -> None:
            metrics.update(pipeline.run(settings, directory, argv, _overrides()))

        done = RunJob(directory).do_once(work, resume=settings.sweep.resume)
        print(f"{told}: " + (f"ok in {metrics['run_seconds']:.1f} s" if done else "done already"), flush=True)
    except InfeasibleError:
        print(f"{told}: infeasible", flush=True)  # an answer; the table says why
    except (ParetoLtlError, OmegaConfBaseException, OSError) as error:
        complain(f"{told}: {explain(error)} [{_short(directory)}]")
        return 2
    except Exception as error:
        log = _short(directory) / "run.log"
        complain(f"{told}: {one_line(error)} (this is a bug; the traceback is in {log})")
        return 1
    return 0


def settings_name(config: DictConfig) -> str:
    return str(config.get("name"))


def _overrides() -> list[str]:
    """What this run's settings were made from, apart from Hydra's own."""
    return [str(word) for word in HydraConfig.get().overrides.task]


def _short(directory: Path) -> Path:
    here = Path.cwd()
    return directory.relative_to(here) if directory.is_relative_to(here) else directory
