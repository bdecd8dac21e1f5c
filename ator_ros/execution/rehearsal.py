"""Doing everything once before it counts: no first goal waits for tables to be computed (without ROS)."""

from __future__ import annotations

import contextlib

from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.execution.predictions import Predictor
from ator_ros.geometry import Pose
from ator_ros.refinement.errors import RefinementError
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world.state import BallState, RobotState, World

OPEN = frozenset({"yaw", "speed"})
AWAY = World(0.0, RobotState(Pose(-1.0, 0.5, 1.0)), BallState(0.0, 0.0))


def rehearse_refinement(library: TopLibrary, refiner: Refiner) -> None:
    """Refine the paper's chain once, with the heading and the arrival speed at the ball free."""
    if not {"goToBall", "dribbleBall"} <= set(library):
        return
    calls = (
        TopCall(library["goToBall"], Goal(Pose(0.0, 0.0, 0.0), 0.0, Point.HOLD), OPEN),
        TopCall(library["dribbleBall"], Goal(Pose(2.0, 1.0, 0.0), 0.0, Point.HOLD)),
    )
    with contextlib.suppress(RefinementError):  # then the first request says why
        refiner.refine(AWAY, TopChain(calls))


def rehearse(robot: Robot, library: TopLibrary, predictor: Predictor) -> None:
    """Plan and predict each TOP of `library` once, in a situation where that is possible."""
    x, y = robot.field.goal_centre()
    pose = Pose(x - 2.0, y, 0.2)
    hold = robot.hold_point(pose)
    holding = World(0.0, RobotState(pose), BallState(hold.x, hold.y))
    for top in library.values():
        held = any(term.variable == "hold.x" for term in top.pre.terms)
        world, goal = (holding, Pose(x, y, 0.0)) if held else (AWAY, Pose(0.0, 0.0, 0.0))
        call = TopCall(top, Goal(goal, 0.0, top.point))
        try:
            library.action(top).start(world, call.goal)
        except ActionError:
            continue  # an action from outside may need another situation: its first goal waits a little
        predictor.chain(world, TopChain((call,)))
