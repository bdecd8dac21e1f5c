"""Free variables: opened by the plan, not bound by a condition, and used by a performance model."""

import dataclasses
import math

import numpy as np
import pytest
from maps import hall_map
from refinement_fakes import (
    ALL,
    ANGLE,
    BOTH,
    LIBRARY,
    NOTHING,
    ROBOT,
    USED,
    FakeModel,
    call,
    models,
    two_steps,
    world,
)

from ator_ros.actions.base import Goal, Point
from ator_ros.bases.routes import routes_of
from ator_ros.domains.domain import find_domain
from ator_ros.domains.soccer.soccer_domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.performance.model_file import load_models
from ator_ros.refinement import RefinementError
from ator_ros.refinement.free_variables import analyze
from ator_ros.refinement.refiner import Refiner
from ator_ros.tops.chain import EVERYTHING, TopCall, TopChain
from ator_ros.tops.conditions import Condition
from ator_ros.tops.ranges import USUAL_RANGES, Range
from ator_ros.world.state import RobotState, World


def free_names(chain: TopChain, used: frozenset[str] = USED) -> list[tuple[int, str]]:
    return [(v.subgoal, v.name) for v in analyze(chain, models(used), ROBOT).free]


def test_only_the_angle_is_free_in_the_papers_chain() -> None:
    assert free_names(two_steps()) == [(0, "yaw")]


def test_arrival_speed_is_free_where_the_plan_leaves_it_open() -> None:
    assert free_names(two_steps(BOTH)) == [(0, "yaw"), (0, "speed")]


def test_variables_that_no_model_uses_are_not_free() -> None:
    assert free_names(two_steps(BOTH), USED - {"v", "speedg"}) == [(0, "yaw")]


def test_last_subgoal_is_refined_where_the_plan_leaves_it_open() -> None:
    chain = TopChain((call("goToBall", 0.0, 0.0, 0.5, ANGLE),))
    result = Refiner(ROBOT, models()).refine(world(), chain)
    assert result.refined
    assert result.chain.calls[0].goal.pose.yaw == pytest.approx(0.0, abs=math.radians(5))


@pytest.mark.parametrize("placeholders", [False, True])
def test_a_chain_without_open_variables_is_only_predicted(placeholders: bool) -> None:
    chain = two_steps(NOTHING)
    result = Refiner(ROBOT, models()).refine(world(), chain, placeholders=placeholders)
    assert result.chain is result.original is result.best is chain
    assert not result.refined
    assert result.reason == "nothing is open: the plan commits to every goal variable"
    compared = Refiner(ROBOT, models()).refine(world(), two_steps())
    assert result.before == result.after == compared.before
    assert [action["duration"] > 0.0 for action in result.before.actions] == [True, True]


def test_without_free_variables_the_reasons_are_reported() -> None:
    result = Refiner(ROBOT, models()).refine(world(), two_steps(frozenset({"x"})))
    assert not result.refined
    assert result.reason == (
        "nothing is free: x of step 1 (goToBall) is bound by the pre-condition of step 1 "
        "(goToBall): "
        "ball.x near goal.x"
    )
    assert math.isfinite(result.before.duration)


def test_an_opening_that_a_condition_overrides_is_reported_beside_the_gain() -> None:
    named = Refiner(ROBOT, models()).refine(world(), two_steps(frozenset({"x", "yaw"}), yaw=2.0))
    assert named.refined
    assert "; not free: x of step 1 (goToBall) is bound by the pre-condition" in named.reason
    assert [(each.subgoal, each.name) for each in named.not_free] == [(0, "x")]
    everything = Refiner(ROBOT, models()).refine(
        world(), two_steps(frozenset({EVERYTHING}), yaw=2.0)
    )
    assert [(each.subgoal, each.name) for each in everything.not_free] == [(0, "x"), (0, "y")]
    assert [(each.subgoal, each.name) for each in everything.free] == [(0, "yaw"), (0, "speed")]
    assert "not free" not in everything.reason


def test_an_unknown_goal_variable_is_reported() -> None:
    (not_free,) = analyze(two_steps(frozenset({"heading"})), models(), ROBOT).not_free
    assert (not_free.subgoal, not_free.name) == (0, "heading")
    assert not_free.reason == "no goal variable, expected one of x, y, yaw, speed"


def test_each_action_needs_a_model() -> None:
    known = {"dribbleBall": models()["dribbleBall"]}
    with pytest.raises(RefinementError, match=r"model of each action, found none of goToPose$"):
        Refiner(ROBOT, known).refine(world(), two_steps())


def test_ranges_are_of_robot_and_scene_unless_a_domain_sets_them() -> None:
    top = dataclasses.replace(
        call("goToPose", 0.0, 0.0, 0.0).top, pre=Condition(), post=Condition()
    )
    step = TopCall(top, Goal(Pose(1.0, 0.0, 0.0)), ALL)
    chain = TopChain((step, step))
    usual = {
        each.name: each.domain for each in analyze(chain, models(), ROBOT).free if each.subgoal == 0
    }
    assert usual["x"] == Range(-4.0, 4.0, 16)
    assert usual["speed"].high == ROBOT.limits.v
    ranges = {"x": lambda *_: Range(-2.0, 30.0, 16), "yaw": USUAL_RANGES["yaw"]}
    own = analyze(chain, models(), ROBOT, ranges)
    assert {each.name: each.domain for each in own.free}["x"] == Range(-2.0, 30.0, 16)
    reasons = {each.name: each.reason for each in own.not_free}
    assert reasons == dict.fromkeys(("y", "speed"), "without a range")
    free = Refiner(ROBOT, models(), ranges=ranges).refine(world(), chain).free
    assert [each.name for each in free if each.subgoal == 0] == ["x", "yaw"]


def test_soccer_is_limited_to_its_field_and_learned_speeds() -> None:
    plain, held = Goal(Pose(0.0, 0.0, 0.0)), Goal(Pose(0.0, 0.0, 0.0), 0.0, Point.HOLD)
    found = {name: LIBRARY.ranges[name](ROBOT, plain) for name in ("x", "y", "yaw", "speed")}
    assert found == {
        "x": Range(-4.0, 4.0, 16),
        "y": Range(-2.5, 2.5, 10),
        "yaw": Range(-math.pi, math.pi, 36, periodic=True),
        "speed": Range(0.0, 0.8, 6, rest=0.0),
    }
    assert LIBRARY.ranges["speed"](ROBOT, held) == Range(0.0, 0.8, 6, rest=0.0)


def test_a_free_place_is_searched_where_the_robot_has_room_on_its_map() -> None:
    domain = find_domain("tour").on_map(hall_map())
    robot = domain.robot()
    library = domain.library(robot)
    stop, end = (library.goal(library["visit"], Pose(x, 0.5, 0.0)) for x in (-3.0, -2.0))
    chain = TopChain((TopCall(library["visit"], stop, ALL), TopCall(library["visit"], end)))
    # the wall is fastest
    near = FakeModel(lambda direct: np.hypot(direct["xg"], direct["yg"]), USED)
    start, places = World(0.0, RobotState(Pose(-5.0, 0.0, 0.0))), []
    for where in (robot, dataclasses.replace(robot, grid=None)):
        refiner = Refiner(where, {"drive_to": near}, ranges=USUAL_RANGES)
        places.append(refiner.refine(start, chain).chain.calls[0].goal.pose)
    routes = routes_of(robot)
    assert routes is not None
    x, y = (np.array([place[axis] for place in places]) for axis in (0, 1))
    assert (routes.clearance(x, y) >= robot.reach).tolist() == [True, False]
    assert abs(places[0].x) < 1.0


def test_a_step_outside_the_experience_is_reported_and_uncertain() -> None:
    chain = TopChain(
        (call("goToBall", 2.0, 0.0, 0.0, ANGLE), call("dribbleBall", 2.0, 21.0, 1.5708))
    )
    known = load_models(ROBOT, SOCCER.known_features)
    answer = Refiner(ROBOT, known).refine(world(x=0.0, ball=(2.0, 0.0)), chain)
    assert "step 2 (dribbleBall): distance 21.0 m is outside the experience of" in answer.reason
    assert [(each.subgoal, each.name) for each in answer.free] == [(0, "yaw")]
    assert answer.before.actions[1]["spread"] > 1.5 * answer.before.actions[1]["noise"]
