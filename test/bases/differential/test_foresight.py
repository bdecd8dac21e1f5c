"""Delayed states are extrapolated to the time at which their command moves the base."""

from collections import deque

import numpy as np
import pytest

from ator_ros.bases.description import load_robot
from ator_ros.bases.foresight import Foresight
from ator_ros.geometry import Pose
from ator_ros.simulation.scene_simulation import TICK, Simulation
from ator_ros.world.state import STOP, Command, RobotState, World

ROBOT = load_robot()
STANDING = RobotState(Pose(0.0, 0.0, 0.0))


def stepped(value: float, goal: float, acceleration: float) -> float:
    """Return a velocity after a tick of acceleration toward `goal`."""
    return value + float(np.clip(goal - value, -acceleration * TICK, acceleration * TICK))


@pytest.mark.parametrize("ticks", [1, 4])
def test_foresight_matches_the_simulated_base(ticks: int) -> None:
    rng, limits = np.random.default_rng(5), ROBOT.limits
    foresight, observed, worst = (
        Foresight(ROBOT, ticks * TICK),
        deque[World](maxlen=ticks + 1),
        np.zeros(2),
    )
    command = STOP
    with Simulation(ROBOT) as simulation:
        for tick in range(200):
            if tick % 20 == 0:
                goal = Command(*rng.uniform((-0.8, -1.5), (0.8, 1.5)))
            observed.append(simulation.world())
            if len(observed) > ticks:
                foreseen = foresight.ahead(observed[0])
                assert foreseen.time == pytest.approx(observed[-1].time)
                off = observed[-1].robot.pose.relative(foreseen.robot.pose)
                worst = np.maximum(worst, np.abs((np.hypot(off.x, off.y), off.yaw)))
            command = Command(
                stepped(command.vx, goal.vx, limits.a), stepped(command.w, goal.w, limits.aw)
            )
            if tick % 50 > 40:  # a stop, harder than in any plan
                command = STOP
            foresight.sent(observed[0].time, command)
            simulation.command(command)
            simulation.tick()
    assert worst[0] < 0.008 * ticks  # the motor lag is not predicted
    assert worst[1] < 0.02 * ticks


def test_only_a_robot_at_rest_is_delayed() -> None:
    go, moving = Command(0.1, 0.0), RobotState(Pose(0.0, 0.0, 0.0), 0.3)
    assert Foresight(ROBOT, 0.1).punctual(STANDING, go, 0.001) == go
    assert Foresight(ROBOT, 0.1).punctual(STANDING, go, 0.1) == STOP
    assert Foresight(ROBOT, 0.1).punctual(moving, go, 0.1) == go
    assert Foresight(ROBOT, 0.0).punctual(STANDING, go, 0.1) == go
