"""Doing everything once before it counts: no first goal waits for tables to be computed (without ROS)."""

from __future__ import annotations

from ator_ros.actions.base import ActionError, Goal
from ator_ros.geometry import Pose
from ator_ros.nodes.predictions import Predictor
from ator_ros.robot import Robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.tops.library import TopLibrary
from ator_ros.world import BallState, RobotState, World


def rehearse(robot: Robot, library: TopLibrary, predictor: Predictor) -> None:
    """Plan and predict each TOP of `library` once, in a situation where that is possible."""
    x, y = robot.field.goal_centre()
    pose = Pose(x - 2.0, y, 0.2)
    hold = robot.hold_point(pose)
    holding = World(0.0, RobotState(pose), BallState(hold.x, hold.y))
    away = World(0.0, RobotState(Pose(-1.0, 0.5, 1.0)), BallState(0.0, 0.0))
    for top in library.values():
        held = any(term.variable == "hold.x" for term in top.pre.terms)
        world, goal = (holding, Pose(x, y, 0.0)) if held else (away, Pose(0.0, 0.0, 0.0))
        call = TopCall(top, Goal(goal, 0.0, top.point), frozenset())
        try:
            library.action(top).start(world, call.goal)
        except ActionError:
            continue  # an action from outside may need another situation: its first goal waits a little
        predictor.chain(world, TopChain((call,)))
