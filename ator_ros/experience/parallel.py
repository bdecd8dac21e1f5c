"""Long computations: spread over processes or a cluster by joblib, shown as they progress, and resumable."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from pathlib import Path
from typing import Any, Self, TypeVar

from tqdm import tqdm

from ator_ros.files import read_text, try_lock
from ator_ros.printable import short

Task = TypeVar("Task")
Result = TypeVar("Result")

BACKENDS = ("loky", "dask")
_WORKERS_S = 60
"""Time in s to wait for the first worker of a cluster."""
_WATCH_S = 1.0
"""Period in s with which a worker checks whether its parent is alive."""
_watched: set[int] = set()
_LARGEST = 2_000_000_000
"""Bytes of a file of partial results: an episode takes about 10 kB, an evaluated situation 2 kB."""


class BackendError(RuntimeError):
    """A parallel backend that cannot be used; the message says what to install or to start."""


def run_tasks(
    function: Callable[[Task], Result], tasks: Sequence[Task], *, jobs: int = 1, backend: str = "loky"
) -> Iterator[Result]:
    """Yield ``function(task)`` for every task, in the order of the tasks.

    The results are those of a plain loop whatever the number of workers, as long as `function` depends on
    its task alone: give every task a seed of its own.

    Parameters
    ----------
    function : callable
        A function at the top level of a module.
    tasks : sequence
        Its arguments.
    jobs : int
        Number of worker processes; 1 runs in this process, -1 takes every core. With `dask` the cluster
        decides and this only says how many tasks are under way at once (-1: as many as it has threads).
    backend : {"loky", "dask"}
        Local processes, or the cluster of the `distributed.Client` that is open.

    Raises
    ------
    BackendError
        The backend is unknown, not installed, or has no cluster to work on; or a worker was killed.
    """
    if backend not in BACKENDS:
        raise BackendError(f"backend: expected one of {', '.join(BACKENDS)}, got {backend!r}")
    if backend == "loky" and jobs == 1:
        yield from map(function, tasks)
        return
    import joblib  # takes a second

    # loky ends workers that were idle or have grown, and starts others; each task is still done.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs")
    # joblib 1.3's dask backend gives its results all at once only.
    streams = backend == "loky" or _version_of(joblib) >= (1, 4)
    try:
        with joblib.parallel_config(backend=backend, n_jobs=jobs):
            results = joblib.Parallel(return_as="generator" if streams else "list", batch_size=1)(
                joblib.delayed(_in_worker)(function, task, os.getpid() if backend == "loky" else None)
                for task in tasks
            )
    except (ImportError, ValueError) as error:
        raise BackendError(f"backend {backend!r} cannot be used: {error}") from error
    with contextlib.closing(results) if streams else contextlib.nullcontext():
        try:
            yield from results
        except BrokenExecutor as error:
            raise BackendError(f"a worker process was killed: {str(error).splitlines()[0]}") from error


def _version_of(module: Any) -> tuple[int, int]:
    major, minor = module.__version__.split(".")[:2]
    return int(major), int(minor)


def _in_worker(function: Callable[[Task], Result], task: Task, parent: int | None) -> Result:
    """Execute a task in a worker, of the process `parent` unless it is a cluster's."""
    if os.getpid() == parent:  # with one core joblib starts no workers
        return function(task)
    # Ctrl-C in a terminal, and the SIGTERM of a supervisor, reach the workers too; only the parent may act.
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
    if parent is not None and os.getpid() not in _watched:
        _watched.add(os.getpid())
        warnings.simplefilter("ignore", UserWarning)  # the parent reports them, once
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    return function(task)


def _end_with(parent: int) -> None:
    """End this process soon after `parent` was killed."""
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)


def progress(results: Iterable[Result], *, done: int, total: int, unit: str) -> Any:
    """Yield results behind a progress bar on a terminal, or a line of it every 30 s in a log.

    Parameters
    ----------
    results : iterable
        The results that are still missing.
    done, total : int
        Number of results of earlier runs, and of all.
    unit : str
        What a result is.
    """
    period = 0.1 if sys.stderr.isatty() else 30.0
    return tqdm(results, initial=done, total=total, unit=unit, mininterval=period, delay=period - 0.1)


class PartialResults:
    """Results kept in a file, one JSON object a line, so that an interrupted computation can resume.

    The first line holds what the results depend on. A last line that was cut off is dropped. The file is
    locked against other processes until it is closed.

    Parameters
    ----------
    path : Path
        The file; made when missing, with its folder.
    identity : mapping
        What the results depend on, as JSON can hold it.
    expected : str
        What the file holds, for messages, as in "episodes of the same seed".
    error : type
        What is raised.

    Attributes
    ----------
    results : list of dict
        The results of earlier runs.

    Raises
    ------
    ValueError
        Of the type `error`: the file holds other results, is damaged, or is locked by another process.
    OSError
        The file cannot be written.
    """

    def __init__(
        self, path: Path, identity: Mapping[str, Any], expected: str, error: type[ValueError]
    ) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        header = json.dumps(identity, sort_keys=True)
        try:
            lines = read_text(path, _LARGEST).split("\n")[:-1] if path.exists() else []
            self.results = [_object(line) for line in lines[1:]]
        except (ValueError, RecursionError) as problem:
            raise error(f"{path}: expected {expected}, one a line: {problem}") from problem
        if lines and lines[0] != header:
            raise error(f"{path}: expected {expected}, got others: choose another --out, or delete that file")
        self._file = path.open("ab")
        if not try_lock(self._file.fileno()):
            self._file.close()
            raise error(f"{path}: expected a file of its own, another command is writing it")
        self._size = sum(len(line.encode()) + 1 for line in lines)
        os.truncate(path, self._size)
        if not lines:
            self._append(header)

    def append(self, result: Mapping[str, Any]) -> None:
        """Keep one more result, whole or, if OSError is raised, not at all."""
        self._append(json.dumps(result, separators=(",", ":")))

    def _append(self, line: str) -> None:
        data = line.encode() + b"\n"
        try:
            self._file.write(data)
            self._file.flush()
        except OSError:
            os.truncate(self.path, self._size)
            raise
        self._size += len(data)

    def __enter__(self) -> Self:
        """Return this object, whose file is closed when the block ends."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()


def _object(line: str) -> dict[str, Any]:
    found = json.loads(line)
    if not isinstance(found, dict):
        raise ValueError(f"expected an object, got {short(line)}")
    return found


@contextlib.contextmanager
def cluster(address: str | None) -> Iterator[None]:
    """Connect to the dask scheduler at `address`, as in ``tcp://host:8786``; None connects to nothing.

    Raises
    ------
    BackendError
        `distributed` is not installed, no scheduler answers at `address`, the cluster has no workers, or they
        cannot import this package.
    """
    if address is None:
        yield
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise BackendError("a dask cluster needs the package distributed: pip install distributed") from error
    try:
        client = Client(address)
    except (OSError, ValueError) as error:
        raise BackendError(
            f"cluster: expected a dask scheduler as in tcp://host:8786, got {address!r}: {error}"
        ) from error
    with client:
        check_cluster(client)
        yield


def check_cluster(client: Any) -> None:
    """Check that a `distributed.Client` has workers, and that all can run our tasks: else these never end.

    Raises
    ------
    BackendError
        They cannot.
    """

    def fault() -> str:  # sent as a whole, since it lies in no module
        try:
            import ator_ros  # noqa: F401
        except ImportError as error:
            return str(error)
        return ""

    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except TimeoutError as error:
        raise BackendError(
            f"the dask cluster: expected a worker within {_WORKERS_S} s, found none"
        ) from error
    faults = {"the scheduler": client.run_on_scheduler(fault), **client.run(fault)}
    for place, words in faults.items():
        if words:
            raise BackendError(f"the dask cluster: {place} must be able to import ator_ros: {words}")
