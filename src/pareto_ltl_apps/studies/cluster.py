"""Parts of a study, and jobs of a sweep, on an existing cluster of Dask (the extra ``dask``).

Workers need the package and the folder of the results under the same path. Each has one thread, because a job
starts its threads itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from queue import Empty, SimpleQueue
from socket import gethostname
from typing import TYPE_CHECKING, Any, TypeVar

from careful_io.fingerprints import code_fingerprint
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.extras import EXTRAS

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 30.0  # [s] to reach the scheduler and a first worker
Work = TypeVar("Work")


def broken() -> tuple[type[Exception], ...]:
    """Errors that mean that the process of a job was killed, each time that Dask tried it."""
    from distributed.client import FutureCancelledError
    from distributed.scheduler import KilledWorker

    return (KilledWorker, FutureCancelledError)


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """A client of the scheduler at ``address``, as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    ConfigError
        If the extra is missing, nothing answers, or a worker has several threads.
    """
    EXTRAS.require("dask", "a cluster of Dask")
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"{address}: no scheduler of Dask answers ({error}); start one with 'dask scheduler', and give "
            "its address, such as tcp://10.0.0.1:8786"
        ) from None
    with client:
        threads = threads_of_workers(client)
        if not threads:
            raise ConfigError(
                f"{address}: the scheduler has no workers; start some with "
                f"'dask worker {address} --nthreads 1'"
            )
        if threads != {1}:
            raise ConfigError(
                f"{address}: workers have {', '.join(map(str, sorted(threads)))} threads, and a job needs a "
                "separate process; start them with --nthreads 1"
            )
        yield client


def threads_of_workers(client: Client) -> set[int]:
    """Numbers of threads of the workers; empty if there is none for as long as :data:`PATIENCE`.

    A worker that was there may be starting again when its threads are asked for.
    """
    end = time.monotonic() + PATIENCE
    while (left := end - time.monotonic()) > 0.0:
        try:
            client.wait_for_workers(1, timeout=left)
        except TimeoutError:
            break
        workers = client.scheduler_info(n_workers=-1)["workers"]
        if workers:
            return {worker["nthreads"] for worker in workers.values()}
    return set()


def on_cluster(
    address: str, work: Callable[[Any, Any], Work], shared: Any, rows: Sequence[Any]
) -> Iterator[tuple[int, Work]]:
    """``work(row, shared)`` for each of ``rows``, as they end: number of the row, and the result.

    ``shared`` is sent once. A row whose worker died is given to another one by Dask, a few times.

    Raises
    ------
    DataError
        If a worker has another version of the package, or none is left.
    """
    ended: SimpleQueue[Any] = SimpleQueue()
    with connected(address) as client:
        # As the result of a task, it can be made again after the death of a worker; scattered data cannot.
        sent = client.submit(_itself, _Sent(work, shared, _code()), pure=False)
        futures = {client.submit(_worked, row, sent, pure=False): k for k, row in enumerate(rows)}
        for future in futures:
            future.add_done_callback(ended.put)
        while futures:
            future = _next_of(ended, client)
            row = futures.pop(future, None)
            if row is not None:  # a result that was lost with its worker is made again, and ends twice
                yield row, future.result()


def _next_of(ended: SimpleQueue[Any], client: Client) -> Any:
    """The next task that has ended; DataError if no worker is left that could end one."""
    while True:
        try:
            return ended.get(timeout=PATIENCE)
        except Empty:
            if not threads_of_workers(client):
                raise DataError(
                    "the cluster has no workers any more: start some, and the same command, which continues"
                ) from None


@dataclass(frozen=True, slots=True, eq=False)
class _Sent:
    """The data that each worker gets once."""

    work: Callable[[Any, Any], Any]
    shared: Any
    code: str


def _itself(sent: _Sent) -> _Sent:
    return sent


def _worked(row: Any, sent: _Sent) -> Any:
    """The work of one row, in a worker with the same source code."""
    if _code() != sent.code:
        raise DataError(
            f"a worker on {gethostname()} has another version of pareto_ltl: install the same one "
            "everywhere, and start the workers again"
        )
    return sent.work(row, sent.shared)


@cache
def _code() -> str:
    return code_fingerprint()
