"""How commands end: expected errors in one line, Ctrl-C and signals, terminals that know ASCII only."""

from __future__ import annotations

import codecs
import contextlib
import io
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ator_ros.domains.domain import DomainError
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.experience.columns import ExperienceError
from ator_ros.experience.parallel import BackendError
from ator_ros.files import FileError
from ator_ros.performance.model_file import ModelFileError
from ator_ros.performance.training import TrainingError
from ator_ros.planning.goals import PlanningError
from ator_ros.printable import printable
from ator_ros.refinement import RefinementError
from ator_ros.robot.description import ConfigError
from ator_ros.robot.probe_drive import DriveError
from ator_ros.schema import SchemaError
from ator_ros.tools.processes import NodesError
from ator_ros.world.messages import MessageError

INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM."""

RESUMES = "the same command goes on from here"

EXPECTED_ERRORS: tuple[type[Exception], ...] = (
    *(BackendError, ConfigError, DomainError, DriveError, EvaluationError, ExperienceError),
    *(MessageError, ModelFileError, NodesError, OSError, PlanningError, RefinementError, SchemaError),
    *(FileError, TrainingError),
)
"""Errors that are reported in one line instead of a traceback."""
_LONGEST_LINE = 1000
_IN_ASCII = "ator_ros.in_ascii"
_SPELLED = {"±": "+-", "°": " deg", "…": "...", "²": "^2", "→": "->"}


def guarded(program: str, work: Callable[[], int], *, interrupted: str = "nothing was written") -> int:
    """Run a command; report an expected error in one line instead of a traceback.

    Parameters
    ----------
    program : str
        Its name, for the message.
    work : callable
        Returns the exit code.
    interrupted : str
        What to report after Ctrl-C, SIGTERM or the end of the terminal.
    """
    write_plainly()
    try:
        with stopped_by_signals(), told_once(program):
            return work()
    except KeyboardInterrupt:
        print(f"{program}: interrupted; {interrupted}", file=sys.stderr)
        return INTERRUPTED
    except EXPECTED_ERRORS as error:
        report(program, error)
        return 1


def report(program: str, error: Exception) -> None:
    """Print an error to stderr in one line, without control characters of foreign names."""
    lines = filter(None, (line.strip() for line in str(error).splitlines()))
    print(f"{program}: {printable('; '.join(lines), _LONGEST_LINE)}", file=sys.stderr)


@contextlib.contextmanager
def told_once(program: str) -> Iterator[None]:
    """Report each kind of warning once, in one line."""
    kinds: set[type[Warning]] = set()

    def tell(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        if category not in kinds:
            kinds.add(category)
            print(f"{program}: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = tell
        yield


@contextlib.contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt as Ctrl-C does; what nohup ignores stays ignored."""
    numbers = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) is signal.SIG_DFL]
    with handled(dict.fromkeys(numbers, signal.default_int_handler)):
        yield


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that end what starts nodes: Ctrl-C, SIGTERM, and SIGHUP unless nohup ignores it.

    The nodes are no part of the terminal that closes: whoever started them must live to end them.
    """
    hangs_up = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    return (signal.SIGINT, signal.SIGTERM, *((signal.SIGHUP,) if hangs_up else ()))


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore further Ctrl-C and SIGTERM during the short time in which results are written."""
    with handled(dict.fromkeys((signal.SIGINT, signal.SIGTERM, signal.SIGHUP), signal.SIG_IGN)):
        yield


@contextlib.contextmanager
def handled(handlers: Mapping[signal.Signals, Any]) -> Iterator[None]:
    """Handle signals in this way; do nothing outside the main thread, to which they belong."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def write_plainly() -> None:
    """Replace characters that the terminal cannot show by ASCII, instead of ending the command."""
    codecs.register_error(_IN_ASCII, _in_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_IN_ASCII)


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_SPELLED.get(c, ascii(c)[1:-1]) for c in text), error.end


class _Stopped(Exception):  # noqa: N818 (no error)
    """The user has ended it."""


def until_stopped(
    program: str, serve: Callable[[Callable[[], None]], None], expected: tuple[type[Exception], ...]
) -> int:
    """Run until Ctrl-C, SIGTERM or the end of the terminal, its usual end; return the exit code.

    Parameters
    ----------
    program : str
        Its name, for messages.
    serve : callable
        What runs. It gets a function that it calls again and again, and which ends it by an exception.
    expected : tuple of type
        Errors that are reported in one line.
    """
    write_plainly()
    stopped: list[int] = []

    def going_on() -> None:
        if stopped:
            raise _Stopped

    try:
        with handled(dict.fromkeys(ending_signals(), lambda number, _: stopped.append(number))):
            serve(going_on)
    except ImportError as error:
        print(f"{program}: {error}: docs/install.md says how to install it", file=sys.stderr)
        return 1
    except _Stopped:
        return 0
    except expected as error:
        report(program, error)
        return 1
    return 0
