"""The options that commands have in common, and the domain by which their names are checked."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from ator_ros.actions import DEFAULT_SET
from ator_ros.experience.parallel import BACKENDS
from ator_ros.printable import printable
from ator_ros.tools.option_types import jobs, number

if TYPE_CHECKING:  # each takes seconds to import, and no help needs it
    from _typeshed import DataclassInstance

    from ator_ros.domains.domain import Domain
    from ator_ros.evaluation.toolset import ToolsetSource

Asked = TypeVar("Asked", bound="DataclassInstance")


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
    from ator_ros.domains.domain import DomainError, domain_for

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


def asked(kind: type[Asked], options: argparse.Namespace, command: str) -> Asked:
    """Return what a command line asks of a domain: each field of `kind` is the option of its name."""
    values = {**vars(options), "command": command}
    return kind(**{field.name: values[field.name] for field in dataclasses.fields(kind)})


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
    """Add the options for parallel work: jobs, backend, cluster."""
    add_jobs(parser)
    parser.add_argument("--backend", choices=BACKENDS, default="loky", help="default: %(default)s")
    parser.add_argument("--cluster", metavar="ADDRESS", help="dask scheduler, as in tcp://host:8786")


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add the option for the number of worker processes."""
    parser.add_argument(
        "--jobs", type=jobs, default=-1, metavar="N", help="worker processes (default: -1, one per core)"
    )
