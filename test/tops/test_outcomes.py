"""The outcome of a TOP is decided by its post-condition, in the simulator and in the executor."""

import dataclasses
import math

import pytest

from ator_ros.actions.base import Action, Goal, Point, Status, Step
from ator_ros.actions.situation import Situation
from ator_ros.bases.description import load_robot
from ator_ros.domains.soccer.field import BALL
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.domains.soccer.tops import DRIBBLE_BALL, GO_TO_BALL, GO_TO_POSE, SHOOT
from ator_ros.experience.simulated import run_episode
from ator_ros.geometry import Pose
from ator_ros.simulation.run import judge, place, run_action
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import Top
from ator_ros.tops.conditions import Condition, Region
from ator_ros.tops.library import top_of
from ator_ros.world.state import STOP, ObjectState, RobotState, World

ROBOT = load_robot()
HERE = RobotState(Pose(0.0, 0.0, 0.0))
MOUTH = Goal(Pose(4.0, 0.0, 0.0), 0.0, Point.HOLD)


def with_ball(x: float, y: float = 0.0) -> World:
    return World(0.0, HERE, {BALL: ObjectState(x, y)})


def test_a_region_is_relative_to_its_target() -> None:
    region = Condition((Region("cup.x", "goal.x", 0.5, 2.0),))
    for x, lacks in ((1.4, 1), (1.5, 0), (3.0, 0), (3.1, 1)):
        assert len(region.violations({"cup.x": x}, {"x": 1.0})) == lacks
    (violation,) = region.violations({"cup.x": 1.4}, {"x": 1.0})
    assert violation == "expected cup.x 0.5 to 2 of goal.x, it is 0.1 beyond"
    assert "unknown" in region.violations({}, {"x": 1.0})[0]


def test_outward_is_away_from_the_origin_on_both_sides() -> None:
    beyond = Condition((Region("cup.x", "goal.x", 0.0, 0.7, outward=True),))
    for side in (1.0, -1.0):
        assert beyond.violations({"cup.x": side * 4.3}, {"x": side * 4.0}) == []
        assert beyond.violations({"cup.x": side * 3.9}, {"x": side * 4.0})
        assert beyond.shortfall({"cup.x": side * 3.5}, {"x": side * 4.0}) == 0.5
        assert beyond.apply({}, {"x": side * 4.0}) == {"cup.x": side * 4.0}
    moved = Condition((Region("cup.x", "goal.x", 0.0, 0.7, outward=True, center=5.0),))
    assert moved.violations({"cup.x": 3.7}, {"x": 4.0}) == []


def test_a_region_binds_the_goal_variable_that_it_names() -> None:
    put = Top("put", "put", Condition((Region("cup.x", "goal.x", -1.0, 1.0),)), Condition())
    assert bindings((put,)).keys() == {(0, "x")}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shot_ball_must_be_beyond_the_line_and_between_the_posts(side: float) -> None:
    goal = Goal(Pose(4.0 * side, 0.0, 0.0), 0.0, Point.HOLD)
    assert SHOOT.unmet(with_ball(4.05 * side, 0.9), goal, ROBOT) == []
    assert SHOOT.unmet(with_ball(3.95 * side), goal, ROBOT)
    assert SHOOT.unmet(with_ball(4.05 * side, 1.1), goal, ROBOT)


def test_the_shortfall_of_a_shot_is_the_distance_of_the_ball_from_the_goal() -> None:
    assert SHOOT.shortfall(with_ball(3.5), MOUTH, ROBOT) == 0.5
    assert SHOOT.shortfall(with_ball(3.5, 1.75), MOUTH, ROBOT) == 0.75
    assert SHOOT.shortfall(with_ball(4.1), MOUTH, ROBOT) == 0.0
    assert SHOOT.shortfall(World(0.0, HERE), MOUTH, ROBOT) == math.inf


def test_a_ball_is_scored_only_in_existing_goals() -> None:
    bays = tuple(dataclasses.replace(bay, width=1.0, depth=1.2) for bay in ROBOT.scene.bays)
    robot = dataclasses.replace(ROBOT, scene=dataclasses.replace(ROBOT.scene, bays=bays))
    shot = SOCCER.library(robot)["shoot"]
    assert shot.unmet(with_ball(5.0, 0.4), MOUTH, robot) == []
    assert shot.unmet(with_ball(4.05, 0.6), MOUTH, robot)


def test_point_and_objects_determine_the_top_of_an_action() -> None:
    ball = {BALL: ObjectState(1.0, 0.0)}
    cases = [
        (GO_TO_POSE, "goToPose", {}, Point.AXLE),
        (GO_TO_POSE, "goToPose", ball, Point.AXLE),
        (GO_TO_BALL, "goToPose", ball, Point.HOLD),
        (DRIBBLE_BALL, "dribbleBall", ball, Point.HOLD),
        (SHOOT, "shoot", ball, Point.HOLD),
    ]
    for top, action, objects, point in cases:
        situation = Situation(action, HERE, objects, Goal(Pose(1.0, 0.0, 0.0), 0.0, point))
        assert top_of(situation, SOCCER.tops, ROBOT) is top


class Push(Action):
    """Reports success in its first step."""

    name = "push"
    ends: int

    def start(self, world: World, goal: Goal) -> None:
        self.ends = 0

    def step(self, world: World) -> Step:
        assert self.ends == 0, "an action that has ended is not stepped"
        return Step(STOP, Status.SUCCEEDED, "pushed")

    def end(self, reason: str) -> None:
        self.ends += 1


def pushing(post: Condition, settles: float) -> Top:
    return Top("push", "push", Condition(), post, settles=settles)


ROLLED = Condition((Region("ball.x", "goal.x", 0.0, 1.0),))
AHEAD = Goal(Pose(2.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("settles", "vx", "success", "end"),
    [(6.0, 1.0, True, 2.0), (0.0, 1.0, False, 1.5), (0.2, 1.0, False, 1.7), (6.0, 0.1, False, 1.5)],
)
def test_objects_settle_within_the_time_of_the_top(
    settles: float, vx: float, success: bool, end: float
) -> None:
    situation = Situation("push", HERE, {BALL: ObjectState(1.5, 1.0, vx)}, AHEAD)
    top = pushing(ROLLED, settles)
    with Simulation(ROBOT) as simulation:
        episode = run_episode(simulation, Push(ROBOT), situation, top=top)
        x = simulation.world().objects[BALL].x
    assert episode.success is success
    assert episode.duration == 0.0
    assert x == pytest.approx(end, abs=0.06)
    assert episode.position_error == pytest.approx(max(0.0, 2.0 - x))
    assert math.isnan(episode.heading_error)


def test_success_needs_the_post_condition_and_the_success_of_the_action() -> None:
    with Simulation(ROBOT) as simulation:
        place(simulation, with_ball(1.0, 1.0))
        done = run_action(simulation, Push(ROBOT), AHEAD)
        early = judge(simulation, pushing(ROLLED, 1.0), AHEAD, done.status, done.message)
        place(simulation, with_ball(2.5, 1.0))
        late = judge(simulation, pushing(ROLLED, 1.0), AHEAD, Status.FAILED, "gave up")
    assert (early.success, late.success, late.reason) == (False, False, "gave up")
    assert early.reason == (
        "pushed; but post-condition of push: expected ball.x 0 to 1 of goal.x, it is 1 beyond"
    )
