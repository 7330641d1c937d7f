"""The Hydra form of the command line: settings and choices that give a run, a sweep or a listing of them."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from careful_io.error_lines import one_line
from pareto_ltl import Run
from pareto_ltl.extend import Pipeline, ProgressBar
from pareto_ltl.support.errors import ConfigError, DataError, FormulaError, InfeasibleError
from pareto_ltl_apps.cli.command_table import COMMANDS, PIPELINE_COMMANDS
from pareto_ltl_apps.cli.composition import (
    ComposedHydra,
    check_settings,
    composed_config,
    config_name,
    opened_hydra,
    parse_flags,
    prepare,
)
from pareto_ltl_apps.cli.output import (
    Answer,
    Output,
    Tell,
    answered,
    collected_warnings,
    print_problem,
    run_reported,
)
from pareto_ltl_apps.cli.setting_keys import CONFIGURATION_ERRORS, explain_error, settings_from
from pareto_ltl_apps.stopping import ends_process
from pareto_ltl_apps.studies.settings import SweepConfig

if TYPE_CHECKING:
    from pareto_ltl import Settings
    from pareto_ltl_apps.studies.sweep_summary import SweepSummary


SETTINGS_WORDS = {"sweep", *(command.name for command in PIPELINE_COMMANDS)}  # settings follow these commands


def run_hydra(argv: Sequence[str], command: str | None = None, output: Output = Output.TEXT) -> int:
    """Run the command line ``argv`` after ``command``; return the exit code.

    A command with the name of a pipeline selects it; ``sweep`` is ``-m``.
    """
    return run_reported(
        lambda: _run_arguments(argv, command, output), CONFIGURATION_ERRORS, explain_error, output
    )


def run_accepted(argv: Sequence[str], command: str, accept: Callable[[Settings], None]) -> int:
    """Like :func:`run_hydra` for one run, whose composed settings ``accept`` refuses with a ConfigError.

    There are no flags, and nothing is written before ``accept`` has returned.
    """

    def run() -> int:
        arguments = parse_flags([])
        arguments.overrides = list(argv)
        apply_command(arguments, command)
        typed = [command, *argv]
        return answered(partial(_answer_of_jobs, arguments, typed, Output.TEXT, accept=accept), Output.TEXT)

    return run_reported(run, CONFIGURATION_ERRORS, explain_error, Output.TEXT)


def _run_arguments(argv: Sequence[str], command: str | None, output: Output) -> int:
    arguments = parse_flags(argv)
    apply_command(arguments, command)
    if arguments.help:
        _print_full_help(arguments)
        return 0
    if arguments.shell_completion:
        return complete_shell(arguments)
    if arguments.hydra_help or arguments.cfg or arguments.info:
        with opened_hydra(arguments) as hydra:
            _show_configuration(hydra, arguments)
        return 0
    if arguments.experimental_rerun is not None:
        raise ConfigError("--experimental-rerun runs code from a file; use pareto-ltl rerun DIR")
    typed = [command, *argv] if command else list(argv)
    return answered(partial(_answer_of_jobs, arguments, typed, output), output)


def _answer_of_jobs(
    arguments: argparse.Namespace,
    typed: Sequence[str],
    output: Output,
    tell: Tell,
    accept: Callable[[Settings], None] | None = None,
) -> Answer:
    """The answer of a run, or of all jobs of a sweep; with ``accept``, of a run that it does not refuse."""
    with opened_hydra(arguments) as hydra:
        prepared = prepare(hydra, arguments)
        if accept is not None:
            if prepared.pipeline is None:
                raise ConfigError("a sweep cannot be run here; use the command line")
            accept(prepared.pipeline.settings)
        tell_single = None if prepared.pipeline is None else tell
        job = HydraJob(tuple(typed), tuple(arguments.overrides), prepared.pipeline, output, tell_single)
        prepared.start(hydra, config_name(arguments), job)
    return replace(job.answer, code=max(job.codes, default=0))


def apply_command(arguments: argparse.Namespace, command: str | None) -> None:
    """Add the setting or flag of ``command`` to ``arguments``; ConfigError if they set another pipeline."""
    if command == "sweep":
        arguments.multirun = True
    elif command is not None:
        other = next(
            (word for word in arguments.overrides if word.lstrip("+").startswith("pipelines=")), None
        )
        if other is not None:
            raise ConfigError(f"pareto-ltl {command} sets the pipeline itself; leave out {other}")
        arguments.overrides = [f"pipelines={command}", *arguments.overrides]


def _print_full_help(arguments: argparse.Namespace) -> None:
    from pareto_ltl_apps.cli.help_text import full_help, group_choices

    groups = group_choices(arguments.config_path, arguments.config_dir)
    with opened_hydra(arguments) as hydra:
        settings = settings_from(composed_config(hydra, arguments, RunMode.MULTIRUN))
    print(full_help(settings, groups))


def _show_configuration(hydra: ComposedHydra, arguments: argparse.Namespace) -> None:
    """Print the output of ``--hydra-help``, ``--cfg`` or ``--info``."""
    name = config_name(arguments)
    if arguments.hydra_help:
        hydra.print_help(name, arguments)
    elif arguments.cfg:
        hydra.show_cfg(name, arguments.overrides, arguments.cfg, arguments.package, arguments.resolve)
    else:
        hydra.show_info(arguments.info, name, arguments.overrides)


# --- tab completion --------------------------------------------------------------------------


def complete_shell(arguments: argparse.Namespace) -> int:
    """Install, remove or answer tab completion: ``-sc install=bash``, ``-sc query=bash``; return 0."""
    requested = [word.partition("=")[0] for word in arguments.overrides]
    if requested not in (["install"], ["uninstall"], ["query"]):
        raise ConfigError(
            "-sc needs install=SHELL, uninstall=SHELL or query=SHELL; SHELL is bash, zsh or fish"
        )
    sys.argv[:1] = ["pareto-ltl"]  # the program that Hydra completes, also under python -m
    if requested != ["query"]:
        with opened_hydra(arguments) as hydra:
            hydra.shell_completion(config_name(arguments), arguments.overrides)
        return 0
    with suppress(*CONFIGURATION_ERRORS):  # a line that cannot be read has no completion
        _complete_line(arguments)
    return 0


def _complete_line(arguments: argparse.Namespace) -> None:
    """Print the words that can follow the line in ``COMP_LINE``."""
    line = os.environ.get("COMP_LINE", "")
    words = line.split()[1:]
    last = words.pop() if words and not line.endswith(" ") else ""
    if not words:
        found = [command.name for command in COMMANDS if command.name.startswith(last)]
        print("\n".join(found))
    elif words[0] in SETTINGS_WORDS:
        words = words[1:]
    elif words[0] in {command.name for command in COMMANDS}:
        return
    typed = parse_flags(words)
    mode = ["-m"] if typed.multirun else []
    os.environ["COMP_LINE"] = " ".join(["pareto-ltl", *mode, *typed.overrides, last])
    arguments.config_dir = typed.config_dir
    with opened_hydra(arguments) as hydra:
        hydra.shell_completion(config_name(arguments), arguments.overrides)


# --- jobs ------------------------------------------------------------------------------------


@dataclass
class HydraJob:
    """The function that Hydra calls for each run, in this process or, pickled, in another.

    Attributes
    ----------
    argv, overrides : tuple of str
        The command line as typed, and the settings that all jobs share.
    pipeline : Pipeline or None
        The checked pipeline of a single run; None if each job makes one from its configuration.
    output : Output
        What is printed.
    tell : callable or None
        Prints the answer of a single run before its figures are drawn.
    answer : Answer
        The result of a single run, or of all jobs of a sweep once they have ended.
    codes : list of int
        Exit codes of the jobs so far.
    process : int
        The process of the command line; a launcher may call the job in another.
    """

    argv: tuple[str, ...]
    overrides: tuple[str, ...] = ()
    pipeline: Pipeline | None = None
    output: Output = Output.TEXT
    tell: Tell | None = None
    answer: Answer = field(default_factory=partial(Answer, {}))
    codes: list[int] = field(default_factory=list)
    process: int = field(default_factory=os.getpid)

    def __call__(self, config: DictConfig) -> int:
        """Run one job in the directory that Hydra made; return its exit code."""
        one_of_many = not OmegaConf.is_missing(HydraConfig.get().job, "num")
        with nullcontext() if self.process == os.getpid() else ends_process():
            code = self._sweep_job(config) if one_of_many else self._single_job(config)
        self.codes.append(code)
        return code

    def finish(self, found: SweepSummary) -> None:
        """Set the answer of a sweep; its code is 0 if all jobs have answers ("infeasible" is one), else 2."""
        self.codes[:] = [0 if set(found.counts) <= {"ok", "infeasible"} else 2]
        from pareto_ltl_apps.cli.summary import sweep_answer

        self.answer = sweep_answer(found, found.place / "summary.html")

    def _single_job(self, config: DictConfig) -> int:
        from pareto_ltl_apps.cli.summary import run_answer

        directory = Path(HydraConfig.get().runtime.output_dir)
        shown, told = _relative_path(directory), list[Answer]()
        try:
            checked = self.pipeline or check_settings(settings_from(config))
            quiet = ProgressBar(shown=False) if self.output is Output.QUIET else None
            run = Run(checked.settings, directory=directory, progress=quiet)
            answer_of = partial(run_answer, run, shown, verbose=self.output is Output.VERBOSE)
            with collected_warnings() as warnings:

                def tell(metrics: dict[str, float]) -> None:
                    if self.tell is None:
                        return
                    with suppress(*CONFIGURATION_ERRORS):  # reported at the end, when the result is whole
                        answer = answer_of(metrics, tuple(warnings), drawn=False)
                        self.tell(answer)
                        told.append(answer)

                metrics = checked.complete(run, self.argv, _task_overrides(), tell)
        except Exception as error:
            before_stages = isinstance(error, ConfigError | DataError | FormulaError)
            gone = before_stages and not _chosen_directory() and Pipeline.discarded(directory)
            line, code = _failure(error, shown, kept=not gone)
            print_problem(line)
            self.answer = Answer({"error": line})
            return code
        if told:
            self.answer = told[0]
            for line in warnings[len(self.answer.document["warnings"]) :]:  # of figures and page
                print(f"Warning: {line}")
            return 0
        try:
            self.answer = answer_of(metrics, warnings)
        except CONFIGURATION_ERRORS as error:  # a disk that fails when tables are read back
            line = f"the result in {shown} is whole, but not its summary: {explain_error(error)}"
            print_problem(line)
            self.answer = Answer({"error": line})
            return 2
        return 0

    def _sweep_job(self, config: DictConfig) -> int:
        """Run one job of a sweep, unless it has its answer; print one line about it."""
        from pareto_ltl_apps.studies.jobs import RunJob

        directory = Path(HydraConfig.get().runtime.output_dir)
        varied = [word for word in _task_overrides() if word not in self.overrides]
        reported = ", ".join(varied) or str(config.get("name"))
        try:
            checked = check_settings(settings_from(config))
            metrics: dict[str, float] = {}

            def work() -> None:
                run = Run(checked.settings, directory=directory)
                metrics.update(checked.complete(run, self.argv, _task_overrides()))

            done = RunJob(directory).do_once(work, resume=checked.settings[SweepConfig].resume)
            ended = f"ok in {metrics['run_seconds']:.1f} s" if done else "done already"
            print(f"{reported}: {ended}", flush=True)
        except InfeasibleError:
            print(f"{reported}: infeasible", flush=True)  # an answer; the table has the reason
        except Exception as error:
            line, code = _failure(error, _relative_path(directory))
            print_problem(f"{reported}: {line}")
            return code
        return 0


def _failure(error: Exception, place: Path, *, kept: bool = True) -> tuple[str, int]:
    """The line for an error of a run in ``place``, and its exit code; ``kept``: whether ``place`` remains."""
    if isinstance(error, CONFIGURATION_ERRORS):
        return f"{explain_error(error)} [{place}]" if kept else explain_error(error), 2
    return f"{one_line(error)} (this is a bug; the traceback is in {place / 'run.log'})", 1


def _chosen_directory() -> bool:
    """Whether the command line names the directory of the results."""
    return any(str(word).startswith("hydra.run.dir") for word in HydraConfig.get().overrides.hydra)


def _task_overrides() -> list[str]:
    """The overrides of this run, without the overrides of Hydra."""
    return [str(word) for word in HydraConfig.get().overrides.task]


def _relative_path(directory: Path) -> Path:
    """``directory`` relative to the folder of the command line; absolute if Hydra has changed the folder."""
    here = Path.cwd()
    if not here.samefile(HydraConfig.get().runtime.cwd):
        return directory
    return directory.relative_to(here) if directory.is_relative_to(here) else directory
