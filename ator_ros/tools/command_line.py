"""What commands have in common: options, one-line reports of expected errors, Ctrl-C."""

from __future__ import annotations

import argparse
import codecs
import contextlib
import io
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ator_ros.domains.domain import DEFAULT, Domain, DomainError, find_domain
from ator_ros.evaluation.errors import EvaluationError
from ator_ros.evaluation.running import run_situations
from ator_ros.evaluation.situation import Record, Settings
from ator_ros.experience.errors import ExperienceError
from ator_ros.experience.parallel import BACKENDS, BackendError, cluster
from ator_ros.files import reserved
from ator_ros.performance.model_file import ModelFileError
from ator_ros.performance.training import TrainingError
from ator_ros.refinement.errors import RefinementError
from ator_ros.robot.description import ConfigError
from ator_ros.robot.probe_drive import DriveError

INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM."""

_ROOM = 100_000  # bytes of a result whose size is not known beforehand
_IN_ASCII = "ator_ros.in_ascii"
_SPELLED = {"±": "+-", "°": " deg", "…": "...", "²": "^2", "→": "->"}
_EXPECTED = (
    BackendError,
    ConfigError,
    DomainError,
    DriveError,
    EvaluationError,
    ExperienceError,
    ModelFileError,
    OSError,
    RefinementError,
    TrainingError,
)


def domain_in(program: str, words: Sequence[str]) -> Domain:
    """Return the domain that a command line names; the choices of its other options depend on it."""
    parser = argparse.ArgumentParser(prog=program, add_help=False, allow_abbrev=False)
    add_domain(parser)
    options, _ = parser.parse_known_args(words)
    try:
        return find_domain(options.domain)
    except DomainError as error:
        parser.error(str(error))


def add_domain(parser: argparse.ArgumentParser) -> None:
    """Add the option that names the domain."""
    parser.add_argument(
        "--domain", default=DEFAULT, metavar="NAME", help="an installed domain (default: %(default)s)"
    )


def add_parallel_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where the work is done: jobs, backend, cluster."""
    add_jobs(parser)
    parser.add_argument("--backend", choices=BACKENDS, default="loky", help="default: %(default)s")
    parser.add_argument("--cluster", metavar="ADDRESS", help="dask scheduler, as in tcp://host:8786")


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add the option that says how many processes work."""
    parser.add_argument(
        "--jobs", type=_jobs, default=-1, metavar="N", help="worker processes (default: -1, one per core)"
    )


def _jobs(text: str) -> int:
    if text == "-1":
        return -1
    try:
        return whole(1)(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}; or -1, one per core") from error


def guarded(program: str, work: Callable[[], int], *, interrupted: str = "nothing was written") -> int:
    """Run a command; tell an expected error in one line instead of a traceback.

    Parameters
    ----------
    program : str
        Its name, for the message.
    work : callable
        Gives the exit code.
    interrupted : str
        What to tell after Ctrl-C, SIGTERM or the end of the terminal.
    """
    write_plainly()
    try:
        with stopped_by_signals():
            return work()
    except KeyboardInterrupt:
        print(f"{program}: interrupted; {interrupted}", file=sys.stderr)
        return INTERRUPTED
    except _EXPECTED as error:
        print(f"{program}: {error}", file=sys.stderr)
        return 1


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt as Ctrl-C does; what nohup ignores stays ignored."""
    numbers = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) is signal.SIG_DFL]
    with _handled(dict.fromkeys(numbers, signal.default_int_handler)):
        yield


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Let no second Ctrl-C or SIGTERM interrupt the short time in which results are written."""
    with _handled(dict.fromkeys((signal.SIGINT, signal.SIGTERM, signal.SIGHUP), signal.SIG_IGN)):
        yield


@contextlib.contextmanager
def _handled(handlers: Mapping[signal.Signals, Any]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():  # signals are the main thread's
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def write_plainly() -> None:
    """Let a terminal that knows ASCII only show other characters in ASCII, instead of ending the command."""
    codecs.register_error(_IN_ASCII, _in_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_IN_ASCII)


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_SPELLED.get(c, ascii(c)[1:-1]) for c in text), error.end


def executed(settings: Settings, options: argparse.Namespace, folder: Path) -> list[Record]:
    """Execute `options.situations` situations where the options say, with a progress bar.

    Parameters
    ----------
    settings : Settings
        What the results depend on.
    options : argparse.Namespace
        With those of `add_parallel_options`.
    folder : Path
        For partial results: the same call goes on where it was interrupted.
    """
    with cluster(options.cluster):
        return run_situations(
            settings,
            situations=options.situations,
            folder=folder,
            jobs=options.jobs,
            backend=options.backend,
            progress=lambda records, done, total: tqdm(
                records, initial=done, total=total, unit="situation", smoothing=0.05, disable=None
            ),
        )


def destination(text: str) -> Path:
    """Be a type for argparse: a file that can be written, as far as that is known beforehand."""
    path = Path(text)
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    wanted = f"expected a file that can be written, got {text!r}"
    if path.is_dir() or not folder.is_dir():
        raise argparse.ArgumentTypeError(wanted)
    try:
        with reserved(folder, _ROOM):
            return path
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{wanted}: {error}") from error


def whole(least: int = 0, most: int | None = None) -> Callable[[str], int]:
    """Return a type for argparse: a whole number from `least` to `most`, where there is a most."""
    expected = f"a whole number from {least}" + (f" to {most}" if most is not None else "")

    def read(text: str) -> int:
        number = int(text) if text.isdecimal() else least - 1
        if number < least or (most is not None and number > most):
            raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}")
        return number

    return read
