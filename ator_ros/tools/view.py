"""Show and edit robot, chains and their predictions on a page in the browser."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from ator_ros.bases.description import Robot
from ator_ros.domains.available_models import models_for
from ator_ros.domains.domain import Domain, DomainError, domain_for
from ator_ros.files import FileError, is_name
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.performance.model import PerformanceModel
from ator_ros.printable import quoted
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.tools.command_line import (
    add_factor,
    add_models,
    add_setting,
    guarded,
    source_of,
    whole,
    without_ros_arguments,
)
from ator_ros.tools.own_nodes import all_nodes
from ator_ros.view.backend import Backend
from ator_ros.view.editor import Editor
from ator_ros.world.readers import plain_frame

_PERIOD = 1.0 / 25.0  # s
_WATCHED_PERIOD = 0.5  # s; estimates come twice a second
# a busy machine must not change a chain, whatever the simulation's speed
_SIMULATED = {"lockstep": True}
_EXECUTED = {"odom_timeout": 60.0}  # real s, the greatest allowed: the longest pause of a chain


def serve(options: argparse.Namespace, words: Sequence[str]) -> None:
    """Serve the page until KeyboardInterrupt.

    `options` are those of `arguments`, `words` are ROS arguments. Raises NodesError if nodes do not
    start in time, DomainError if the domain has no chains, and OSError if the page cannot be served
    at this host.
    """
    from ator_ros.view.page import Page  # needs viser

    domain = domain_for(options.domain, options.robot).on_map(options.map)
    if not domain.chains:
        raise DomainError(f"domain: expected one with chains, got {domain.name}, which has none")
    robot = domain.robot(options.robot or None)
    options.domain = options.domain or domain.name
    started: dict[str, Any] = {}
    with contextlib.ExitStack() as closing:
        if options.attach:
            stay_on_this_machine(os.environ)
        else:
            source = source_of(options)
            nodes = closing.enter_context(
                all_nodes(options.real_time_factor, source, _SIMULATED, _EXECUTED)
            )
            started = {"ros_domain": nodes.domain, "check": nodes.check}
            print(f"view: three nodes start on ROS domain {nodes.domain} …", flush=True)
        backends: dict[str, Backend] = {}
        for name in dict.fromkeys(options.robots or [""]):
            remapping = ["--ros-args", "-r", f"__ns:=/{name}"] if name else []
            frame = options.frame or (f"{name}/odom" if name else "odom")
            backend = Backend(domain, robot, frame=frame, arguments=[*words, *remapping], **started)
            closing.callback(backend.close)
            backends[name or "robot"] = backend
        for backend in backends.values():
            backend.ready(simulated=not options.attach)
        editor = Editor(next(iter(backends.values())))
        if options.attach:
            editor.select(editor.backend)  # showing running robots must not move them
        page = Page(
            editor,
            robot,
            robot_urdf(robot),
            _models(options.models, domain, robot),
            robots=backends,
            host=options.host,
            port=options.port,
        )
        closing.callback(page.server.stop)
        # viser warns of messages to a page that is closed
        closing.callback(warnings.simplefilter, "ignore")
        _print_address(options.host, page.server.get_port())
        while True:
            for backend in backends.values():
                backend.spin(_PERIOD / len(backends))
            editor.step(page.take_commands())
            page.update(time.monotonic())


def serve_watched(options: argparse.Namespace, words: Sequence[str]) -> None:
    """Serve the page of a node `watch` until KeyboardInterrupt, as `serve` does for chains."""
    from ator_ros.view.watched import WatchClient, WatchedPage  # needs viser

    stay_on_this_machine(os.environ)
    with contextlib.ExitStack() as closing:
        client = WatchClient(words)
        closing.callback(client.close)
        page = WatchedPage(client.domain, client.robot, host=options.host, port=options.port)
        closing.callback(page.server.stop)
        closing.callback(warnings.simplefilter, "ignore")
        _print_address(options.host, page.server.get_port())
        while True:
            client.spin(_WATCHED_PERIOD)
            page.update(client.watched())


def _print_address(host: str, port: int) -> None:
    print(f"view: open http://{host}:{port} in a browser; Ctrl-C stops the view", flush=True)


def _models(
    folder: str, domain: Domain, robot: Robot
) -> Mapping[str, Mapping[str, PerformanceModel]]:
    """Return the models of each action set whose files can be read."""
    models = {}
    for name in domain.action_sets:
        with contextlib.suppress(FileError, OSError):
            models[name] = models_for(domain, robot, action_set=name, folder=folder)
    return models


def _namespace(text: str) -> str:
    name = text.removeprefix("/")
    if not all(map(is_name, name.split("/"))):
        raise argparse.ArgumentTypeError(
            f"expected a namespace of letters, digits, _ and /, got {quoted(text)}"
        )
    return name


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `view`."""
    parser = argparse.ArgumentParser(
        prog="view", description=__doc__, usage="%(prog)s [options] [--ros-args ...]"
    )
    parser.add_argument(
        "--port", type=whole(1024, 65535), default=8080, help="default: %(default)s"
    )
    parser.add_argument(
        "--host", default="127.0.0.1",
        help="address to serve at (default: %(default)s: this machine only)",
    )  # fmt: skip
    parser.add_argument(
        "--attach", action="store_true", help="use running nodes instead of starting nodes"
    )
    parser.add_argument(
        "--watched", action="store_true",
        help="show what the node watch has learned from running drives, as beside Nav2",
    )  # fmt: skip
    parser.add_argument(
        "--robots", nargs="+", type=_namespace, default=[], metavar="NAMESPACE",
        help="with --attach: namespaces of the robots to show; the page selects one",
    )  # fmt: skip
    parser.add_argument(
        "--frame", type=plain_frame,
        help="frame of odometry (default: odom; with --robots NAMESPACE/odom)",
    )  # fmt: skip
    add_setting(parser, action_set=False)
    add_models(parser)
    add_factor(parser, 1.0)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line until Ctrl-C or SIGTERM; return the exit code."""
    own, ros = without_ros_arguments(sys.argv[1:] if argv is None else argv)
    parser = arguments()
    options = parser.parse_args(own)
    if options.robots and not options.attach:
        parser.error("--robots: expected --attach, too: the nodes of these robots must run")
    if options.watched and options.attach:
        parser.error("--watched: expected without --attach, it is a page of its own")

    # not in `guarded`: its imports may lose a KeyboardInterrupt
    with contextlib.suppress(ImportError):
        import_module(f"ator_ros.view.{'watched' if options.watched else 'page'}")

    def run() -> None:
        with contextlib.suppress(KeyboardInterrupt):  # the usual end
            if options.watched:
                serve_watched(options, ros)
            else:
                serve(options, ros)

    return guarded("view", run)
