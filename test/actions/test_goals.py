"""Goals: the pose of the axle, goal variables, and whole numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ator_ros.actions.base import Action, Goal, Point, Status, Step, finished
from ator_ros.actions.goal_variables import (
    GOAL_VARIABLES,
    STOPS,
    GoalVariable,
    direct_name,
    drawn_values,
    goal_values,
    passes,
    with_values,
    wrong_values,
)
from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose
from ator_ros.schema import SchemaError
from ator_ros.world.state import STOP, Command, RobotState, World

ROBOT = load_robot()
LIFT = GoalVariable("lift", "m", 0.1, 0.5)
coordinates = st.floats(-100.0, 100.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose, coordinates, coordinates, angles)


@given(poses)
def test_a_goal_of_the_axle_is_the_pose_of_the_axle(pose: Pose) -> None:
    assert Goal(pose).robot_pose(ROBOT) == pose


@given(poses)
def test_with_the_axle_at_a_goal_of_the_hold_the_hold_is_there(pose: Pose) -> None:
    axle = Goal(pose, point=Point.HOLD).robot_pose(ROBOT)
    hold = ROBOT.hold_point(axle)
    assert (hold.x, hold.y, axle.yaw) == pytest.approx(pose)
    assert axle.distance(pose) == pytest.approx(ROBOT.hold)


def test_whole_numbers_in_goals_are_read_as_floats() -> None:
    goal = Goal(Pose(1, -2, 0), speed=1)
    assert {type(value) for value in (*goal.pose, goal.speed)} == {float}


def test_an_action_by_default_needs_no_setup_shows_no_path_and_ends_with_a_state() -> None:
    class Idle(Action):
        name = "idle"

        def start(self, world: World, goal: Goal) -> None:
            pass

        def step(self, world: World) -> Step:
            return finished(Status.SUCCEEDED, "idle")

    world = World(0.0, RobotState(Pose(0.0, 0.0, 0.0)))
    action = Idle(ROBOT)
    action.setup()
    action.start(world, Goal(Pose(0.0, 0.0, 0.0)))
    assert action.robot is ROBOT
    assert action.path() is None
    assert action.is_before_result(world) is False
    assert action.step(world) == Step(STOP, Status.SUCCEEDED, "idle")
    action.end("done")


def test_the_last_step_stops_the_robot_unless_it_has_another_command() -> None:
    assert finished(Status.FAILED, "lost").command == STOP
    passing = Command(0.3, 0.0)
    assert finished(Status.SUCCEEDED, "there", passing) == Step(passing, Status.SUCCEEDED, "there")
    assert finished(Status.SUCCEEDED, "there", None).command is None


# ---- goal variables ------------------------------------------------------------------------------


@given(poses, st.floats(0.0, 2.0), st.floats(-5.0, 5.0))
def test_values_and_goal_are_the_same_thing(pose: Pose, speed: float, lift: float) -> None:
    goal = Goal(pose, speed, Point.HOLD, {"lift": lift})
    values = goal_values(goal)
    assert values == {"x": pose.x, "y": pose.y, "yaw": pose.yaw, "speed": speed, "lift": lift}
    blank = Goal(Pose(0.0, 0.0, 0.0), point=Point.HOLD)
    assert with_values(blank, values) == goal
    assert with_values(goal, {}) == goal


@pytest.mark.parametrize("name", [*GOAL_VARIABLES, "lift"])
def test_only_the_given_variable_changes(name: str) -> None:
    goal = Goal(Pose(1.0, 2.0, 0.5), 0.25, Point.HOLD, {"lift": 0.4, "tilt": 0.1})
    changed = with_values(goal, {name: 3})
    assert goal_values(changed) == {**goal_values(goal), name: 3.0}
    assert type(goal_values(changed)[name]) is float
    assert changed.point is Point.HOLD
    assert goal.values == {"lift": 0.4, "tilt": 0.1}


def test_names_in_features_end_in_g() -> None:
    assert [direct_name(name) for name in GOAL_VARIABLES] == ["xg", "yg", "yawg", "speedg"]


@pytest.mark.parametrize(
    ("values", "wrong"),
    [
        ({"lift": 0.1}, None),
        ({"lift": 0.5}, None),
        ({"lift": 0.0999}, "lift: expected a number from 0.1 to 0.5 m, got 0.0999"),
        ({"lift": 0.51}, "lift: expected a number from 0.1 to 0.5 m, got 0.51"),
        ({"lift": math.nan}, "lift: expected a number from 0.1 to 0.5 m, got nan"),
        ({}, "expected values of lift, got those of no variable"),
        ({"lift": 0.2, "tilt": 0.0}, "expected values of lift, got those of lift, tilt"),
    ],
)
def test_the_values_of_a_goal_are_those_that_its_action_declares(
    values: dict[str, float], wrong: str | None
) -> None:
    assert wrong_values(Goal(Pose(0.0, 0.0, 0.0), values=values), [LIFT]) == wrong


def test_an_action_without_variables_has_none() -> None:
    plain = Goal(Pose(0.0, 0.0, 0.0))
    assert wrong_values(plain, []) is None
    given_one = with_values(plain, {"lift": 0.2})
    assert wrong_values(given_one, []) == "expected values of no variable, got those of lift"
    count = GoalVariable("count", "", 0.0, 2.0)
    many = with_values(plain, {"count": 3.0})
    assert wrong_values(many, [count]) == "count: expected a number from 0 to 2, got 3"


@given(st.floats(0.1, 0.5))
def test_the_usual_value_is_the_declared_one_or_the_middle(rest: float) -> None:
    assert GoalVariable("lift", "m", 0.1, 0.5, rest=rest).usual == rest
    assert LIFT.usual == pytest.approx(0.3)
    assert GoalVariable("lift", "m", -1.0, 1.0, rest=0.0).usual == 0.0


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"name": "a b"}, "name: expected a name"),
        ({"name": "yaw"}, "name: expected none of x, y, yaw, speed, order"),
        ({"low": 0.5}, "low, high: expected finite numbers, low below high"),
        ({"low": 0.6}, "low, high: expected finite numbers, low below high"),
        ({"low": -math.inf}, "low, high: expected finite numbers"),
        ({"high": math.inf}, "low, high: expected finite numbers"),
        ({"high": math.nan}, "low, high: expected finite numbers"),
        ({"steps": 0}, "lift: steps: expected a whole number from 1"),
        ({"rest": 0.09}, "lift: rest: expected a number from 0.1 to 0.5"),
        ({"rest": 0.51}, "lift: rest: expected a number from 0.1 to 0.5"),
    ],
)
def test_a_variable_that_cannot_be_searched_is_rejected(
    changes: dict[str, object], expected: str
) -> None:
    declared: dict[str, object] = {"name": "lift", "unit": "m", "low": 0.1, "high": 0.5}
    with pytest.raises(SchemaError, match=expected):
        GoalVariable(**{**declared, **changes})  # type: ignore[arg-type]


def test_the_least_search_has_one_step_and_bounds_are_usual_values_too() -> None:
    assert GoalVariable("lift", "m", 0.1, 0.5, steps=1).steps == 1
    for rest in (0.1, 0.5):
        assert GoalVariable("lift", "m", 0.1, 0.5, rest=rest).usual == rest


def test_a_goal_is_passed_only_if_its_stop_is_0() -> None:
    goal = Goal(Pose(0.0, 0.0, 0.0))
    assert not passes(goal)
    assert not passes(with_values(goal, {STOPS.name: 1.0}))
    assert passes(with_values(goal, {STOPS.name: 0.0}))


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_stop_is_0_or_1(value: float) -> None:
    goal = Goal(Pose(0.0, 0.0, 0.0))
    assert wrong_values(with_values(goal, {STOPS.name: value}), [STOPS]) is None
    between = with_values(goal, {STOPS.name: 0.25 + 0.5 * value})
    assert wrong_values(between, [STOPS]) == f"stop: expected 0 or 1, got {0.25 + 0.5 * value:g}"


def test_both_stops_and_all_of_a_range_are_drawn() -> None:
    rng = np.random.default_rng(1)
    drawn = [drawn_values([STOPS, LIFT], rng) for _ in range(100)]
    assert {each["stop"] for each in drawn} == {0.0, 1.0}
    lifts = [each["lift"] for each in drawn]
    assert 0.1 <= min(lifts) < 0.15
    assert 0.45 < max(lifts) <= 0.5
