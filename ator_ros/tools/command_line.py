"""What commands have in common: options, one-line reports of expected errors, Ctrl-C."""

from __future__ import annotations

import argparse
import codecs
import contextlib
import io
import math
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ator_ros.domains import DEFAULT
from ator_ros.experience.parallel import BACKENDS
from ator_ros.files import reserved

if TYPE_CHECKING:  # each takes seconds to import, and no help needs it
    from ator_ros.domains.domain import Domain
    from ator_ros.evaluation.situation import Record, Settings
    from ator_ros.evaluation.toolset import ToolsetSource

INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM."""

RESUMES = "the same command goes on from here"

_ROOM = 100_000  # bytes of a result whose size is not known beforehand
_IN_ASCII = "ator_ros.in_ascii"
_SPELLED = {"±": "+-", "°": " deg", "…": "...", "²": "^2", "→": "->"}


def add_setting(parser: argparse.ArgumentParser, *, action_set: bool = True) -> None:
    """Add the options that say for whom the work is done: robot, domain, set of actions."""
    parser.add_argument(
        "--robot", default="", metavar="FILE", help="robot description (default: the shipped one)"
    )
    parser.add_argument(
        "--domain",
        default=DEFAULT,
        metavar="NAME|FILE",
        help="an installed domain, or the YAML file of one (default: %(default)s)",
    )
    if action_set:
        parser.add_argument(
            "--action-set", default="default", metavar="NAME", help="of the domain (default: %(default)s)"
        )


def add_models(parser: argparse.ArgumentParser) -> None:
    """Add the option that names the performance models."""
    parser.add_argument(
        "--models", default="", metavar="DIR", help="folder of the models (default: as shipped)"
    )


def add_factor(parser: argparse.ArgumentParser, default: float) -> None:
    """Add the option that says how fast the simulation runs."""
    parser.add_argument(
        "--real-time-factor",
        type=number,
        default=default,
        metavar="F",
        help="simulated per real seconds (default: %(default)s); 0: as fast as the robot is steered",
    )


def number(text: str) -> float:
    """Be a type for argparse: a finite number from 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a finite number from 0, got {text!r}")
    return value


def settled(
    parser: argparse.ArgumentParser, words: Sequence[str] | None, **names: Callable[[Domain], Iterable[str]]
) -> tuple[argparse.Namespace, Domain]:
    """Parse a command line whose names depend on its domain.

    Parameters
    ----------
    parser : ArgumentParser
        With the options of `add_setting`.
    words : sequence of str, optional
        By default those of the process.
    **names : callable
        Of further options, what they may name. An option with one name that was left out gets the first of
        them, one with several all of them.

    Returns
    -------
    Namespace, Domain
        The options and the domain. A name that the domain lacks ends the program as argparse does.
    """
    options = parser.parse_args(words)
    from ator_ros.domains.domain import DomainError, find_domain

    try:
        domain = find_domain(options.domain)
    except DomainError as error:
        parser.error(str(error))
    if options.__dict__.get("action_set") is not None:
        check_names(parser, "action_set", [options.action_set], domain.action_sets)
    for name, allowed in names.items():
        there, given = list(allowed(domain)), getattr(options, name)
        several = any(action.dest == name and action.nargs for action in parser._actions)
        if given is None:
            setattr(options, name, there if several else next(iter(there), None))
        else:
            check_names(parser, name, given if several else [given], there)
    return options, domain


def check_names(
    parser: argparse.ArgumentParser, option: str, given: Iterable[str], allowed: Iterable[str]
) -> None:
    """End the program as argparse does if one of the names that an option was given is none."""
    there = list(allowed)
    for name in given:
        if name not in there:
            flag = f"--{option.replace('_', '-')}"
            parser.error(f"argument {flag}: expected one of {', '.join(there)}, got {name[:80]!r}")


def policies() -> list[str]:
    """Return the names of all policies that can be evaluated."""
    from ator_ros.evaluation.policies import POLICIES

    return list(POLICIES)


def source_of(options: argparse.Namespace, **more: Any) -> ToolsetSource:
    """Return the source of robot, actions and models that the options of `add_setting` name."""
    from ator_ros.evaluation.toolset import ToolsetSource

    given = {name: getattr(options, name) for name in ("domain", "robot", "action_set", "models")
             if name in options}  # fmt: skip
    return ToolsetSource(**(given | more))


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
        with stopped_by_signals(), told_once(program):
            return work()
    except KeyboardInterrupt:
        print(f"{program}: interrupted; {interrupted}", file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if not isinstance(error, _expected()):
            raise
        print(f"{program}: {error}", file=sys.stderr)
        return 1


def _expected() -> tuple[type[Exception], ...]:
    """Return the errors that a command tells in one line; they lie in modules that take long to import."""
    from ator_ros.domains.domain import DomainError
    from ator_ros.evaluation.errors import EvaluationError
    from ator_ros.experience.errors import ExperienceError
    from ator_ros.experience.parallel import BackendError
    from ator_ros.performance.model_file import ModelFileError
    from ator_ros.performance.training import TrainingError
    from ator_ros.refinement.errors import RefinementError
    from ator_ros.robot.description import ConfigError
    from ator_ros.robot.probe_drive import DriveError

    ours = (BackendError, ConfigError, DomainError, DriveError, EvaluationError, ExperienceError)
    return (*ours, ModelFileError, OSError, RefinementError, TrainingError)


@contextlib.contextmanager
def told_once(program: str) -> Iterator[None]:
    """Tell a warning in one line, and of each kind of warning only the first."""
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
    from tqdm import tqdm

    from ator_ros.evaluation.running import run_situations
    from ator_ros.experience.parallel import cluster

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
