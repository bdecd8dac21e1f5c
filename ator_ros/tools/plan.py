"""Print the chains of TOPs that achieve a goal with their predictions, the best one first.

A goal is a name that the domain defines, or statements that must all hold: VARIABLE=VALUE, within
the tolerance of the TOPs, or VARIABLE=VALUE:LOW:HIGH, a range around the value. VALUE is a number
or another variable, as in object.x=hold.x:-0.1:0.1.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from ator_ros.bases.description import Robot
from ator_ros.domains.domain import Domain
from ator_ros.geometry import Pose
from ator_ros.planning.goals import GoalStatement, PlanningError, statement_from
from ator_ros.planning.planner import chains_for
from ator_ros.refinement.refiner import Judged, Refiner, choose, rank
from ator_ros.tools.command_line import (
    add_models,
    add_setting,
    number,
    opened_tools,
    run_tool,
    source_of,
)
from ator_ros.tops.chain import TopChain
from ator_ros.world.readers import FARTHEST
from ator_ros.world.state import ObjectState, RobotState, World

_coordinate = number(-FARTHEST, FARTHEST)


def _statements(words: Sequence[str], domain: Domain, robot: Robot) -> list[GoalStatement]:
    if len(words) > 1 or "=" in words[0]:
        return [statement_from(word) for word in words]
    goals = domain.goals(robot)
    if words[0] not in goals:
        names = ", ".join(sorted(goals)) or "none"
        raise PlanningError(
            f"goal: expected a statement or one of the names {names}, got {words[0]!r}"
        )
    return list(goals[words[0]].terms)


def _situation(options: argparse.Namespace, domain: Domain) -> World:
    objects: dict[str, ObjectState] = {}
    for name, *position in options.object:
        if name in objects:
            raise PlanningError(f"object: expected each once, got {name} again")
        if name not in domain.objects:
            raise PlanningError(
                f"object: expected one of {', '.join(domain.objects) or 'none'}, got {name!r}"
            )
        try:
            x, y = map(_coordinate, position)
        except argparse.ArgumentTypeError as error:
            raise PlanningError(f"object {name}: {error}") from error
        objects[name] = ObjectState(x, y)
    return World(0.0, RobotState(Pose(*options.at)), objects)


def _line(judged: Judged, planned: TopChain) -> str:
    """Return predicted duration and refined chain, or the reason why there is no prediction."""
    chain, time = planned, judged
    if not isinstance(judged, str):
        chain, time = judged.chain, f"{judged.predicted.duration:.2f} s"
    steps = []
    for call in chain.calls:
        x, y, yaw = call.goal.pose
        steps.append(f"{call.top.name} ({x:.2f}, {y:.2f}, {yaw:.2f} rad)")
    return f"{time:>8}  {', '.join(steps)}"


def arguments() -> argparse.ArgumentParser:
    """Return the command line of `plan`."""
    parser = argparse.ArgumentParser(prog="plan", description=__doc__)
    parser.add_argument(
        "goal", nargs="*", metavar="GOAL", help="a name or statements (default: print the names)"
    )
    parser.add_argument(
        "--at", nargs=3, type=_coordinate, default=[0.0, 0.0, 0.0], metavar=("X", "Y", "YAW"),
        help="pose of the robot in m and rad (default: the origin)",
    )  # fmt: skip
    parser.add_argument(
        "--object", nargs=3, action="append", default=[], metavar=("NAME", "X", "Y"),
        help="position of an object in m; once for each object",
    )  # fmt: skip
    add_setting(parser)
    add_models(parser)
    return parser


def _plan(options: argparse.Namespace, domain: Domain, _: str) -> None:
    """Print the chains that achieve a goal, the best one first, or the names of goals."""
    source = source_of(options)
    if not options.goal:
        names = ", ".join(sorted(domain.goals(source.described())))
        print(f"goals of {domain.name}: {names or 'none'}")
        return
    world = _situation(options, domain)
    tools, library = opened_tools(source)
    chains = chains_for(
        _statements(options.goal, domain, tools.robot), world, library, domain.objects
    )
    if not chains:
        print("the goal already holds")
        return
    refiner = Refiner(tools.robot, tools.models, ranges=library.ranges)
    judged = choose(refiner, world, chains, placeholders=True).judged
    for each, chain in sorted(zip(judged, chains, strict=True), key=lambda pair: rank(pair[0])):
        print(_line(each, chain))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, 1 without a plan."""
    return run_tool(arguments(), _plan, argv)
