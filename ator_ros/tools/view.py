"""Show and edit robot, chains and their predictions on a page in the browser."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ator_ros.domains.domain import Domain, DomainError, domain_for
from ator_ros.evaluation.toolset import ToolsetSource
from ator_ros.files import FileError
from ator_ros.nodes.network import stay_on_this_machine
from ator_ros.performance.model import PerformanceModel
from ator_ros.performance.model_file import load_models
from ator_ros.robot.description import Robot
from ator_ros.simulation.urdf import robot_urdf
from ator_ros.tools.command_line import (
    add_factor,
    add_models,
    add_setting,
    guarded,
    namespace,
    whole,
    without_ros_arguments,
)
from ator_ros.tools.own_nodes import NodeProcesses, all_nodes
from ator_ros.view.backend import Backend
from ator_ros.view.editor import Editor
from ator_ros.world.messages import plain_frame

_PORTS = (1024, 65535)  # below, only root may listen
_PERIOD = 1.0 / 25.0  # s
# The simulation waits for the executor at any speed, so that a busy machine does not change a chain.
_SIMULATED = {"lockstep": True}
_EXECUTED = {"odom_timeout": 60.0}  # real s, the greatest allowed: a chain may be paused for so long


def serve(options: argparse.Namespace, words: Sequence[str]) -> None:
    """Serve the page until KeyboardInterrupt; `options` are those of `arguments`, `words` ROS arguments.

    Raises
    ------
    NodesError
        Nodes that are needed did not start in time, or cannot be used.
    DomainError, OSError
        The domain has no chains; the page cannot be served at that host.
    """
    from ator_ros.view.page import Page  # needs viser

    found = domain_for(options.domain, options.robot).on_map(options.map)
    if not found.chains:
        raise DomainError(f"domain: expected one with chains, got {found.name}, which has none")
    body = found.robot(options.robot or None)
    named = {name: getattr(options, name) for name in ("robot", "map", "models")}
    source = ToolsetSource(domain=options.domain or found.name, **named)
    nodes: NodeProcesses | None = None
    started: dict[str, Any] = {}
    with contextlib.ExitStack() as closing:
        if options.attach:
            stay_on_this_machine(os.environ)
        else:
            nodes = closing.enter_context(all_nodes(options.real_time_factor, source, _SIMULATED, _EXECUTED))
            started = {"ros_domain": nodes.domain, "check": nodes.check}
            print(f"view: three nodes start on ROS domain {nodes.domain} …", flush=True)
        backends: dict[str, Backend] = {}
        for name in dict.fromkeys(options.robots or [""]):
            space = ["--ros-args", "-r", f"__ns:=/{name}"] if name else []
            backends[name] = Backend(
                found,
                body,
                frame=options.frame or (f"{name}/odom" if name else "odom"),
                arguments=[*words, *space],
                **started,
            )
            closing.callback(backends[name].close)
        for backend in backends.values():
            backend.ready(simulated=not options.attach)
        editor = Editor(next(iter(backends.values())))
        if options.attach:
            editor.select(editor.backend)  # showing running robots must not move them
        known = _models(options.models, found, body)
        shown = backends if options.robots else {}
        page = Page(editor, body, robot_urdf(body), known, robots=shown, host=options.host, port=options.port)
        closing.callback(page.server.stop)
        address = f"http://{options.host}:{page.server.get_port()}"
        print(f"view: open {address} in a browser; Ctrl-C ends it", flush=True)
        while True:
            if nodes is not None:
                nodes.check()
            for backend in backends.values():
                backend.spin(_PERIOD / len(backends))
            editor.step(page.take_commands())
            page.update(time.monotonic())


def _models(folder: str, domain: Domain, robot: Robot) -> Mapping[str, Mapping[str, PerformanceModel]]:
    """Read the models of all action sets; sets without models are left out."""
    found = {}
    for name in domain.action_sets:
        with contextlib.suppress(FileError, OSError):
            place = Path(folder) if folder else domain.shipped_models
            found[name] = load_models(robot, domain.known_features, action_set=name, folder=place)
    return found


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `view`."""
    parser = argparse.ArgumentParser(
        prog="view", description=__doc__, usage="%(prog)s [options] [--ros-args ...]"
    )
    parser.add_argument("--port", type=whole(*_PORTS), default=8080, help="default: %(default)s")
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to serve at (default: %(default)s: this machine only)"
    )
    parser.add_argument(
        "--attach", action="store_true", help="use running nodes, instead of starting simulation and others"
    )
    parser.add_argument(
        "--robots",
        nargs="+",
        type=namespace,
        default=[],
        metavar="NAMESPACE",
        help="with --attach: robots to show, each with the nodes of its namespace; one is chosen on the page",
    )
    parser.add_argument(
        "--frame", type=plain_frame, help="frame of odometry (default: odom; with --robots NAMESPACE/odom)"
    )
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
        parser.error("--robots: expected --attach, too: what it names must run")

    def run() -> None:
        with contextlib.suppress(KeyboardInterrupt):  # its usual end
            serve(options, ros)

    return guarded("view", run)
