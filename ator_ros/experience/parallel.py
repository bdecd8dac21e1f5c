"""Long computations: spread over processes or a cluster by joblib, with a progress bar."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from importlib.metadata import version
from typing import TypeVar

from tqdm import tqdm

Task = TypeVar("Task")
Result = TypeVar("Result")

_PARENT_PERIOD = 0.5  # s between two looks at the parent process
_WORKERS_S = 60  # s to wait for the first worker of a cluster


class BackendError(RuntimeError):
    """Workers cannot be used; the message says what to install or to start."""


@contextlib.contextmanager
def workers(jobs: int, cluster: str | None = None) -> Iterator[None]:
    """Spread tasks over workers during the block; otherwise this process executes them.

    Parameters
    ----------
    jobs : int
        Number of worker processes; 1: in this process; -1: one for each core. For a cluster it is
        the number of tasks that run at once (-1: as many as it has threads).
    cluster : str, optional
        Address of a dask scheduler, as in ``tcp://host:8786``.

    Raises
    ------
    BackendError
        There is no cluster, it has no workers, or they cannot import this package.
    """
    import joblib  # takes a second

    with contextlib.ExitStack() as stack:
        if cluster is not None:
            from distributed import Client

            try:
                client = stack.enter_context(Client(cluster))
            except (OSError, ValueError) as error:
                raise BackendError(
                    "cluster: expected a dask scheduler as in tcp://host:8786, "
                    f"got {cluster!r}: {error}"
                ) from error
            try:
                client.wait_for_workers(1, timeout=_WORKERS_S)
                client.run_on_scheduler(version, "ator_ros")
                client.run(version, "ator_ros")
            except TimeoutError as error:
                raise BackendError(
                    f"cluster: expected a worker within {_WORKERS_S} s, found none"
                ) from error
            except ImportError as error:  # without ator_ros tasks would never end
                raise BackendError(
                    f"cluster: expected ator_ros on scheduler and workers: {error}"
                ) from error
        stack.enter_context(
            joblib.parallel_config("loky" if cluster is None else "dask", n_jobs=jobs)
        )
        yield


def run_tasks(function: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[Result]:
    """Yield ``function(task)`` for every task, in the order of the tasks, by the present `workers`.

    `function` is at the top level of a module, and depends on its task alone: then the results do
    not depend on the number of workers. Raises BackendError if a worker was killed.
    """
    import joblib

    # loky ends workers that were idle or have grown, and starts others; each task is still done.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs")
    try:
        parallel = joblib.Parallel(return_as="generator", batch_size=1)
    except ValueError:  # joblib 1.3's dask backend gives its results all at once only
        parallel = joblib.Parallel(batch_size=1)
    results = iter(
        parallel(joblib.delayed(_in_worker)(function, task, os.getpid()) for task in tasks)
    )
    try:
        yield from results
    except BrokenExecutor as error:
        raise BackendError(f"a worker process was killed: {str(error).splitlines()[0]}") from error


def _in_worker(function: Callable[[Task], Result], task: Task, parent: int) -> Result:
    """Execute a task, in a worker of the process `parent` or in `parent` itself."""
    if os.getpid() == parent:
        return function(task)
    if "distributed" not in sys.modules:  # a worker of a cluster is no child of `parent`
        end_with_parent(parent)
    # Ctrl-C in a terminal, and the SIGTERM of a supervisor, reach the workers too; only the parent
    # reacts.
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
    warnings.simplefilter("ignore", UserWarning)  # the parent reports them, once
    return function(task)


@functools.cache
def end_with_parent(parent: int) -> None:
    """End this process within a second after its parent process, also if that was killed.

    `parent` is the number of the parent, which may have ended already. For processes of this
    package; `tools.own_nodes.NodeProcesses` ends those of any program.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_PERIOD)
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()


def progress(
    results: Iterable[Result], *, done: int, total: int, unit: str
) -> Generator[Result, None, None]:
    """Yield results and report progress: a bar on a terminal, a line every 30 s in a log.

    `done` is the number of results of earlier runs, `total` the number of all; `unit` names one
    result. The bar begins after the first result, which may have compiled code: the time that it
    estimates is that of the others.
    """
    period = 0.1 if sys.stderr.isatty() else 30.0
    following = iter(results)
    try:
        first = next(following)
    except StopIteration:
        return
    yield first
    yield from tqdm(
        following,
        initial=done + 1,
        total=total,
        unit=unit,
        mininterval=period,
        delay=period - 0.1,
    )
