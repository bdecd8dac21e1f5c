"""Commands that come late at the start, as on a computer that plans slowly, cost that time and no more."""

from __future__ import annotations

import pytest

from ator_ros.actions.base import Goal, Point, Status
from ator_ros.domains.soccer.field import ball_of
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.geometry import Pose
from ator_ros.robot.description import load_robot
from ator_ros.simulation.simulation import TICK, Simulation
from ator_ros.world.state import STOP

ROBOT = load_robot()
BALL = (0.0, 0.0)
ALLOWANCE = 2 * TICK


def approach(late: int, unseen: int = 0) -> tuple[float, float]:
    """Drive to a ball; give the duration and how far the ball moved.

    The first `late` commands are lost, and then the action does not see the next `unseen` states.
    """
    with Simulation(ROBOT) as simulation:
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))
        simulation.place_object("ball", *BALL)
        action = GoToPose(ROBOT)
        action.start(simulation.world(), Goal(Pose(*BALL, 0.0), 0.0, Point.HOLD))
        for tick in range(400):
            world = simulation.world()
            if not 0 < tick - late + 1 <= unseen:
                step = action.step(world)
            if step.status is not Status.RUNNING:
                break
            simulation.command(STOP if tick < late else step.command)
            simulation.tick()
        assert step.status is Status.SUCCEEDED, step.message
        assert ball_of(world) is not None
        return world.time, abs(ball_of(world).x) + abs(ball_of(world).y)


@pytest.mark.parametrize("late", [1, 2, 10, 11])
def test_a_late_start_costs_its_delay_and_the_ball_stays(late: int) -> None:
    punctual, _ = approach(0)
    duration, moved = approach(late)
    assert duration <= punctual + late * TICK + ALLOWANCE
    assert moved < 0.02


@pytest.mark.parametrize("late", [1, 2, 5])
def test_a_state_that_is_missed_at_the_start_costs_its_time_and_the_ball_stays(late: int) -> None:
    punctual, _ = approach(0)
    duration, moved = approach(late, unseen=1)
    assert duration <= punctual + (late + 1) * TICK + ALLOWANCE
    assert moved < 0.02


@pytest.mark.parametrize("goal", [Pose(2.0, 1.0, 0.0), Pose(-1.0, 1.0, 2.0), Pose(0.0, 0.0, 3.0)])
def test_odometry_at_5_hz_is_enough_for_a_base_that_keeps_its_commands(goal: Pose) -> None:
    durations = []
    for apart in (1, 4):  # ticks between two states
        with Simulation(ROBOT) as simulation:
            simulation.place_robot(Pose(-2.0, 0.0, 0.0))
            action = GoToPose(ROBOT)
            action.start(simulation.world(), Goal(goal, 0.0, Point.AXLE))
            for tick in range(400):
                world = simulation.world()
                if tick % apart == 0:
                    step = action.step(world)
                if step.status is not Status.RUNNING:
                    break
                simulation.command(step.command)
                simulation.tick()
            assert step.status is Status.SUCCEEDED, step.message
            durations.append(world.time)
    assert durations[1] <= 1.25 * durations[0]


def test_a_robot_that_never_starts_does_not_make_the_plan_wait_for_ever() -> None:
    with Simulation(ROBOT) as simulation:
        simulation.place_robot(Pose(-2.0, 0.0, 0.0))
        action = GoToPose(ROBOT)
        action.start(simulation.world(), Goal(Pose(0.0, 0.0, 0.0), 0.0, Point.AXLE))
        for _ in range(400):
            step = action.step(simulation.world())
            if step.status is not Status.RUNNING:
                break
            simulation.tick()
        assert step.status is Status.FAILED
        assert "gave up after 20 new plans" in step.message
