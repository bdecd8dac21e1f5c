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
YAW = frozenset({"yaw"})


def request(start: float, end: float, opened: frozenset[str] = YAW) -> tuple[World, TopChain]:
    """Return world and chain: to a ball `start` m ahead, then dribble it `end` m to the left."""
    ball, there = Pose(start, 0.0, 0.0), Pose(start, end, 1.5708)
    fetch = TopCall(LIBRARY["goToBall"], Goal(ball, 0.0, Point.HOLD), opened)
    dribble = TopCall(LIBRARY["dribbleBall"], Goal(there, 0.0, Point.HOLD))
    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(ball.x, ball.y)})
    return world, TopChain((fetch, dribble))


def test_a_step_outside_the_experience_is_reported_and_not_refined() -> None:
    answer = Refiner(ROBOT, MODELS).refine(*request(2.0, 21.0))
    assert "step 2 (dribbleBall): distance 21.0 m is outside the experience of" in answer.reason
    assert not answer.refined
    assert not answer.free
    (kept,) = answer.not_free
    assert (kept.subgoal, kept.name) == (0, "yaw")
    assert "step 2" in kept.reason


def test_a_chain_without_open_variables_has_the_remark_too() -> None:
    answer = Refiner(ROBOT, MODELS).refine(*request(30.0, 2.0, frozenset()))
    assert "step 1 (goToBall): distance" in answer.reason
    assert "step 2" not in answer.reason
