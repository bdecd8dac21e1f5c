"""Print the best order and headings of a round of places, and the predicted times.

Places are given as `--place X Y`, or with a heading that is kept as `--place X Y YAW`; or in a YAML
file, as a list of such lists. The robot visits them in the best order, or as listed.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ator_ros.actions.goal_variables import ORDER
from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.evaluation.toolset import tools_of
from ator_ros.files import FileError, atomic_write, read_yaml
from ator_ros.geometry import Pose
from ator_ros.nodes.parameters import driving_top
from ator_ros.nodes.segments import surroundings
from ator_ros.refinement import RefinementError
from ator_ros.refinement.refiner import LONGEST_CHAIN, Refinement, choose
from ator_ros.tools.command_line import add_models, add_setting, number, run_tool, source_of
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.readers import FARTHEST
from ator_ros.world.state import RobotState, World

_coordinate = number(-FARTHEST, FARTHEST)
_LARGEST = 100_000  # bytes of a file of places


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
    calls = []
    for index, (x, y, *yaw) in enumerate(places, start=1):
        opened = set() if yaw else {"yaw"}
        keeps_place = options.as_listed or (options.keep_last and index == len(places))
        if not keeps_place:
            opened.add(ORDER)
        goal = library.goal(top, Pose(x, y, *(yaw or [0.0])))
        calls.append(TopCall(top, goal, frozenset(opened)))
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
        time = action.get("duration", math.nan)
        lines.append(f"{name:>5} {x:7.2f} {y:7.2f} {degrees:7.0f}° {time:6.1f} s")
    before = found.before.duration
    lines.append(
        f"{found.after.duration:.1f} s predicted; {before:.1f} s as listed, naive headings"
    )
    return "\n".join(lines)


def _draw(file: Path, domain: Domain, robot: Robot, start: Pose, found: Refinement) -> None:
    """Draw the round on the map, with straight lines from place to place, and write a PNG file."""
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    axes = figure.add_subplot()
    for lines in surroundings(domain, robot):
        axes.add_collection(LineCollection(list(lines.points), colors="0.6", linewidths=0.8))
    poses = [start, *(call.goal.pose for call in found.best.calls)]
    axes.plot([pose.x for pose in poses], [pose.y for pose in poses], lw=1.2)
    size = 2.0 * robot.reach
    numbers = ["start", *(str(index + 1) for index in found.best.order)]
    for number_text, pose in zip(numbers, poses, strict=True):
        ahead = pose.ahead(size)
        axes.annotate("", (ahead.x, ahead.y), (pose.x, pose.y), arrowprops={"arrowstyle": "->"})
        axes.text(pose.x, pose.y, number_text)
    axes.set_aspect("equal")
    with atomic_write(file) as temporary:
        figure.savefig(temporary, format="png", dpi=130)


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
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw the round")
    add_setting(parser)
    add_models(parser)
    return parser


def _run(options: argparse.Namespace, domain: Domain, _: str) -> None:  # noqa: ARG001
    start = Pose(*options.at)
    places = _places(options)
    tools, library = tools_of(source_of(options))
    chain = _round(library, places, start if options.return_home else None, options)
    world = World(0.0, RobotState(start))
    found = choose(tools.refiner(), world, [chain], placeholders=True).refinement
    print(_table(found, len(places)))
    if options.picture is not None:
        _draw(options.picture, tools.domain, tools.robot, start, found)
        print(f"wrote {options.picture}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, 1 if the places cannot be used."""
    return run_tool(arguments(), _run, argv)
