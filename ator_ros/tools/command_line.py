"""Shared by all command lines: options, checks of names, errors and exit codes."""

from __future__ import annotations

import argparse
import contextlib
import io
import signal
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from pathlib import Path

from ator_ros.actions import DEFAULT_SET
from ator_ros.compiled import is_cached
from ator_ros.domains.domain import Domain, domain_for
from ator_ros.evaluation.toolset import Toolset, ToolsetSource, tools_of
from ator_ros.experience.parallel import BackendError, workers
from ator_ros.files import portable_command
from ator_ros.printable import ReadableError, one_line, quoted
from ator_ros.start import INTERRUPTED
from ator_ros.tops.library import TopLibrary

_LONGEST_LINE = 600  # characters, as of the longest error
RESUMES = "the same command resumes from here"


def guarded(
    program: str, work: Callable[[], object], *, interrupted: str = "nothing was written"
) -> int:
    """Run a command and return its exit code; an error for the user is printed in one line.

    SIGTERM and SIGHUP interrupt it like Ctrl-C, unless they are ignored (nohup); `interrupted` is
    the message then. Characters that the terminal cannot encode are escaped.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with _interrupted_by_signals(), warnings.catch_warnings():
            warnings.showwarning = _first_warnings(program)
            work()
            return 0
    except KeyboardInterrupt:
        print(f"{program}: interrupted; {interrupted}", file=sys.stderr)
        return INTERRUPTED
    except ImportError as error:
        print(f"{program}: {error}: docs/install.md describes how to install it", file=sys.stderr)
        return 1
    except (ReadableError, BackendError, OSError) as error:
        lines = filter(None, (line.strip() for line in str(error).splitlines()))
        print(f"{program}: {one_line('; '.join(lines), _LONGEST_LINE)}", file=sys.stderr)
        return 1


def _first_warnings(program: str) -> Callable[..., None]:
    """Return a function that prints the first warning of each category."""
    printed: set[type[Warning]] = set()

    def show(text: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        if category not in printed:
            printed.add(category)
            print(f"{program}: {text}", file=sys.stderr)

    return show


@contextlib.contextmanager
def _interrupted_by_signals() -> Iterator[None]:
    """Make SIGINT, SIGTERM and SIGHUP raise KeyboardInterrupt, unless they are ignored."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    previous = {number: signal.getsignal(number) for number in numbers}
    changed = [number for number in numbers if previous[number] is not signal.SIG_IGN]
    for number in changed:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in changed:
            signal.signal(number, previous[number])


def add_setting(parser: argparse.ArgumentParser, *, action_set: bool = True) -> None:
    """Add the options for robot, domain, map and action set."""
    parser.add_argument(
        "--robot", default="", metavar="FILE", help="robot description (default: the shipped one)"
    )
    parser.add_argument(
        "--domain", default="", metavar="NAME|FILE",
        help="an installed domain, or the YAML file of one (default: soccer for a robot with a "
        "holder and a ball in its scene, drive for any other)",
    )  # fmt: skip
    parser.add_argument(
        "--map", default="", metavar="FILE",
        help="map_server file of the building (default: the domain's)",
    )  # fmt: skip
    if action_set:
        parser.add_argument(
            "--action-set", default=DEFAULT_SET, metavar="NAME",
            help="of the domain (default: %(default)s)",
        )  # fmt: skip


def add_nav2(parser: argparse.ArgumentParser) -> None:
    """Add the option that finds out robot, domain and map; `run_tool` uses it."""
    parser.add_argument(
        "--nav2", nargs="?", const="", metavar="NAMESPACE",
        help="robot, domain and map as nav2.launch.xml finds them out of a running Nav2",
    )  # fmt: skip


def _find_nav2(options: argparse.Namespace) -> None:
    """Set the options that are not given to what a running Nav2 shows; raises ReadableError."""
    from ator_ros.nodes import nav2_setup  # needs ROS

    made = nav2_setup.set_up(options.nav2)
    options.robot = options.robot or str(made / nav2_setup.ROBOT_FILE)
    options.domain = options.domain or str(made / nav2_setup.DOMAIN_FILE)
    options.map = options.map or str(made / nav2_setup.MAP_FILE)


def add_models(parser: argparse.ArgumentParser) -> None:
    """Add the option for the performance models."""
    parser.add_argument(
        "--models", default="", metavar="DIR", help="folder of the models (default: as shipped)"
    )


def add_factor(parser: argparse.ArgumentParser, default: float) -> None:
    """Add the option for the speed of the simulation."""
    parser.add_argument(
        "--real-time-factor", type=number(0.0), default=default, metavar="F",
        help="simulated per real seconds (default: %(default)s); 0: as fast as possible",
    )  # fmt: skip


def add_parallel_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for parallel work: jobs and cluster."""
    parser.add_argument(
        "--jobs", type=_jobs, default=-1, metavar="N",
        help="worker processes (default: -1, one per core)",
    )  # fmt: skip
    parser.add_argument(
        "--cluster", metavar="ADDRESS", help="address of a dask scheduler, such as tcp://host:8786"
    )


def run_tool(
    parser: argparse.ArgumentParser,
    work: Callable[[argparse.Namespace, Domain, str], None],
    argv: Sequence[str] | None,
    *,
    interrupted: str = "nothing was written",
    needed: bool = True,
    **names: Callable[[Domain], Iterable[str]],
) -> int:
    """Parse a command line whose names depend on its domain, run `work`, and return the exit code.

    Parameters
    ----------
    parser : ArgumentParser
        Has the options of `add_setting`.
    work : callable
        Is called with the options, the domain, and the command line for records.
    needed : bool
        Whether a domain without names for one of the options in `names` is an error.
    **names : callable
        For further options, return the names that a domain allows. An option without a value
        becomes the first name or, if its default is a list, all names.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    options = parser.parse_args(words)
    if not is_cached():
        print(
            f"{parser.prog}: the first start compiles code, which may take a minute",
            file=sys.stderr,
        )
    try:
        if getattr(options, "nav2", None) is not None:
            _find_nav2(options)
        domain = domain_for(options.domain, options.robot).on_map(options.map)
    except (ReadableError, OSError) as error:
        # parser.error would print the usage, which does not help with an error in a domain's file.
        parser.exit(2, f"{parser.prog}: error: {one_line(error, _LONGEST_LINE)}\n")
    options.domain = options.domain or domain.name
    if "action_set" in options and options.action_set:
        _check_names(parser, "action_set", [options.action_set], domain.action_sets)
    for name, allowed in names.items():
        choices = list(allowed(domain))
        given = getattr(options, name)
        is_list = isinstance(given, list)
        if needed and not choices:
            parser.error(
                f"argument --domain: expected one with names for --{name}, got {domain.name}, "
                "which has none"
            )
        if given:
            _check_names(parser, name, given if is_list else [given], choices)
        else:
            setattr(options, name, choices if is_list else next(iter(choices), None))
    command = portable_command(parser.prog, words)

    def run() -> None:
        parallel = "jobs" in options  # see `add_parallel_options`
        with workers(options.jobs, options.cluster) if parallel else contextlib.nullcontext():
            work(options, domain, command)

    return guarded(parser.prog, run, interrupted=interrupted)


def _check_names(
    parser: argparse.ArgumentParser, option: str, given: Iterable[str], allowed: Collection[str]
) -> None:
    for name in given:
        if name not in allowed:
            flag = f"--{option.replace('_', '-')}"
            expected = ", ".join(allowed)
            parser.error(f"argument {flag}: expected one of {expected}, got {quoted(name)}")


def without_ros_arguments(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the words before `--ros-args`, and the rest."""
    own = list(words[: words.index("--ros-args")] if "--ros-args" in words else words)
    return own, list(words[len(own) :])


def source_of(options: argparse.Namespace) -> ToolsetSource:
    """Return the source of robot, actions and models for the options of `add_setting`."""
    names = ("domain", "robot", "map", "action_set", "models")
    return ToolsetSource(**{name: getattr(options, name) for name in names if name in options})


def opened_tools(source: ToolsetSource) -> tuple[Toolset, TopLibrary]:
    """Return toolset and library; mention actions without a learned model on standard error.

    Raises FileError for a model that cannot be used.
    """
    tools, library = tools_of(source)
    if tools.remark:
        print(tools.remark, file=sys.stderr)
    return tools, library


def number(least: float, most: float = 1e12) -> Callable[[str], float]:
    """Return an argparse type: a number from `least` to `most`."""

    def read(text: str) -> float:
        with contextlib.suppress(ValueError):
            value = float(text)
            if least <= value <= most:
                return value
        expected = f"a number from {least:g} to {most:g}"
        raise argparse.ArgumentTypeError(f"expected {expected}, got {quoted(text)}")

    return read


def whole(least: int = 0, most: int = 10**12) -> Callable[[str], int]:
    """Return an argparse type: a whole number from `least` to `most`."""

    def read(text: str) -> int:
        with contextlib.suppress(ValueError):  # Python reads at most 4300 digits
            if text.isdecimal() and least <= int(text) <= most:
                return int(text)
        expected = f"a whole number from {least} to {most}"
        raise argparse.ArgumentTypeError(f"expected {expected}, got {quoted(text)}")

    return read


def _jobs(text: str) -> int:
    return -1 if text == "-1" else whole(1)(text)


def destination(text: str) -> Path:
    """Check the path of a file to write, as far as possible beforehand; an argparse type."""
    path = Path(text)
    try:
        folder = next(parent for parent in path.absolute().parents if parent.exists())
        usable = folder.is_dir() and not path.is_dir()
    except OSError:  # such as of a name that is too long
        usable = False
    if not usable:
        expected = "expected a file that can be written"
        raise argparse.ArgumentTypeError(f"{expected}, got {quoted(text)}")
    return path
