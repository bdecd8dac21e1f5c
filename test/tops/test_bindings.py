"""Bindings: variables that the conditions of a chain bind."""

import dataclasses

import pytest
from refinement_fakes import ALL, LIBRARY, ROBOT, call, world

from ator_ros.actions.base import Point
from ator_ros.actions.goal_variables import goal_values, with_values
from ator_ros.tops.bindings import bindings
from ator_ros.tops.chain import EVERYTHING, Top, TopCall, TopChain
from ator_ros.tops.conditions import Condition, Term

PLACE = {(0, "x"), (0, "y")}
ARRIVED = tuple(Term(f"robot.{name}", f"goal.{name}", 0.1) for name in ("x", "y"))


def bound(*tops: str | Top) -> dict[tuple[int, str], str]:
    return dict(bindings(tuple(LIBRARY[top] if isinstance(top, str) else top for top in tops)))


def top_with(
    pre: tuple[Term, ...] = (), post: tuple[Term, ...] = (), point: Point = Point.AXLE
) -> Top:
    return Top("other", "goToPose", Condition(pre), Condition(post), point)


def test_the_place_of_the_ball_is_bound_by_the_steps_own_pre_condition() -> None:
    found = bound("goToBall")
    assert found.keys() == PLACE
    assert found[0, "x"] == "bound by the pre-condition of step 1 (goToBall): ball.x near goal.x"


def test_a_held_ball_leaves_the_goal_of_a_dribble_free() -> None:
    assert bound("goToBall", "dribbleBall", "dribbleBall", "shoot").keys() == PLACE


def test_the_next_pre_condition_binds_the_variables_it_depends_on() -> None:
    found = bound("goToPose", "dribbleBall")  # a ball is held only at one pose of the robot
    assert found.keys() == PLACE | {(0, "yaw")}
    assert "pre-condition of step 2 (dribbleBall)" in found[0, "yaw"]
    facing = top_with(pre=(Term("robot.yaw", "goal.yaw", 0.1),), post=ARRIVED)
    assert bound("goToPose", facing).keys() == {(0, "yaw"), (1, "yaw")}
    standing = top_with(pre=(Term("robot.vx", 0.0, 0.1), Term("robot.w", 0.0, 0.1)))
    assert bound("dribbleBall", standing).keys() == {(0, "speed")}


def test_a_later_step_binds_the_place_of_the_ball() -> None:
    found = bound("dribbleBall", "goToPose", "goToBall")
    assert found.keys() == PLACE | {(2, "x"), (2, "y")}
    assert "pre-condition of step 3 (goToBall)" in found[0, "x"]


def test_a_post_condition_binds_variables_with_fixed_targets() -> None:
    stopping = top_with(post=(*ARRIVED, Term("robot.vx", 0.0, 0.1)))
    assert bound(stopping).keys() == {(0, "speed")}
    at_ball = top_with(post=(Term("hold.x", "ball.x", 0.1),), point=Point.HOLD)
    assert bound(at_ball).keys() == {(0, "x")}
    turning = top_with(post=(Term("robot.yaw", "goal.yaw", 0.1),))
    assert not bound(turning)


def test_opening_everything_excludes_the_post_conditions_variables() -> None:
    for top, opened in {
        "goToPose": {"speed"},
        "goToBall": ALL,
        "dribbleBall": {"yaw", "speed"},
        "shoot": {"yaw", "speed"},
    }.items():
        assert {
            name for name in ALL if call(top, 0, 0, 0, frozenset({EVERYTHING})).opens(name)
        } == opened
        assert {name for name in ALL if call(top, 0, 0, 0, frozenset({"x"})).opens(name)} == {"x"}


def moved(step: TopCall, name: str) -> TopCall:
    return dataclasses.replace(
        step, goal=with_values(step.goal, {name: goal_values(step.goal)[name] + 0.5})
    )


@pytest.mark.parametrize(
    "tops",
    [("goToBall", "dribbleBall", "shoot"), ("goToPose", "goToBall", "dribbleBall", "goToPose")],
)
def test_a_chain_stays_valid_if_unbound_variables_change(tops: tuple[str, ...]) -> None:
    places = {
        "goToPose": (-2.0, 1.0, 0.4),
        "goToBall": (0.0, 0.0, 0.3),
        "dribbleBall": (2.3, 1.0, 0.2),
    }
    chain = TopChain(tuple(call(top, *places.get(top, (4.0, 0.0, 0.0))) for top in tops))
    assert not chain.violations(world(), ROBOT)
    for index, step in enumerate(chain.calls):
        for name in ALL:
            changed = chain.with_goal(index, moved(step, name).goal)
            assert bool(changed.violations(world(), ROBOT)) == ((index, name) in bound(*tops))
