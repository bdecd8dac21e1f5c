"""The fastest motions of an omnidirectional base."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omni_robots import ALIKE, ROBOTS, UNLIKE

from ator_ros.bases.direct import DIRECT_VARIABLES, direct_table
from ator_ros.bases.omni.omni_limits import OmniLimits, extent
from ator_ros.bases.omni.omni_robot import OmniRobot
from ator_ros.bases.omni.planar_motion import PlanarPlan, planar_plan
from ator_ros.geometry import FloatArray, Pose
from ator_ros.world.state import RobotState

COORDINATES = st.floats(-4.0, 4.0)
POSES = st.builds(Pose, COORDINATES, COORDINATES, st.floats(-3.1, 3.1))
SHARES = st.floats(-0.6, 0.6)
STEP = 0.002  # s


def times(robot: OmniRobot, start: RobotState, goal: Pose, speed: float = 0.0) -> FloatArray:
    """Return time and angle turned of the fastest motion, shape (2,)."""
    values = (*start.pose, start.vx, start.w, start.vy, *goal, speed, 0.0)
    table = direct_table(dict(zip(DIRECT_VARIABLES, values, strict=True))).table
    return robot.fastest(table, None)[:, 0]


def moving(pose: Pose, shares: tuple[float, float, float], robot: OmniRobot) -> RobotState:
    ahead, aside, turning = shares
    limits = robot.limits
    return RobotState(pose, ahead * limits.v, turning * limits.w, vy=aside * limits.sideways)


def over_floor(state: RobotState) -> FloatArray:
    cos, sin = math.cos(state.pose.yaw), math.sin(state.pose.yaw)
    vx, vy = cos * state.vx - sin * state.vy, sin * state.vx + cos * state.vy
    return np.array([vx, vy])


def largest_use(plan: PlanarPlan, limits: OmniLimits) -> tuple[float, float]:
    """Return the greatest speed and acceleration of a plan, as shares of the limits there."""
    speed = change = 0.0
    for time in np.arange(0.0, plan.duration, 0.02).tolist():
        state = plan.at(time)
        most = limits.speed_towards(math.atan2(state.vy, state.vx))
        speed = max(speed, state.speed / most)
        dv = (over_floor(plan.at(time + STEP)) - over_floor(plan.at(time - STEP))) / (2.0 * STEP)
        angle = math.atan2(dv[1], dv[0]) - state.pose.yaw
        least = max(limits.a, limits.brake)  # it gains or loses speed
        most = extent(least, least, limits.side_change, angle, limits.shape == "box")
        change = max(change, float(np.hypot(*dv)) / most)
    return speed, change


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
@given(start=POSES, goal=POSES)
@settings(max_examples=40, deadline=None)
def test_a_motion_from_rest_is_straight_within_limits_and_ends_at_the_goal(
    robot: OmniRobot, start: Pose, goal: Pose
) -> None:
    plan = planar_plan(RobotState(start), goal, 0.0, robot.limits)
    end = plan.at(plan.duration)
    assert end.pose.distance(goal) < 1e-6
    assert abs(end.pose.relative(goal).yaw) < 1e-6
    assert end.velocity.vx == pytest.approx(0.0, abs=1e-6)
    assert max(largest_use(plan, robot.limits)) <= 1.0 + 1e-6
    length = start.distance(goal)
    for x, y, _ in plan.poses(0.1).tolist():
        aside = (x - start.x) * (goal.y - start.y) - (y - start.y) * (goal.x - start.x)
        assert abs(aside) <= 1e-6 * max(length, 1.0)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
@given(start=POSES, goal=POSES, shares=st.tuples(SHARES, SHARES, SHARES), speed=st.floats(0.0, 0.5))
@settings(max_examples=60, deadline=None)
def test_the_time_of_searches_is_that_of_the_plan(
    robot: OmniRobot,
    start: Pose,
    goal: Pose,
    shares: tuple[float, float, float],
    speed: float,
) -> None:
    state = moving(start, shares, robot)
    plan = planar_plan(state, goal, speed, robot.limits)
    assert times(robot, state, goal, speed)[0] == pytest.approx(plan.duration, abs=1e-9)
    begin = plan.at(0.0)
    assert begin.pose.distance(start) < 1e-9
    rolls = 0.0 if robot is ALIKE else 0.1  # m/s up to which a start counts as a standstill
    assert begin.velocity.vx == pytest.approx(state.vx, abs=rolls + 1e-6)
    assert begin.velocity.vy == pytest.approx(state.vy, abs=rolls + 1e-6)


@given(goal=POSES, shares=st.tuples(SHARES, SHARES, SHARES))
@settings(max_examples=60, deadline=None)
def test_a_base_in_motion_arrives_at_rest(goal: Pose, shares: tuple[float, float, float]) -> None:
    state = moving(Pose(0.0, 0.0, 0.5), shares, ALIKE)
    plan = planar_plan(state, goal, 0.0, ALIKE.limits)
    end = plan.at(plan.duration)
    assert end.pose.distance(goal) < 1e-4
    assert abs(end.pose.relative(goal).yaw) < 1e-6
    assert end.speed < 1e-4


@given(goal=POSES, speed=st.floats(0.1, 2.0))
@settings(max_examples=60, deadline=None)
def test_a_passed_goal_is_reached_at_its_speed_and_heading(goal: Pose, speed: float) -> None:
    plan = planar_plan(RobotState(Pose(0.0, 0.0, 0.0)), goal, speed, ALIKE.limits)
    end = plan.at(plan.duration)
    assert end.pose.distance(goal) < 1e-3
    assert abs(end.pose.relative(goal).yaw) < 1e-3
    assert (end.vx, end.vy) == pytest.approx((speed, 0.0), abs=0.05)


@given(goal=POSES, turned=st.floats(-3.0, 3.0), shares=st.tuples(SHARES, SHARES, SHARES))
@settings(max_examples=60, deadline=None)
def test_times_do_not_depend_on_the_frame_of_the_world(
    goal: Pose, turned: float, shares: tuple[float, float, float]
) -> None:
    start = moving(Pose(0.3, -0.2, 0.1), shares, UNLIKE)
    frame = Pose(2.0, -1.0, turned)
    moved = dataclasses.replace(start, pose=frame.compose(start.pose))
    expected = times(UNLIKE, start, goal, 0.3)
    found = times(UNLIKE, moved, frame.compose(goal), 0.3)
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-4)


@given(goal=POSES, shares=st.tuples(SHARES, SHARES, SHARES))
@settings(max_examples=60, deadline=None)
def test_left_and_right_take_equally_long(goal: Pose, shares: tuple[float, float, float]) -> None:
    ahead, aside, turning = shares
    start = moving(Pose(0.0, 0.0, 0.0), shares, UNLIKE)
    mirrored = moving(Pose(0.0, 0.0, 0.0), (ahead, -aside, -turning), UNLIKE)
    other = Pose(goal.x, -goal.y, -goal.yaw)
    expected = times(UNLIKE, start, goal)
    assert times(UNLIKE, mirrored, other) == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_turns_hide_behind_long_translations_of_a_base_alike_in_all_directions() -> None:
    start = RobotState(Pose(0.0, 0.0, 0.0))
    straight = times(ALIKE, start, Pose(5.0, 0.0, 0.0))[0]
    assert times(ALIKE, start, Pose(5.0, 0.0, 1.5))[0] == pytest.approx(straight)
    assert times(ALIKE, start, Pose(0.0, 5.0, 0.0))[0] == pytest.approx(straight)


def test_a_base_that_is_slower_aside_turns_to_the_front_for_long_drives_only() -> None:
    start = RobotState(Pose(0.0, 0.0, 0.0))

    def middle(distance: float) -> RobotState:
        plan = planar_plan(start, Pose(0.0, distance, 0.0), 0.0, UNLIKE.limits)
        return plan.at(0.5 * plan.duration)

    near, far = middle(1.0), middle(20.0)
    assert near.pose.yaw == pytest.approx(0.0, abs=1e-6)
    assert near.vy > 0.1
    assert far.pose.yaw == pytest.approx(math.pi / 2.0)
    assert far.vx == pytest.approx(UNLIKE.limits.v)
    only_aside = 20.0 / UNLIKE.limits.sideways
    assert times(UNLIKE, start, Pose(0.0, 20.0, 0.0))[0] < only_aside


def test_a_turn_on_the_spot_takes_as_long_as_the_limits_say() -> None:
    limits = ALIKE.limits
    start = RobotState(Pose(1.0, 1.0, 0.0))
    time, turned = times(ALIKE, start, Pose(1.0, 1.0, 3.0))
    assert turned == pytest.approx(3.0)
    assert time == pytest.approx(3.0 / limits.w + limits.w / limits.aw)


@given(st.floats(0.1, 6.0), st.floats(0.1, 6.0), st.floats(-3.0, 3.0))
@settings(max_examples=60, deadline=None)
def test_a_farther_goal_takes_longer(near: float, more: float, yaw: float) -> None:
    start = RobotState(Pose(0.0, 0.0, yaw))
    first, second = Pose(near, 0.0, yaw), Pose(near + more, 0.0, yaw)
    assert times(UNLIKE, start, first)[0] < times(UNLIKE, start, second)[0]
