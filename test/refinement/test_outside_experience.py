"""Requests outside the experience of the performance models: reported, and not refined."""

from ator_ros.actions.base import Goal, Point
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_models
from ator_ros.refinement.refiner import Refiner
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
MODELS = load_models(ROBOT, SOCCER.known_features)
LIBRARY = SOCCER.library(ROBOT)


def test_a_step_outside_the_experience_is_reported_and_not_refined() -> None:
    """Dribble the ball from 2 m ahead to 21 m left of there."""
    ball, there = Pose(2.0, 0.0, 0.0), Pose(2.0, 21.0, 1.5708)
    fetch = TopCall(LIBRARY["goToBall"], Goal(ball, 0.0, Point.HOLD), frozenset({"yaw"}))
    dribble = TopCall(LIBRARY["dribbleBall"], Goal(there, 0.0, Point.HOLD))
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(ball.x, ball.y)})
    answer = Refiner(ROBOT, MODELS).refine(world, TopChain((fetch, dribble)))
    assert "step 2 (dribbleBall): distance 21.0 m is outside the experience of" in answer.reason
    assert not answer.refined
    assert not answer.free
    (kept,) = answer.not_free
    assert (kept.subgoal, kept.name) == (0, "yaw")
    assert "step 2" in kept.reason
