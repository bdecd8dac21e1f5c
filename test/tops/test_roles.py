"""The roles of objects in TOPs, and what becomes of goals when objects move."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.actions.base import Goal, Point
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.tops import objects
from ator_ros.tops.chain import Top, TopCall
from ator_ros.tops.conditions import Condition, Region, Term
from ator_ros.world.state import ObjectState, RobotState, World

ROBOT = load_robot()
PLAIN = dataclasses.replace(ROBOT, holder=None)
HERE = RobotState(Pose(0.0, 0.0, 0.0))


def at(one: str, other: str, tolerance: float = 0.1) -> Condition:
    return Condition(tuple(Term(f"{one}.{axis}", f"{other}.{axis}", tolerance) for axis in "xy"))


ANY = Condition()


def top(pre: Condition = ANY, post: Condition = ANY) -> Top:
    return Top("move", "move", pre, post, Point.HOLD)


FETCH = top(at("cup", "goal"), at("hold", "cup"))
CARRY = top(at("cup", "hold"), at("hold", "cup"))
LEAVE = top(at("cup", "hold"), at("robot", "goal"))
WATCH = top(at("cup", "goal"), at("robot", "goal"))


@pytest.mark.parametrize(
    ("step", "first", "last", "kept", "followed", "fetched"),
    [
        (FETCH, None, "cup", None, "cup", "cup"),
        (CARRY, "cup", "cup", "cup", None, None),
        (LEAVE, "cup", None, None, None, None),
        (WATCH, None, None, None, "cup", None),
        (top(), None, None, None, None, None),
    ],
)
def test_conditions_say_what_is_held_followed_and_fetched(
    step: Top,
    first: str | None,
    last: str | None,
    kept: str | None,
    followed: str | None,
    fetched: str | None,
) -> None:
    assert objects.held_first(step) == first
    assert objects.held_last(step) == last
    assert objects.kept(step) == kept
    assert objects.followed(step) == followed
    assert objects.object_fetched_by(step) == fetched


def test_both_coordinates_within_a_range_about_the_place_are_needed() -> None:
    only_x = Condition((Term("cup.x", "goal.x", 0.1),))
    assert objects.followed(top(only_x)) is None
    beside = Condition((Term("cup.x", "goal.x", 0.1), Region("cup.y", "goal.y", 0.5, 1.0)))
    assert objects.followed(top(beside)) is None
    around = Condition((Term("cup.x", "goal.x", 0.1), Region("cup.y", "goal.y", -0.5, 1.0)))
    assert objects.followed(top(around)) == "cup"


def test_of_several_objects_the_first_by_name_counts() -> None:
    two = Condition((*at("tray", "goal").terms, *at("cup", "goal").terms))
    assert objects.followed(top(two)) == "cup"
    assert objects.objects_in(top(two, at("hold", "box"))) == ["box", "cup", "tray"]


def test_the_first_missing_object_is_reported() -> None:
    world = World(0.0, HERE, {"cup": ObjectState(1.0, 0.0)})
    both = dataclasses.replace(top(at("tray", "goal"), at("hold", "cup")), name="both")
    goal = Goal(Pose(0.0, 0.0, 0.0))
    assert objects.missing_object(FETCH, world) is None
    assert objects.missing_object(both, world) == "tray"
    calls = [TopCall(FETCH, goal), TopCall(both, goal)]
    assert objects.missing_in(calls, world) == ("tray", "both")
    assert objects.missing_in(calls[:1], world) is None
    assert objects.missing_in(calls, World(0.0, HERE)) == ("cup", "move")


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_a_followed_object_has_left_when_the_pre_condition_no_longer_holds(
    x: float, y: float
) -> None:
    call = TopCall(FETCH, Goal(Pose(1.0, 0.5, 0.0)))
    world = World(0.0, HERE, {"cup": ObjectState(x, y)})
    assert objects.has_left(world, call, ROBOT) == (max(abs(x - 1.0), abs(y - 0.5)) > 0.1)
    assert not objects.has_left(World(0.0, HERE), call, ROBOT)
    assert not objects.has_left(world, dataclasses.replace(call, top=CARRY), ROBOT)


def test_other_terms_of_a_pre_condition_do_not_make_an_object_leave() -> None:
    facing = (Term("robot.yaw", 2.0, 0.1), *at("cup", "goal").terms)
    call = TopCall(top(Condition(facing)), Goal(Pose(1.0, 0.0, 0.0)))
    world = World(0.0, HERE, {"cup": ObjectState(1.0, 0.0)})
    assert not objects.has_left(world, call, ROBOT)


def test_a_goal_moves_to_its_object() -> None:
    goal = Goal(Pose(1.0, 2.0, 0.3), 0.4)
    world = World(0.0, HERE, {"cup": ObjectState(5.0, 6.0)})
    moved = objects.at_object(goal, world, "cup")
    assert moved == Goal(Pose(5.0, 6.0, 0.3), 0.4)
    assert objects.at_object(goal, world, "tray") is goal


def test_objects_come_to_rest_ahead_on_their_way() -> None:
    (name,) = ROBOT.scene.objects
    world = World(0.0, HERE, {name: ObjectState(0.0, 0.0, 0.0, 1.0)})
    rest = objects.at_rest(world, ROBOT).objects[name]
    assert (rest.x, rest.vx, rest.vy) == (0.0, 0.0, 0.0)
    rolling = ROBOT.scene.objects[name].rolling_deceleration
    assert rest.y == pytest.approx(1.0 / (2.0 * rolling))


@given(st.floats(0.0, 1.0), st.floats(-math.pi, math.pi))
def test_an_object_is_held_before_it_is_lost_and_touched_farther_than_held(
    distance: float, direction: float
) -> None:
    hold = ROBOT.hold_point(HERE.pose)
    cup = ObjectState(
        hold.x + distance * math.cos(direction), hold.y + distance * math.sin(direction)
    )
    world = World(0.0, HERE, {"cup": cup})
    held = objects.is_held(world, ROBOT, "cup")
    lost = objects.is_lost(world, ROBOT, "cup")
    touched = objects.is_at_front(world, ROBOT, "cup")
    assert not (held and lost)
    assert touched or not held
    length = ROBOT.holder_length
    if distance <= 0.999 * length / 1.2:
        assert held
    elif distance >= 1.001 * length / 1.2:
        assert not held
    assert lost == (distance > length) or distance == pytest.approx(length)
    assert touched == (distance < length + 0.08) or distance == pytest.approx(length + 0.08)


def test_unknown_objects_are_neither_held_nor_lost() -> None:
    world = World(0.0, HERE)
    assert not objects.is_held(world, ROBOT, "cup")
    assert not objects.is_lost(world, ROBOT, "cup")
    assert not objects.is_at_front(world, ROBOT, "cup")


def test_a_robot_without_a_holder_holds_nothing() -> None:
    world = World(0.0, HERE, {"cup": ObjectState(PLAIN.hold, 0.0)})
    assert not objects.is_held(world, PLAIN, "cup")
    assert objects.held_within(PLAIN) == 0.0
    assert 0.0 < objects.held_within(ROBOT) < ROBOT.holder_length
