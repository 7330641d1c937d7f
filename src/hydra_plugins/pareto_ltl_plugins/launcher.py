"""The launcher of sweeps on an existing cluster of Dask: ``hydra/launcher=dask``.

Hydra has no launcher for an existing cluster. This module holds what needs Hydra; studies use the same
connection (``pareto_ltl_apps.studies.cluster``).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, JobStatus, run_job, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, open_dict


class DaskLauncher(Launcher):
    """Gives each job of a sweep to a worker of the scheduler at ``address``."""

    def __init__(self, address: str) -> None:
        self.address = address

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Keep what a job needs."""
        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """Run the jobs and wait for all; a job whose worker died each time has status FAILED."""
        from pareto_ltl_apps.studies.cluster import broken, on_cluster

        setup_globals()
        shared = self.hydra_context, self.task_function, self.config, Singleton.get_state()
        rows = [(initial_job_idx + k, tuple(words)) for k, words in enumerate(job_overrides)]
        found = [JobReturn(status=JobStatus.UNKNOWN) for _ in rows]
        try:
            for k, result in on_cluster(self.address, _run, shared, rows):
                found[k] = result
        except broken() as error:
            return [JobReturn(status=JobStatus.FAILED, _return_value=error)]
        return found


def _run(row: tuple[int, tuple[str, ...]], shared: tuple[Any, ...]) -> JobReturn:
    """One job in a worker, which is a separate process."""
    number, words = row
    context, task, config, state = shared
    setup_globals()
    Singleton.set_state(state)
    job = context.config_loader.load_sweep_config(config, list(words))
    with open_dict(job):
        job.hydra.job.id = f"{job.hydra.job.name}_{number}"
        job.hydra.job.num = number
    HydraConfig.instance().set_config(job)
    return run_job(
        hydra_context=context, config=job, task_function=task, job_dir_key="hydra.sweep.dir",
        job_subdir_key="hydra.sweep.subdir",
    )  # fmt: skip
