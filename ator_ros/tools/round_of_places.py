"""Print the best order and headings of a round of places, and the predicted times.

Places are given as `--place X Y`, or with a heading that is kept as `--place X Y YAW`; or in a YAML
file, as a list of such lists. The robot visits them in the best order, or as listed.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rclpy
from matplotlib.figure import Figure
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.execution.fence import Fence
from ator_ros.files import FileError, atomic_write, read_yaml
from ator_ros.geometry import Pose
from ator_ros.nodes.chain_client import ChainClient
from ator_ros.nodes.main_loop import uninterrupted
from ator_ros.nodes.messages import chain_of
from ator_ros.nodes.network import NodesError, stay_on_this_machine
from ator_ros.nodes.parameters import driving_top
from ator_ros.nodes.result_line import result_line
from ator_ros.nodes.segments import route_line
from ator_ros.refinement import RefinementError
from ator_ros.refinement.refiner import LONGEST_CHAIN, Refinement, choose
from ator_ros.tools.command_line import (
    add_models,
    add_setting,
    number,
    opened_tools,
    run_tool,
    source_of,
)
from ator_ros.tools.floor_plan import BLUE, draw_floor, draw_stations
from ator_ros.tops.chain import AllowedRange, TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.readers import FARTHEST
from ator_ros.world.state import RobotState, World

_coordinate = number(-FARTHEST, FARTHEST)
_angle = number(-math.tau, math.tau)
_LARGEST = 100_000  # bytes of a file of places
# real s in which DDS finds a running executor: two of its announcements, every 3 s
_DISCOVERY = 6.0


def _places(options: argparse.Namespace) -> list[list[float]]:
    """Return the places: x, y (m), and perhaps yaw (rad)."""
    listed: list[Any] = list(options.place)
    if options.places is not None:
        read = read_yaml(options.places, largest=_LARGEST)
        if not isinstance(read, list):
            raise FileError(
                f"{options.places}: expected a list of places, got {type(read).__name__}"
            )
        listed += read
    places = []
    for index, place in enumerate(listed, start=1):
        try:
            values = [_coordinate(str(value)) for value in place]
        except (argparse.ArgumentTypeError, TypeError) as error:
            raise RefinementError(f"place {index}: {error}") from None
        if len(values) not in (2, 3):
            raise RefinementError(
                f"place {index}: expected X Y or X Y YAW, got {len(values)} values"
            )
        places.append(values)
    if not 1 <= len(places) < LONGEST_CHAIN:
        raise RefinementError(f"expected 1 to {LONGEST_CHAIN - 1} places, got {len(places)}")
    return places


def _round(
    library: TopLibrary,
    places: Sequence[Sequence[float]],
    home: Pose | None,
    options: argparse.Namespace,
) -> TopChain:
    """Return the chain to all places, and to `home` if it is given."""
    top = driving_top(library)
    ends_fixed = home is not None or options.as_listed or options.keep_last
    calls = []
    for index, (x, y, *yaw) in enumerate(places, start=1):
        is_last = home is None and index == len(places)
        call = library.station(
            top,
            Pose(x, y, *(yaw or [0.0])),
            keeps_place=options.as_listed or (options.keep_last and index == len(places)),
            keeps_heading=bool(yaw),
            may_pass=options.passing,
            passes=not is_last,
            may_be_last=is_last or not ends_fixed,
        )
        headings = [] if yaw else options.headings
        allowed = tuple(AllowedRange("yaw", low, high) for low, high in headings)
        call = dataclasses.replace(call, allowed=allowed)
        calls.append(call.within_allowed(library.robot, library.ranges))
    if home is not None:
        calls.append(TopCall(top, library.goal(top, home)))
    return TopChain(tuple(calls))


def _table(found: Refinement, places: int) -> str:
    """Return a line for each place in the order of the round, and one for the whole."""
    lines = ["place       x       y  heading    time"]
    chain = found.best
    for index, call, action in zip(chain.order, chain.calls, found.after.actions, strict=True):
        name = str(index + 1) if index < places else "home"
        x, y, yaw = call.goal.pose
        degrees = math.degrees(math.remainder(yaw, math.tau))
        heading = "passed" if call.passing else f"{degrees:.0f}°"
        duration = action.get("duration", math.nan)
        lines.append(f"{name:>5} {x:7.2f} {y:7.2f} {heading:>8} {duration:6.1f} s")
    before = found.before.duration
    lines.append(
        f"{found.after.duration:.1f} s predicted; {before:.1f} s as listed, naive headings"
    )
    return "\n".join(lines)


def _draw(file: Path, domain: Domain, robot: Robot, start: Pose, found: Refinement) -> None:
    """Draw the round along its routes on the map, and write a PNG file."""
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    axes = figure.add_subplot()
    draw_floor(axes, domain, robot)
    poses = [start, *(call.goal.pose for call in found.best.calls)]
    for before, after in itertools.pairwise(poses):
        axes.plot(*route_line(before, after, robot).T, lw=1.2, color=BLUE)
    size = 2.0 * robot.reach
    for pose in poses:
        ahead = pose.ahead(size)
        axes.annotate("", (ahead.x, ahead.y), (pose.x, pose.y), arrowprops={"arrowstyle": "->"})
    axes.plot(start.x, start.y, "s", color=BLUE, ms=6)
    draw_stations(axes, found.best)
    with atomic_write(file) as temporary:
        figure.savefig(temporary, format="png", dpi=130)


def _execute(chain: TopChain, action_set: str) -> None:
    """Send the chain, as it is, to the running executor, and print how it ended.

    Raises NodesError without an executor, or if the chain failed.
    """
    calls = tuple(dataclasses.replace(call, open=frozenset(), after=()) for call in chain.calls)
    message = chain_of(TopChain(calls), action_set=action_set, frame="")
    stay_on_this_machine(os.environ)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = Node("round")
    try:
        client = ChainClient(node)
        end = time.monotonic() + _DISCOVERY
        while not client.is_ready() and time.monotonic() < end:
            _spin(node)
        sent = client.send(ExecuteChain.Goal(chain=message))
        try:
            while not sent.result.done():
                _spin(node)
        except KeyboardInterrupt:
            sent.cancel()
            _spin(node)
            raise
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    result = sent.result.result()
    if result.outcome.code != Outcome.SUCCEEDED:
        raise NodesError(result.outcome.reason)
    print(result_line(result.record, wanted=False, changes=()))


def _spin(node: Node) -> None:
    with uninterrupted():
        rclpy.spin_once(node, timeout_sec=0.1)


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `round`."""
    parser = argparse.ArgumentParser(prog="round", description=__doc__)
    parser.add_argument(
        "--place", nargs="+", action="append", default=[], metavar="X",
        help="X Y or X Y YAW in m and rad; once for each place",
    )  # fmt: skip
    parser.add_argument("--places", type=Path, metavar="FILE", help="YAML file with more places")
    parser.add_argument(
        "--at", nargs=3, type=_coordinate, default=[0.0, 0.0, 0.0], metavar=("X", "Y", "YAW"),
        help="pose of the robot in m and rad (default: the origin)",
    )  # fmt: skip
    parser.add_argument("--as-listed", action="store_true", help="keep the order of the places")
    parser.add_argument("--keep-last", action="store_true", help="end at the last place")
    parser.add_argument("--return-home", action="store_true", help="end where the robot is")
    parser.add_argument(
        "--passing", action="store_true", help="the robot need not stop at places without a heading"
    )
    parser.add_argument(
        "--headings", nargs=2, type=_angle, action="append", default=[], metavar=("LOW", "HIGH"),
        help="rad, from LOW counter-clockwise to HIGH; headings at places without one lie within "
        "one of these ranges",
    )  # fmt: skip
    parser.add_argument(
        "--execute", action="store_true",
        help="send the round to the running executor, with the order and headings printed",
    )  # fmt: skip
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw the round")
    add_setting(parser)
    add_models(parser)
    return parser


def _run(options: argparse.Namespace, domain: Domain, _: str) -> None:  # noqa: ARG001
    start = Pose(*options.at)
    places = _places(options)
    tools, library = opened_tools(source_of(options))
    chain = _round(library, places, start if options.return_home else None, options)
    fence = Fence.around(tools.robot)
    if fault := fence.unreachable(chain, tools.robot, "round", start=start[:2]):
        raise RefinementError(fault)
    world = World(0.0, RobotState(start))
    found = choose(tools.refiner(), world, [chain], placeholders=True).refinement
    print(_table(found, len(places)))
    if options.picture is not None:
        _draw(options.picture, tools.domain, tools.robot, start, found)
        print(f"wrote {options.picture}")
    if options.execute:
        _execute(found.best, library.action_set)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, 1 if the places cannot be used."""
    return run_tool(arguments(), _run, argv)
