"""The run-ups of shoot: they lead into the goal, with similar durations from neighboring starts."""

import math

import numpy as np
import pytest

from ator_ros.actions.base import Goal, Point
from ator_ros.bases.description import load_robot
from ator_ros.bases.differential.manoeuvre import Manoeuvre
from ator_ros.bases.differential.trajectory import Trajectory
from ator_ros.domains.soccer.field import BALL, field_of
from ator_ros.domains.soccer.shoot import Shoot
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
MOUTH = Pose(*field_of(ROBOT).goal_center(), 0.0)


def planned(start: Pose, speed: float = 0.0, mouth: Pose = MOUTH) -> Manoeuvre:
    action, ball = Shoot(ROBOT), ROBOT.hold_point(start)
    world = World(0.0, RobotState(start, speed), {BALL: ObjectState(ball.x, ball.y)})
    action.start(world, Goal(mouth, 0.0, Point.HOLD))
    return action.plan(world)


def starts(seed: int, count: int) -> list[RobotState]:
    """Draw starts at least a meter before the goal line, without a post in between."""
    rng = np.random.default_rng(seed)
    drawn: list[RobotState] = []
    while len(drawn) < count:
        state = SOCCER.actions()["shoot"].sample(ROBOT, rng).robot
        if state.pose.x < MOUTH.x - 1.0:
            drawn.append(state)
    return drawn


def test_every_run_up_ends_with_the_ball_rolling_between_the_posts() -> None:
    for state in starts(71, 25):
        plan = planned(state.pose, max(0.0, state.vx))
        ball = MOUTH.relative(plan.goal).ahead(ROBOT.hold)
        left = (ROBOT.scene.radius(BALL) - ball.x) / math.cos(ball.yaw)
        rolled_out = plan.exit.outer_speed**2 / (
            2.0 * ROBOT.scene.objects[BALL].rolling_deceleration
        )
        assert 0.0 <= left < 0.7 * rolled_out
        # on the goal line, from the middle of the mouth
        crossing = ball.y - ball.x * math.tan(ball.yaw)
        assert abs(crossing) + ROBOT.scene.radius(BALL) < field_of(ROBOT).goal_width / 2.0 - 0.2
        trajectory = Trajectory(plan)
        last = trajectory.at(trajectory.duration - 1e-9).pose
        assert last.distance(plan.goal) < 1e-3
        speeds, _, _ = plan.pieces()
        assert speeds[:, 1:].min() >= -1e-6


def test_the_robot_stops_before_the_wall_of_the_goal() -> None:
    for state in starts(72, 25):
        plan = planned(state.pose)
        stop = MOUTH.relative(plan.goal).ahead(
            plan.exit.outer_speed**2 / (2.0 * ROBOT.limits.brake)
        )
        assert stop.x + ROBOT.reach < field_of(ROBOT).goal_depth
        assert abs(stop.y) + ROBOT.reach < field_of(ROBOT).goal_width / 2.0


def test_shots_at_both_goals_are_symmetric() -> None:
    start = Pose(2.0, 0.7, 1.0)
    there = planned(start)
    other = planned(
        Pose(-start.x, -start.y, start.yaw + math.pi), mouth=Pose(-MOUTH.x, 0.0, 0.0)
    )  # fmt: skip
    assert other.duration == pytest.approx(there.duration)
