"""The sweeper: a grid becomes points with names, and points without a result go to a launcher.

Hydra's basic sweeper runs every point again. This one names each point by the fingerprint of its settings, so
that it knows which are done; it checks every point before it makes a directory, and continues after jobs or
launches that were killed (``pareto_ltl_apps.studies.jobs``). This module holds what needs Hydra.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.core.config_loader import ConfigLoader
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override, OverrideType
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn, JobStatus
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict
from omegaconf.errors import OmegaConfBaseException

from pareto_ltl_apps.studies.settings import SweepConfig

if TYPE_CHECKING:
    from pareto_ltl_apps.studies.sweep_summary import SweepSummary
    from pareto_ltl_apps.studies.sweeps import SweepManifest

SWEEP_LOCK = ".sweep.lock"
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class PointsSweeper(Sweeper):
    """Runs the points of a grid that have no answer yet.

    ``max_batch_size`` jobs are given to the launcher at once, None: all; ``params`` is a grid in the
    configuration, key to values.
    """

    def __init__(self, max_batch_size: int | None, params: Mapping[str, str] | None) -> None:
        self.max_batch_size, self.params = max_batch_size, params or {}

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Keep what Hydra hands over before the sweep."""
        self.loader, self.config, self.task_function = hydra_context.config_loader, config, task_function
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> Any:
        """Check all points, run those without a result, write the summary."""
        from careful_io.locks import claim_folder

        assert self.config is not None
        place = Path(str(self.config.hydra.sweep.dir))
        manifest, words, resume = self._points(arguments)
        another = "give this one another folder with hydra.sweep.dir=FOLDER"
        with claim_folder(place / SWEEP_LOCK, "a sweep", another):
            manifest.write_to(place)
            OmegaConf.save(self.config, place / "multirun.yaml")
            found = self._run_points(place, manifest, words, resume=resume)
        self.task_function.finish(found)  # type: ignore[attr-defined]
        return []

    def _points(self, arguments: list[str]) -> tuple[SweepManifest, dict[str, list[str]], bool]:
        """The points of the grid, the words that Hydra composes each from, and whether to keep answers."""
        from pareto_ltl.run.provenance import config_hash
        from pareto_ltl_apps.cli.composition import check_settings
        from pareto_ltl_apps.cli.setting_keys import settings_from
        from pareto_ltl_apps.studies.jobs import KEY_DIGITS
        from pareto_ltl_apps.studies.sweep_summary import check_figure
        from pareto_ltl_apps.studies.sweeps import FigureChoice, SweepManifest, SweepPoint

        assert self.config is not None
        overrides = self._overrides(arguments)
        swept = {key for key, values in overrides.items() if len(values) > 1}
        words: dict[str, list[str]] = {}
        points: list[SweepPoint] = []
        compose = point_composer(self.loader, self.config)
        for line in map(list, product(*overrides.values())):
            settings = settings_from(compose(line))
            check_settings(settings)
            job = config_hash(settings)[:KEY_DIGITS]
            if job not in words:  # two ways to write the same settings are one job
                words[job] = [*line, f"hydra.sweep.subdir='{job}'"]
                points.append(SweepPoint(job, _swept_values(line, swept)))
        figure = FigureChoice(settings[SweepConfig].x, settings[SweepConfig].y, settings[SweepConfig].by)
        names = tuple(_plain_key(key) for key in overrides if key in swept)
        fixed = tuple(values[0] for key, values in overrides.items() if key not in swept)
        check_figure(figure, names)
        return SweepManifest(tuple(points), names, fixed, figure), words, settings[SweepConfig].resume

    def _run_points(
        self, place: Path, manifest: SweepManifest, words: Mapping[str, list[str]], *, resume: bool
    ) -> SweepSummary:
        """Run the points without an answer and write the summary, also when that is interrupted."""
        from pareto_ltl_apps.cli.output import print_problem
        from pareto_ltl_apps.cli.summary import sweep_answer
        from pareto_ltl_apps.studies.jobs import JobQueue, RunJob
        from pareto_ltl_apps.studies.sweep_summary import write_summary

        def launch(batch: Sequence[RunJob]) -> None:
            size = self._batch_size() or len(batch)
            for first in range(0, len(batch), size):
                self._launch([words[job.key] for job in batch[first : first + size]], first)

        runs = [RunJob(place / point.job) for point in manifest.points]
        todo = [run for run in runs if not (resume and run.settled())]
        print(_opening_line(len(runs), len(todo), place), flush=True)
        queue = JobQueue(launch, print_problem)
        try:
            queue.run(todo)
        except BaseException:
            found = write_summary(place, given_up=queue.given_up)
            print(*sweep_answer(found, place / "summary.html").lines, sep="\n")
            raise
        return write_summary(place, given_up=queue.given_up)

    def _overrides(self, arguments: Sequence[str]) -> dict[str, list[str]]:
        """Every key with its values, as words for a command line; what comes later wins."""
        parser = OverridesParser.create(config_loader=self.loader)
        grid = [f"{key}={values}" for key, values in self.params.items()]
        table: dict[str, list[str]] = {}
        for override in parser.parse_overrides([*grid, *arguments]):
            key, swept = override.get_key_element(), override.is_sweep_override()
            values = override.sweep_string_iterator() if swept else [override.get_value_element_as_str()]
            table[key] = [f"{key}={value}" for value in values]
        return table

    def _batch_size(self) -> int | None:
        """Jobs for a launcher at once: submitit's local engine would start all that it gets."""
        if self.max_batch_size or type(self.launcher).__name__ != "LocalLauncher":
            return self.max_batch_size
        from careful_io.machine import cores

        return max(1, cores() // self._threads())

    def _threads(self) -> int:
        params = getattr(self.launcher, "params", {})
        return int(params.get("cpus_per_task") or 1)

    def _launch(self, lines: list[list[str]], first: int) -> None:
        assert self.launcher is not None
        local = type(self.launcher).__name__ == "LocalLauncher"
        given = {name: str(self._threads()) for name in THREAD_VARIABLES} if local else {}
        kept = {name: os.environ.get(name) for name in given}
        os.environ.update(given)
        try:
            with waiting_for_all():
                results = self.launcher.launch(lines, initial_job_idx=first)
            for result in results:
                if result.status is JobStatus.FAILED:
                    raise result._return_value  # noqa: SLF001 - return_value prints before it raises
        finally:
            for name, value in kept.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value


@contextmanager
def waiting_for_all() -> Iterator[None]:
    """Let submitit wait for all jobs of an array, also when one of them was killed.

    Its Hydra launcher raises at the first, with the others still at work or in the queue of the cluster:
    what is launched again would meet them there.
    """
    if find_spec("submitit") is None:
        yield
        return
    from submitit import AutoExecutor

    whole = AutoExecutor.map_array

    def map_array(executor: AutoExecutor, *args: Any) -> list[AwaitedJob]:
        return [AwaitedJob(job) for job in whole(executor, *args)]

    AutoExecutor.map_array = map_array  # type: ignore[method-assign, assignment]
    try:
        yield
    finally:
        del AutoExecutor.map_array  # what it inherits is there again


class AwaitedJob:
    """A job of submitit whose failure is a result."""

    def __init__(self, job: Any) -> None:
        self._job = job

    def results(self) -> list[JobReturn]:
        """The results of the job; where it ended without any, one result that holds the error."""
        try:
            found: list[JobReturn] = self._job.results()
        except Exception as error:
            return [JobReturn(status=JobStatus.FAILED, _return_value=error)]
        return found


def point_composer(loader: ConfigLoader, master: DictConfig) -> Callable[[Sequence[str]], DictConfig]:
    """A function that composes a point of a grid; what takes Hydra milliseconds is done once each."""
    parser = OverridesParser.create(config_loader=loader)

    @cache
    def parsed(word: str) -> Override:
        (override,) = parser.parse_overrides([word])
        return override

    @cache
    def is_group(key: str) -> bool:  # Hydra copies all that it has cached for each question: 3 ms
        return bool(loader.get_group_options(key))

    def changes_value(override: Override) -> bool:
        changes = override.type is OverrideType.CHANGE and override.package is None
        return changes and not is_group(override.key_or_group)

    @cache
    def composed(words: tuple[str, ...]) -> DictConfig:
        config = loader.load_sweep_config(master, list(words))
        with open_dict(config):
            del config["hydra"]
        return config

    def compose(line: Sequence[str]) -> DictConfig:
        """The configuration of one point: values are set in a copy of what the other words give."""
        values = {word: parsed(word) for word in line if changes_value(parsed(word))}
        config = copy.deepcopy(composed(tuple(word for word in line if word not in values)))
        try:
            for override in values.values():
                OmegaConf.update(config, override.key_or_group, override.value(), merge=True)
        except OmegaConfBaseException:
            return composed(tuple(line))  # Hydra says what is wrong
        return config

    return compose


def _plain_key(key: str) -> str:
    return key.lstrip("+")


def _swept_values(line: Sequence[str], swept: set[str]) -> dict[str, str]:
    """What was varied at one point, without the quotes of a command line."""
    pairs = (word.partition("=") for word in line)
    return {_plain_key(key): _unquoted(value) for key, _, value in pairs if key in swept}


def _unquoted(value: str) -> str:
    quoted = len(value) > 1 and value[0] == value[-1] and value[0] in "'\""
    return value[1:-1] if quoted else value


def _opening_line(of: int, todo: int, place: Path) -> str:
    done = of - todo
    if not todo:
        return f"all {of} jobs of {place} have their answers"
    return f"{todo} jobs into {place}" + (f", {done} of {of} have their answers already" if done else "")
