"""The paper's action set, in scenarios over random starts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenarios import (
    Run,
    always_holds_the_ball,
    always_within_limits,
    ball_in_the_goal,
    ball_stays_until_the_end,
    eventually_at_the_pose,
    run_many,
)

from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.actions.bezier.curve import bezier_paths, drive_time
from ator_ros.actions.bezier.follow import PERIOD, Pushing, ramped
from ator_ros.actions.catalogue import ACTION_SETS
from ator_ros.geometry import Pose
from ator_ros.robot import Robot, load_robot
from ator_ros.world import BallState, Command, RobotState, World

COUNT = 20
AXLE_GOAL = Goal(Pose(1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def runs(robot: Robot) -> dict[str, list[Run]]:
    actions = ACTION_SETS["bezier"]
    return {name: run_many(robot, kind(robot), seed=11, count=COUNT) for name, kind in actions.items()}


def test_set_offers_the_same_actions_as_the_default_set() -> None:
    assert set(ACTION_SETS["bezier"]) == set(ACTION_SETS["default"])


def test_commands_and_velocities_stay_within_limits(runs: dict[str, list[Run]]) -> None:
    assert all(always_within_limits(run) for of_action in runs.values() for run in of_action)


def test_go_to_pose_arrives(runs: dict[str, list[Run]]) -> None:
    assert sum(eventually_at_the_pose(run) for run in runs["goToPose"]) >= COUNT - 1


def test_approach_leaves_the_ball_in_its_place(runs: dict[str, list[Run]]) -> None:
    approaches = [run for run in runs["goToPose"] if run.situation.ball is not None]
    assert len(approaches) >= COUNT / 2
    assert sum(ball_stays_until_the_end(run) for run in approaches) >= len(approaches) - 1


def test_dribble_arrives_with_the_ball(runs: dict[str, list[Run]]) -> None:
    arrived = [eventually_at_the_pose(run) and always_holds_the_ball(run) for run in runs["dribbleBall"]]
    assert sum(arrived) >= COUNT - 2


def test_shoot_scores(runs: dict[str, list[Run]]) -> None:
    assert sum(ball_in_the_goal(run) for run in runs["shoot"]) >= COUNT - 2


def test_same_start_gives_the_same_steps(robot: Robot, runs: dict[str, list[Run]]) -> None:
    again = run_many(robot, ACTION_SETS["bezier"]["goToPose"](robot), seed=11, count=2)
    assert [run.steps for run in again] == [run.steps for run in runs["goToPose"][:2]]


@pytest.mark.parametrize("name", ["dribbleBall", "shoot"])
def test_ball_must_be_held_at_the_start(robot: Robot, name: str) -> None:
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), BallState(1.0, 0.0))
    goal = Goal(Pose(*robot.field.goal_centre(), 0.0), point=Point.HOLD)
    with pytest.raises(ActionError, match="expected the ball within"):
        ACTION_SETS["bezier"][name](robot).start(world, goal)


@pytest.mark.parametrize("goal", [Goal(Pose(math.nan, 0.0, 0.0)), Goal(Pose(0.0, 0.0, 0.0), speed=9.0)])
def test_impossible_goal_is_refused(robot: Robot, goal: Goal) -> None:
    with pytest.raises(ActionError, match="expected a"):
        ACTION_SETS["bezier"]["goToPose"](robot).start(World(0.0, RobotState(Pose(0.0, 0.0, 0.0))), goal)


def test_shot_at_a_place_without_a_goal_is_refused(robot: Robot) -> None:
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), BallState(robot.hold, 0.0))
    with pytest.raises(ActionError, match="goal's mouth"):
        ACTION_SETS["bezier"]["shoot"](robot).start(world, AXLE_GOAL)


def test_curve_leaves_and_arrives_in_the_given_directions() -> None:
    start, end, yaw = np.array([[0.0, 0.0, 0.5]]), np.array([[2.0, 1.0, -0.3]]), np.array([-0.3])
    along = np.linspace(0.0, 0.3, 7)[1:, None]
    tail = np.array([[2.0, 1.0]]) + along * np.array([[math.cos(-0.3), math.sin(-0.3)]])
    paths = bezier_paths(start, end, np.array([[0.5, 0.5]]), np.zeros(1), tail[None], yaw)
    assert abs(paths.headings[0, 0] - 0.5) < 0.1
    assert paths.headings[0, -1] == pytest.approx(-0.3)
    assert paths.points[0, 0] == pytest.approx([0.0, 0.0])
    assert drive_time(paths, v=1.0, w=100.0)[0] == pytest.approx(paths.lengths.sum(), rel=0.01)


def test_ball_is_pressed_on_only_below_a_speed_that_falls_with_curvature() -> None:
    pushing = Pushing(hold=0.31, deceleration=0.7)
    speeds = [pushing.speed(curvature) for curvature in (0.0, 0.5, 1.0, 2.0, 3.0)]
    assert speeds == sorted(speeds, reverse=True)
    assert pushing.braking(pushing.speed(2.0), 2.0) == pytest.approx(0.0, abs=1e-9)


def test_ramp_changes_no_faster_than_the_limits(robot: Robot) -> None:
    command = ramped(Command(0.5, 0.0), 5.0, -9.0, robot.limits)
    assert command.v == pytest.approx(0.5 + robot.limits.a * PERIOD)
    assert command.w == pytest.approx(-robot.limits.aw * PERIOD)
