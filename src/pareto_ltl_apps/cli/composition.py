"""Hydra composes ``conf/`` once for each command; the checks and the run use the same configuration.

Errors of the user are detected here, before Hydra makes a directory, and give one line.
"""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra import version as hydra_version
from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.hydra import Hydra
from hydra._internal.utils import create_config_search_path, get_args_parser
from hydra.core.config_loader import ConfigLoader
from hydra.core.config_search_path import SearchPathQuery
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, RangeSweep
from hydra.core.plugins import Plugins
from hydra.errors import HydraException
from hydra.plugins.config_source import ConfigResult
from hydra.types import RunMode, TaskFunction
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from careful_io.error_lines import one_line
from careful_io.messages import shown_text
from careful_io.reading import Advice
from careful_io.yaml_files import read_yaml
from pareto_ltl import Settings, __version__
from pareto_ltl.extend import Pipeline
from pareto_ltl.support.errors import ConfigError, ParetoLtlError
from pareto_ltl.support.extras import EXTRAS
from pareto_ltl.support.resources import resource_folder
from pareto_ltl_apps.cli.arguments import HELP_FLAGS, CommandArguments
from pareto_ltl_apps.cli.setting_keys import refuse_unknown_key, settings_from
from pareto_ltl_apps.cli.wind_words import unread_wind_source, wind_file_words

VERSION_BASE = "1.3"
MAX_POINTS = 100_000  # of a sweep
CONFIG_NAME = "config"
LAUNCHER_EXTRAS = {
    "joblib": "sweep", "submitit_local": "cluster", "submitit_slurm": "cluster", "dask": "dask",
}  # fmt: skip
CONFIG_FILES = Advice("check its name and whether it may be read", "correct the file")


# --- flags and schema ------------------------------------------------------------------------


def parse_flags(argv: Sequence[str]) -> argparse.Namespace:
    """Hydra's flags, anywhere in ``argv``, and the overrides; ``help`` asks for the whole help."""
    parser = CommandArguments(
        prog="pareto-ltl", add_help=False, parents=[get_args_parser()], conflict_handler="resolve"
    )
    parser.add_argument("--version", action="version", version=f"pareto-ltl {__version__}")
    arguments = parser.parse_intermixed_args([word for word in argv if word not in HELP_FLAGS])
    arguments.help = any(word in HELP_FLAGS for word in argv)
    if arguments.config_dir is not None and not Path(arguments.config_dir).is_dir():
        raise ConfigError(f"--config-dir {arguments.config_dir}: there is no such folder")
    return arguments


def _refuse_environment(name: str, *_: object) -> str:
    raise ConfigError(
        f"${{oc.env:{shown_text(name)}}} would write a variable of the environment into the results; "
        "write its value"
    )


def register_schema() -> None:
    """Register the schema of the settings and the pipelines, which are in another folder, with Hydra."""
    OmegaConf.register_new_resolver("oc.env", _refuse_environment, replace=True)
    Plugins.instance()  # they register launchers ...
    store = ConfigStore.instance()
    if "settings.yaml" in store.repo:  # by an earlier run of this process: 0.1 s
        return
    launchers = store.repo.get("hydra", {}).get("launcher", {})
    for name in LAUNCHER_EXTRAS:
        launchers.pop(f"{name}.yaml", None)  # ... which conf/hydra/launcher replaces
    store.store(name="settings", node=Settings)
    for path in sorted(
        resource_folder("pipelines").glob("*.yaml")
    ):  # pipelines of other packages are on their search path
        store.store(group="pipelines", name=path.stem, node=OmegaConf.load(path))


# --- files of settings -----------------------------------------------------------------------


class BoundedFileSource(FileConfigSource):
    """A folder of YAML files; each is checked before OmegaConf loads it."""

    def load_config(self, config_path: str) -> ConfigResult:
        """The configuration of a file; raises DataError if it is not YAML or exceeds the limits."""
        path = Path(self.path) / self._normalize_file_name(config_path)
        if path.is_file():
            read_yaml(path, CONFIG_FILES)
        return super().load_config(config_path)


def bound_sources(loader: ConfigLoader) -> None:
    """Let ``loader`` read folders through :class:`BoundedFileSource`."""
    sources = loader.get_sources()
    for place, source in enumerate(sources):
        if source.scheme() == FileConfigSource.scheme():  # Hydra loads the module of the class a second time
            sources[place] = BoundedFileSource(source.provider, f"file://{source.path}")


@contextmanager
def described_composition() -> Iterator[None]:
    """Turn Hydra's errors for wrong files, e.g. defaults that are not a list, into a ConfigError."""
    try:
        yield
    except (ParetoLtlError, HydraException, OmegaConfBaseException, OSError):
        raise
    except RecursionError:
        raise ConfigError("the configuration is nested too deeply, or its defaults name each other") from None
    except Exception as error:
        raise ConfigError(
            f"the configuration cannot be composed ({one_line(error)}); check your configuration files"
        ) from error


# --- one composition -------------------------------------------------------------------------


class ComposedHydra(Hydra):
    """Hydra with one configuration: the first one composed serves the checks and the run."""

    composed: DictConfig | None = None

    def compose_config(self, *args: Any, **kwargs: Any) -> DictConfig:
        """Compose at the first call; return the same configuration at every other."""
        if self.composed is None:
            with described_composition():
                self.composed = super().compose_config(*args, **kwargs)
        return self.composed

    def print_help(self, name: str, arguments: argparse.Namespace) -> None:
        """Print the output of ``--hydra-help``."""
        self.hydra_help(name, get_args_parser(), arguments)


@contextmanager
def opened_hydra(arguments: argparse.Namespace) -> Iterator[ComposedHydra]:
    """Hydra with the shipped configuration folder and the folder of ``--config-dir``."""
    register_schema()
    hydra_version.setbase(VERSION_BASE)
    place = str(arguments.config_path or resource_folder("conf"))
    search = create_config_search_path(place if "://" in place else os.path.abspath(place))
    if arguments.config_dir is not None:
        search.prepend(
            provider="command-line",
            path=f"file://{os.path.abspath(arguments.config_dir)}",
            anchor=SearchPathQuery(provider="schema"),
        )
    hydra = ComposedHydra.create_main_hydra2("pareto_ltl", search)
    assert isinstance(hydra, ComposedHydra)
    bound_sources(hydra.config_loader)
    try:
        yield hydra
    finally:
        GlobalHydra.instance().clear()


def config_name(arguments: argparse.Namespace) -> str:
    """The primary configuration: ``config``, unless ``--config-name`` names another."""
    return str(arguments.config_name or CONFIG_NAME)


def composed_config(hydra: ComposedHydra, arguments: argparse.Namespace, mode: RunMode) -> DictConfig:
    """Compose the configuration of the command line; raises ConfigError for unknown keys before that."""
    arguments.overrides = wind_file_words(arguments.overrides)
    for override in parsed_overrides(hydra.config_loader, arguments.overrides):
        refuse_unknown_key(override, hydra.config_loader)

    def compose() -> DictConfig:
        return hydra.compose_config(
            config_name=config_name(arguments),
            overrides=list(arguments.overrides),
            run_mode=mode,
            with_log_configuration=True,
            from_shell=False,
        )

    config = compose()
    if (source := unread_wind_source(config, arguments.overrides)) is not None:
        arguments.overrides.append(f"wind={source}")
        hydra.composed = None
        config = compose()
    return config


# --- a run or a sweep, checked ---------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Prepared:
    """A run or a sweep, made and checked once.

    Attributes
    ----------
    config : DictConfig
        The composed configuration.
    pipeline : Pipeline or None
        Settings and stages of a run; None for a sweep, whose jobs make theirs.
    """

    config: DictConfig
    pipeline: Pipeline | None = None

    def start(self, hydra: ComposedHydra, name: str, job: TaskFunction) -> None:
        """Let Hydra call ``job``: for a run in its directory, which is locked for it, else for each point."""
        if self.pipeline is None:
            hydra.multirun(config_name=name, task_function=job, overrides=[])
            return
        directory = Path(str(self.config.hydra.run.dir))
        OmegaConf.update(self.config, "hydra.run.dir", str(directory))  # the same time of day in both
        with self.pipeline.claimed(directory):
            hydra.run(config_name=name, task_function=job, overrides=[])


def prepare(hydra: ComposedHydra, arguments: argparse.Namespace) -> Prepared:
    """Compose the configuration of the command line and run every check; nothing is written.

    For a sweep, the first and the last point are checked here; its sweeper checks all.
    """
    if arguments.run and arguments.multirun:
        raise ConfigError("--run and --multirun exclude each other; leave one out")
    overrides = parsed_overrides(hydra.config_loader, arguments.overrides)
    several = arguments.multirun or any(override.is_sweep_override() for override in overrides)
    config = composed_config(hydra, arguments, RunMode.MULTIRUN if several else RunMode.RUN)
    if arguments.multirun or config.hydra.mode == RunMode.MULTIRUN:
        return _prepare_sweep(hydra, arguments, config, overrides)
    _refuse_sweep(overrides)
    if own_grid := _grid_of(config):
        raise ConfigError(f"a sweep over {', '.join(own_grid)}: add -m to run it")
    checked = check_settings(settings_from(config))
    if not str(config.hydra.run.dir).strip():
        raise ConfigError("hydra.run.dir is empty: name a folder for the results, or leave it out")
    if config.hydra.mode is None:
        _pin(config, "hydra.mode", RunMode.RUN.name)
    return Prepared(config, checked)


def check_settings(settings: Settings) -> Pipeline:
    """The pipeline of ``settings``, checked across sections; each section was checked when it was made."""
    return Pipeline.of(settings)


def _prepare_sweep(
    hydra: ComposedHydra, arguments: argparse.Namespace, config: DictConfig, overrides: Sequence[Override]
) -> Prepared:
    _check_launcher(config)
    grid = [*parsed_overrides(hydra.config_loader, _grid_of(config)), *overrides]
    grid = list({override.get_key_element(): override for override in grid}.values())  # the last one counts
    _check_sweep_size(grid)
    ends, names = [_ends_of(override) for override in grid], []
    for end in (0, 1):
        words = [pair[end] for pair in ends]
        with described_composition():
            point = hydra.config_loader.load_configuration(
                config_name(arguments), words, RunMode.RUN, from_shell=False
            )
        settings = settings_from(point)
        check_settings(settings)
        names.append(settings.name)
    # All jobs have one folder, also if their names differ.
    sweep: Any = OmegaConf.to_container(config.hydra.sweep, resolve=False)
    place = str(sweep["dir"])  # with ${name} still in it
    place = place.replace("${name}", "-".join(dict.fromkeys(names)))
    _pin(config, "hydra.sweep.dir", place, written=f"'{place}'")
    if config.hydra.mode != RunMode.MULTIRUN:
        _pin(config, "hydra.mode", RunMode.MULTIRUN.name)
    return Prepared(config)


def _pin(config: DictConfig, key: str, value: str, written: str | None = None) -> None:
    """Set a value of Hydra in the composed configuration, and for the jobs of a sweep."""
    OmegaConf.update(config, key, value)
    config.hydra.overrides.hydra.append(f"{key}={written or value}")


def _check_launcher(config: DictConfig) -> None:
    """Raise ConfigError for a launcher that is not installed; the message says what to install."""
    module = str(config.hydra.launcher.get("_target_")).rpartition(".")[0]
    name = config.hydra.runtime.choices.get("hydra/launcher")
    with suppress(ModuleNotFoundError):
        if find_spec(module) is not None:
            return
    if name in LAUNCHER_EXTRAS:
        raise ConfigError(
            f"hydra/launcher={name} is not installed: {EXTRAS.install_command(LAUNCHER_EXTRAS[name])}"
        )


# --- overrides -------------------------------------------------------------------------------


def parsed_overrides(loader: ConfigLoader, words: Sequence[str]) -> list[Override]:
    """``words`` as Hydra reads them; raises ConfigError for a number with more digits than Python reads."""
    for word in words:
        if re.search(r"\d{1000}", word):  # Python reads no number of more than 4,300 digits
            raise ConfigError(f"{shown_text(word)}: the number has too many digits for a setting")
    return OverridesParser.create(config_loader=loader).parse_overrides(list(words))


def _grid_of(config: DictConfig) -> list[str]:
    """The grid of a sweep in the configuration, as words of a command line."""
    grid = OmegaConf.select(config, "hydra.sweeper.params") or {}
    return [f"{key}={value}" for key, value in grid.items()]


def _check_sweep_size(grid: Sequence[Override]) -> None:
    """Raise ConfigError for a grid of more than ``MAX_POINTS`` points, before its points are listed."""
    points = math.prod(_sweep_length(override) for override in grid if override.is_discrete_sweep())
    if points > MAX_POINTS:
        raise ConfigError(
            f"the sweep has {points:g} points, expected at most {MAX_POINTS}: sweep fewer values"
        )


def _sweep_length(override: Override) -> int:
    """Number of values of a discrete sweep."""
    sweep = override.value()
    if isinstance(sweep, RangeSweep) and sweep.start is not None and sweep.stop is not None and sweep.step:
        return max(0, math.ceil((sweep.stop - sweep.start) / sweep.step))
    return sum(1 for _ in override.sweep_string_iterator())


def _ends_of(override: Override) -> tuple[str, str]:
    """The words that set the first and the last value of a sweep; the same words for one value."""
    if not override.is_sweep_override():
        return _words_of(override), _words_of(override)
    if not override.is_discrete_sweep():
        raise ConfigError(f"{_words_of(override)}: an interval cannot be swept; use range(first,beyond,step)")
    values = list(override.sweep_string_iterator())
    if not values:
        raise ConfigError(f"{_words_of(override)} has no value to sweep")
    key = override.get_key_element()
    return f"{key}={values[0]}", f"{key}={values[-1]}"


def _words_of(override: Override) -> str:
    assert override.input_line is not None
    return override.input_line


def _refuse_sweep(overrides: Sequence[Override]) -> None:
    for override in overrides:
        if override.is_sweep_override():
            key, value = override.get_key_element(), override.get_value_string()
            raise ConfigError(
                f"{key}={value} has several values: add -m to run each, or write a list as {key}=[{value}]"
            )
