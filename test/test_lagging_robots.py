"""A robot whose motors lag, and which brakes harder than it gains speed, arrives as exactly as others."""

from __future__ import annotations

import dataclasses

import pytest
from robots import FIFTH

from ator_ros.actions.base import Goal, Point, Status
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.geometry import Pose
from ator_ros.robot.description import Limits
from ator_ros.simulation.run import place, run_action
from ator_ros.simulation.simulation import Simulation
from ator_ros.world.state import ObjectState, RobotState, World

WEAK = dataclasses.replace(
    FIFTH,
    name="weak",
    mass=50.0,
    track=0.4,
    front=0.26,
    rear=0.3,
    half_width=0.24,
    wheel_torque=25.0,
    limits=Limits(v=1.4, w=1.3, a=0.35, brake=0.5, aw=1.8),
)


def test_a_robot_whose_motors_lag_does_not_run_past_the_ball() -> None:
    """It caught up with its plan until it had to brake, came at 0.25 m/s, and went back for three seconds."""
    world = World(0.0, RobotState(Pose(0.530, 0.720, 2.259)), {BALL: ObjectState(-2.024, -0.034)})
    goal = Goal(Pose(-2.024, -0.034, -2.827), 0.0, Point.HOLD)
    with Simulation(WEAK) as simulation:
        place(simulation, world)
        done = run_action(simulation, GoToPose(WEAK), goal)
        assert done.status is Status.SUCCEEDED
        assert simulation.time < 6.0


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_it_drives_backward_as_exactly_as_forward(direction: float) -> None:
    with Simulation(WEAK) as simulation:
        place(simulation, World(0.0, RobotState(Pose(0.0, 0.0, 0.0))))
        done = run_action(simulation, GoToPose(WEAK), Goal(Pose(direction * 2.0, 0.0, 0.0)))
        assert done.status is Status.SUCCEEDED
        assert simulation.world().robot.pose.x == pytest.approx(direction * 2.0, abs=0.02)
        assert simulation.time < 5.5
