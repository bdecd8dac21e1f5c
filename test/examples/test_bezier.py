"""The paper's action set on Bezier curves."""

import pytest
from action_runs import Task, execute, execute_situation

from ator_ros.actions.base import ActionError, Goal, Point
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import Robot, load_robot
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.field import BALL, field_of
from ator_ros.geometry import Pose
from ator_ros.resources import resource_path
from ator_ros.world.state import ObjectState, RobotState, World

SOCCER = find_domain("soccer")

AXLE_GOAL = Goal(Pose(1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


def test_the_path_is_the_curve_from_robot_to_goal(robot: Robot) -> None:
    action = SOCCER.actions("bezier")["goToPose"].factory(robot)
    start, goal = Pose(-1.0, 0.5, 0.3), Pose(1.0, -0.5, 1.2)
    world = World(0.0, RobotState(start))
    action.start(world, Goal(goal))
    assert action.path() is None
    action.step(world)
    path = action.path()
    assert path[0] == pytest.approx(start, abs=0.1)
    assert path[-1] == pytest.approx(goal)
    # The curve ends where the straight run-in begins.
    assert abs(Pose(*path[-2]).relative(goal).y) < 0.01
    assert path[-2] == pytest.approx(goal, abs=0.4)


@pytest.mark.parametrize(
    ("action_set", "name"),
    [("bezier", "dribbleBall"), ("bezier", "shoot"), ("default", "dribbleBall")],
)
def test_ball_must_be_held_at_the_start(robot: Robot, action_set: str, name: str) -> None:
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(1.0, 0.0)})
    goal = Goal(Pose(*field_of(robot).goal_center(), 0.0), point=Point.HOLD)
    with pytest.raises(ActionError, match="ball in front"):
        SOCCER.actions(action_set)[name].factory(robot).start(world, goal)


def test_shot_at_a_place_without_a_goal_is_rejected(robot: Robot) -> None:
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(robot.hold, 0.0)})
    with pytest.raises(ActionError, match="goal's mouth"):
        SOCCER.actions("bezier")["shoot"].factory(robot).start(world, AXLE_GOAL)


@pytest.mark.parametrize(
    ("start", "ball"),
    [
        # around the ball on the side away from the post
        ((0.03, 1.51, 1.4), (-2.93, -1.062, 0.4189)),
        ((-2.529, 0.99, -3.0556), (-3.0732, -0.7337, 0.1571)),  # both sides hit the post
    ],
)
def test_approach_keeps_clear_of_the_posts(
    start: tuple[float, float, float], ball: tuple[float, float, float]
) -> None:
    situation = Situation(
        "goToPose",
        RobotState(Pose(*start)),
        {BALL: ObjectState(*ball[:2])},
        Goal(Pose(*ball), point=Point.HOLD),
    )
    outcome = execute_situation(situation, Task("approach", "bezier", 0, 0))
    assert outcome.success
    assert outcome.duration < 15.0


@pytest.mark.parametrize("kind", ["pose", "approach", "dribble"])
def test_a_base_with_low_acceleration_does_not_circle_its_goal(kind: str) -> None:
    robot = str(resource_path("config", "pioneer_lx.yaml"))
    assert all(execute(Task(kind, "bezier", 77, index, robot)).success for index in range(4))
