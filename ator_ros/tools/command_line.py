"""Common to all command lines: options, checks of names against the domain, errors and exit codes."""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import re
import signal
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain, DomainError, domain_for
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.evaluation.trials import EvaluationError
from ator_ros.experience.parallel import BackendError, workers
from ator_ros.experience.table import ExperienceError
from ator_ros.files import FileError, portable_command
from ator_ros.nodes.network import NodesError
from ator_ros.planning.goals import PlanningError
from ator_ros.printable import printable
from ator_ros.refinement import RefinementError
from ator_ros.robot.description import ConfigError
from ator_ros.robot.probe_drive import DriveError
from ator_ros.schema import SchemaError
from ator_ros.world.messages import MessageError

_NAMESPACE = re.compile(r"(?!__)[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM."""
RESUMES = "the same command resumes from here"
_LONGEST_LINE = 1000


EXPECTED_ERRORS: tuple[type[Exception], ...] = (
    *(BackendError, ConfigError, DomainError, DriveError, EvaluationError, ExperienceError, FileError),
    *(MessageError, NodesError, OSError, PlanningError, RefinementError, SchemaError),
)
"""Errors that are reported in one line instead of a traceback."""


def guarded(program: str, work: Callable[[], object], *, interrupted: str = "nothing was written") -> int:
    """Run a command and return its exit code; report an expected error in one line instead of a traceback.

    SIGTERM and SIGHUP stop it like Ctrl-C, unless they are ignored (nohup). Characters that the terminal
    cannot encode are escaped.

    `interrupted` is what to report after Ctrl-C, SIGTERM or the end of the terminal.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with _stopped_by_signals(), _warning_once(program):
            work()
            return 0
    except KeyboardInterrupt:
        print(f"{program}: interrupted; {interrupted}", file=sys.stderr)
        return INTERRUPTED
    except ImportError as error:
        print(f"{program}: {error}: docs/install.md says how to install it", file=sys.stderr)
        return 1
    except EXPECTED_ERRORS as error:
        lines = filter(None, (line.strip() for line in str(error).splitlines()))
        print(f"{program}: {printable('; '.join(lines), _LONGEST_LINE)}", file=sys.stderr)
        return 1


@contextlib.contextmanager
def _warning_once(program: str) -> Iterator[None]:
    """Report each kind of warning once, in one line."""
    kinds: set[type[Warning]] = set()

    def report(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
        if category not in kinds:
            kinds.add(category)
            print(f"{program}: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = report
        yield


@contextlib.contextmanager
def _stopped_by_signals() -> Iterator[None]:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt, like Ctrl-C."""
    numbers = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def add_setting(parser: argparse.ArgumentParser, *, action_set: bool = True) -> None:
    """Add the options that select robot, domain, map and set of actions."""
    parser.add_argument(
        "--robot", default="", metavar="FILE", help="robot description (default: the shipped one)"
    )
    parser.add_argument(
        "--domain", default="", metavar="NAME|FILE",
        help="an installed domain, or the YAML file of one (default: soccer for a robot with a holder and a "
        "ball in its scene, drive for any other)",
    )  # fmt: skip
    parser.add_argument(
        "--map", default="", metavar="FILE", help="map_server file of the building (default: the domain's)"
    )
    if action_set:
        parser.add_argument(
            "--action-set", default=DEFAULT_SET, metavar="NAME", help="of the domain (default: %(default)s)"
        )


def add_models(parser: argparse.ArgumentParser) -> None:
    """Add the option that names the performance models."""
    parser.add_argument(
        "--models", default="", metavar="DIR", help="folder of the models (default: as shipped)"
    )


def add_factor(parser: argparse.ArgumentParser, default: float) -> None:
    """Add the option for the speed of the simulation."""
    parser.add_argument(
        "--real-time-factor", type=number(0.0), default=default, metavar="F",
        help="simulated per real seconds (default: %(default)s); 0: as fast as the robot is steered",
    )  # fmt: skip


def add_parallel_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for parallel work: jobs and cluster."""
    parser.add_argument(
        "--jobs", type=jobs, default=-1, metavar="N", help="worker processes (default: -1, one per core)"
    )
    parser.add_argument(
        "--cluster",
        metavar="ADDRESS",
        help="work on the cluster of this dask scheduler, as in tcp://host:8786",
    )


def _check_names(
    parser: argparse.ArgumentParser, option: str, given: Iterable[str], allowed: Collection[str]
) -> None:
    for name in given:
        if name not in allowed:
            flag = f"--{option.replace('_', '-')}"
            parser.error(f"argument {flag}: expected one of {', '.join(allowed)}, got {name[:80]!r}")


def run_tool(
    parser: argparse.ArgumentParser,
    work: Callable[[argparse.Namespace, Domain, str], None],
    argv: Sequence[str] | None,
    *,
    interrupted: str = "nothing was written",
    needed: bool = True,
    **names: Callable[[Domain], Iterable[str]],
) -> int:
    """Parse a command line whose names depend on its domain, run its work, and return the exit code.

    A name that the domain lacks ends the program as argparse does.

    Parameters
    ----------
    parser : ArgumentParser
        With the options of `add_setting`.
    work : callable
        Does the work, with the options, the domain, and the command line as files record it.
    argv : sequence of str, optional
        By default the words of the process.
    interrupted : str
        As for `guarded`.
    needed : bool
        Whether to refuse a domain without names for one of the further options.
    **names : callable
        Allowed names of further options. An option that was left out gets the first of them or, if its name
        is a plural, all of them.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    options = parser.parse_args(words)
    try:
        domain = domain_for(options.domain, options.robot).on_map(options.map)
    except (DomainError, FileError) as error:
        # Without the usage, which does not help with an error in the file of a domain.
        parser.exit(2, f"{parser.prog}: error: {printable(error, _LONGEST_LINE)}\n")
    options.domain = options.domain or domain.name
    if getattr(options, "action_set", None) is not None:
        _check_names(parser, "action_set", [options.action_set], domain.action_sets)
    for name, allowed in names.items():
        there, given = list(allowed(domain)), getattr(options, name)
        several = name.endswith("s")
        if needed and not there:
            kind = f"{name.removesuffix('s')}s"
            parser.error(f"argument --domain: expected one with {kind}, got {domain.name}, which has none")
        if given is None:
            setattr(options, name, there if several else next(iter(there), None))
        else:
            _check_names(parser, name, given if several else [given], there)
    command = portable_command(parser.prog, words)

    def run() -> None:
        parallel = "jobs" in options  # see `add_parallel_options`
        with workers(options.jobs, options.cluster) if parallel else contextlib.nullcontext():
            work(options, domain, command)

    return guarded(parser.prog, run, interrupted=interrupted)


def without_ros_arguments(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return a command line's own words, and the rest from `--ros-args` on."""
    own = list(words[: words.index("--ros-args")] if "--ros-args" in words else words)
    return own, list(words[len(own) :])


def source_of(options: argparse.Namespace) -> ToolsetSource:
    """Return the source of robot, actions and models that the options of `add_setting` name."""
    given = vars(options)
    names = ("domain", "robot", "map", "action_set", "models")
    return ToolsetSource(**{name: given[name] for name in names if name in given})


def number(least: float = -math.inf, most: float = math.inf) -> Callable[[str], float]:
    """Return a type for argparse: a finite number from `least` to `most`."""
    bounds = [f" {word} {value:g}" for word, value in (("from", least), ("to", most)) if math.isfinite(value)]

    def read(text: str) -> float:
        with contextlib.suppress(ValueError):
            if math.isfinite(value := float(text)) and least <= value <= most:
                return value
        raise argparse.ArgumentTypeError(f"expected a finite number{''.join(bounds)}, got {text!r}")

    return read


def whole(least: int = 0, most: int = 10**12) -> Callable[[str], int]:
    """Return a type for argparse: a whole number from `least` to `most`."""

    def read(text: str) -> int:
        with contextlib.suppress(ValueError):  # Python reads at most 4300 digits
            if text.isdecimal() and least <= int(text) <= most:
                return int(text)
        raise argparse.ArgumentTypeError(f"expected a whole number from {least} to {most}, got {text!r}")

    return read


def jobs(text: str) -> int:
    """Read a number of worker processes, -1 for one per core; a type for argparse."""
    return -1 if text == "-1" else whole(1)(text)


def destination(text: str) -> Path:
    """Read the path of a file that, as far as known beforehand, can be written; a type for argparse."""
    path = Path(text)
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    if path.is_dir() or not folder.is_dir():
        raise argparse.ArgumentTypeError(f"expected a file that can be written, got {text!r}")
    return path


def namespace(text: str) -> str:
    """Read a ROS namespace, with or without the / before it, which is left out; a type for argparse."""
    name = text.removeprefix("/")
    if not _NAMESPACE.fullmatch(name):
        raise argparse.ArgumentTypeError(f"expected a namespace of letters, digits, _ and /, got {text!r}")
    return name


def topic(text: str) -> str:
    """Read the name of a topic, with or without the / before it, as an absolute one; a type for argparse."""
    return f"/{text.removeprefix('/')}"
