"""Actions on robots that differ from their description: slower, but without a second approach."""

import dataclasses
from dataclasses import dataclass

import pytest

from ator_ros.actions.base import Action, Goal, Point, Status, Step
from ator_ros.bases.description import load_robot
from ator_ros.bases.differential.limits import Limits
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.go_to_ball import GoToPoseOrBall as GoToPose
from ator_ros.geometry import Pose
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.state import ObjectState, RobotState, World

PIONEER = load_robot()
_V, _W, _A, _BRAKE, _AW, _ = dataclasses.astuple(PIONEER.limits)
ROBOTS = {
    "described": PIONEER,
    "weak": dataclasses.replace(PIONEER, limits=Limits(_V, _W, 0.7 * _A, _BRAKE, 0.7 * _AW)),
    "lagging": dataclasses.replace(PIONEER, motor_time_constant=0.12),
}
"""As described; with motors that accelerate by 70 % of that; with a lag of 0.12 s."""


@dataclass(frozen=True)
class Drive:
    """Result of an action: duration in s, number of replans, last status."""

    time: float
    plans: int
    status: Status


def drive(robot: str, action: Action, start: World, goal: Goal) -> Drive:
    plans = 0

    def counted(action: Action, world: World) -> Step:
        nonlocal plans
        step = action.step(world)
        plans += "planned again" in step.message or "; planning" in step.message
        return step

    with Simulation(ROBOTS[robot]) as simulation:
        place(simulation, start)
        done = run_action(simulation, action, goal, step=counted)
        return Drive(simulation.time, plans, done.status)


def approach(robot: str, bearing: float, yaw: float) -> Drive:
    """Approach a ball 3.5 m away, from a start turned by `bearing` (rad), to hold it at `yaw`."""
    ball = ObjectState(1.8, 0.0)
    start = World(0.0, RobotState(Pose(-1.7, 0.0, bearing)), {BALL: ball})
    return drive(robot, GoToPose(PIONEER), start, Goal(Pose(ball.x, ball.y, yaw), 0.0, Point.HOLD))


def test_a_plan_slows_down_for_a_weaker_robot() -> None:
    """The plan's time is scaled, so that the robot stays on its path and captures the ball."""
    described, changed = approach("described", 2.2, 1.9), approach("weak", 2.2, 1.9)
    assert changed.status is Status.SUCCEEDED
    assert changed.plans == 0
    assert described.time <= changed.time < 1.3 * described.time


@pytest.mark.parametrize(("bearing", "yaw"), [(0.0, 0.0), (2.2, 1.9)])
def test_a_robot_whose_motors_lag_brakes_in_time(bearing: float, yaw: float) -> None:
    """The controller looks ahead by the measured lag, so that the robot does not hit the ball."""
    described, changed = approach("described", bearing, yaw), approach("lagging", bearing, yaw)
    assert changed.status is Status.SUCCEEDED
    assert changed.plans == 0
    assert changed.time < 1.2 * described.time
