"""The options that commands have in common, their types for argparse, and the names that a domain checks."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from ator_ros.actions import DEFAULT_SET
from ator_ros.domains.domain import Domain, DomainError, domain_for
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.experience.parallel import BACKENDS
from ator_ros.files import reserved
from ator_ros.printable import printable
from ator_ros.world.messages import plain_frame

_NAMESPACE = re.compile(r"(?!__)[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_FRAME = re.compile(r"[A-Za-z0-9_][\w.-]*(/[\w.-]+)*", re.ASCII)
_LONGEST_NAME = 100  # characters; names become names of files, which may have 255 bytes
_ROOM = 100_000  # bytes of a result whose size is not known beforehand


def add_setting(parser: argparse.ArgumentParser, *, robot: bool = True, action_set: bool = True) -> None:
    """Add the options that select robot, domain and set of actions."""
    if robot:
        parser.add_argument(
            "--robot", default="", metavar="FILE", help="robot description (default: the shipped one)"
        )
    parser.add_argument(
        "--domain",
        default="",
        metavar="NAME|FILE",
        help="an installed domain, or the YAML file of one (default: soccer for a robot with a holder and a "
        "ball in its scene, drive for any other)",
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
        "--real-time-factor",
        type=number,
        default=default,
        metavar="F",
        help="simulated per real seconds (default: %(default)s); 0: as fast as the robot is steered",
    )


def settled(
    parser: argparse.ArgumentParser,
    words: Sequence[str] | None,
    *,
    needed: bool = True,
    **names: Callable[[Domain], Iterable[str]],
) -> tuple[argparse.Namespace, Domain]:
    """Parse a command line whose names depend on its domain.

    Parameters
    ----------
    parser : ArgumentParser
        With the options of `add_setting`.
    words : sequence of str, optional
        By default those of the process.
    needed : bool
        Whether a domain that has nothing for one of the further options is refused.
    **names : callable
        Of further options, what they may name. An option with one name that was left out gets the first of
        them, one with several all of them.

    Returns
    -------
    Namespace, Domain
        The options and the domain. A name that the domain lacks ends the program as argparse does.
    """
    options = parser.parse_args(words)
    try:
        domain = domain_for(options.domain, options.__dict__.get("robot"))
    except DomainError as error:
        parser.error(printable(error, 1000))
    options.domain = options.domain or domain.name
    if options.__dict__.get("action_set") is not None:
        check_names(parser, "action_set", [options.action_set], domain.action_sets)
    for name, allowed in names.items():
        there, given = list(allowed(domain)), getattr(options, name)
        several = any(action.dest == name and action.nargs for action in parser._actions)
        if needed:
            check_any(parser, name, there, domain)
        if given is None:
            setattr(options, name, there if several else next(iter(there), None))
        else:
            check_names(parser, name, given if several else [given], there)
    return options, domain


def check_any(parser: argparse.ArgumentParser, option: str, there: Iterable[str], domain: Domain) -> None:
    """End the program as argparse does if a domain has nothing that an option could name."""
    if not list(there):
        kind = f"{option.removesuffix('s')}s"
        parser.error(f"argument --domain: expected one with {kind}, got {domain.name}, which has none")


def check_names(
    parser: argparse.ArgumentParser, option: str, given: Iterable[str], allowed: Iterable[str]
) -> None:
    """End the program as argparse does if one of the names given to an option is not allowed."""
    there = list(allowed)
    for name in given:
        if name not in there:
            flag = f"--{option.replace('_', '-')}"
            parser.error(f"argument {flag}: expected one of {', '.join(there)}, got {name[:80]!r}")


def source_of(options: argparse.Namespace) -> ToolsetSource:
    """Return the source of robot, actions and models that the options of `add_setting` name."""
    given = {name: getattr(options, name) for name in ("domain", "robot", "action_set", "models")
             if name in options}  # fmt: skip
    return ToolsetSource(**given)


def add_parallel_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for parallel work: jobs, backend, cluster."""
    add_jobs(parser)
    parser.add_argument("--backend", choices=BACKENDS, default="loky", help="default: %(default)s")
    parser.add_argument("--cluster", metavar="ADDRESS", help="dask scheduler, as in tcp://host:8786")


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add the option for the number of worker processes."""
    parser.add_argument(
        "--jobs", type=jobs, default=-1, metavar="N", help="worker processes (default: -1, one per core)"
    )


def workers(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `add_parallel_options` as arguments of what runs in parallel."""
    return {"jobs": options.jobs, "backend": options.backend, "scheduler": options.cluster}


def finite(text: str) -> float:
    """Read a finite number; a type for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, got {text!r}")
    return value


def number(text: str) -> float:
    """Read a finite number from 0; a type for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a finite number from 0, got {text!r}")
    return value


def jobs(text: str) -> int:
    """Read a number of worker processes, -1 for one per core; a type for argparse."""
    if text == "-1":
        return -1
    try:
        return whole(1)(text)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{error}; or -1, one per core") from error


def destination(text: str) -> Path:
    """Read the path of a file that, as far as known beforehand, can be written; a type for argparse."""
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
    """Return a type for argparse: a whole number from `least`, and up to `most` if that is given."""
    expected = f"a whole number from {least}" + (f" to {most}" if most is not None else "")

    def read(text: str) -> int:
        number = int(text) if text.isdecimal() else least - 1
        if number < least or (most is not None and number > most):
            raise argparse.ArgumentTypeError(f"expected {expected}, got {text!r}")
        return number

    return read


def namespace(text: str) -> str:
    """Read a ROS namespace, with or without the / before it, which is left out; a type for argparse."""
    name = text.removeprefix("/")
    if len(name) > _LONGEST_NAME or not _NAMESPACE.fullmatch(name):
        raise argparse.ArgumentTypeError(
            f"expected a namespace of at most {_LONGEST_NAME} letters, digits, _ and /, got {text[:80]!r}"
        )
    return name


def topic(text: str) -> str:
    """Read the name of a topic, with or without the / before it, as an absolute one; a type for argparse."""
    name = text.removeprefix("/")
    if len(name) > _LONGEST_NAME or not _NAMESPACE.fullmatch(name):
        raise argparse.ArgumentTypeError(f"expected the name of a topic, got {text[:80]!r}")
    return f"/{name}"


def frame(text: str) -> str:
    """Read the name of a frame, with or without a / before it, which is left out; a type for argparse."""
    name = plain_frame(text)
    if len(name) > _LONGEST_NAME or not _FRAME.fullmatch(name):
        raise argparse.ArgumentTypeError(f"expected the name of a frame, got {text[:80]!r}")
    return name
