"""Planning in portions: many manoeuvres are judged as single ones are, and no tick plans for long."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from candidates import candidates_between
from planned import slices_of

from ator_ros.actions.base import ActionError, Goal, Point, Status
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.domains.soccer.field import BALL, ball_of, field_of, objects_of
from ator_ros.domains.soccer.planned.clearance import Obstacles, is_clear
from ator_ros.domains.soccer.planned.go_to_pose import GoToPose
from ator_ros.domains.soccer.planned.planned_action import PlannedAction
from ator_ros.domains.soccer.planned.planner import free_sides, run_sides
from ator_ros.domains.soccer.planned.screening import Verdict, screened
from ator_ros.execution.chain_executor import ChainExecutor
from ator_ros.geometry import Pose
from ator_ros.motion import planning
from ator_ros.motion.manoeuvre import closed
from ator_ros.robot.description import load_robot
from ator_ros.tops.chain import TopCall, TopChain
from ator_ros.world.state import ObjectState, RobotState, World
from benchmarks.speed import hard_situations

ROBOT = load_robot()
LIMITS = GoToPose(ROBOT).plan_limits
LARGEST_PORTION = 100  # points of planning: less than a third of a slice


def hard_worlds(count: int, seed: int) -> list[tuple[World, Goal]]:
    found = hard_situations(ROBOT, 4 * count, seed)
    return [(world, goal) for action, world, goal in found if action == "goToPose"]


@pytest.mark.parametrize("forward_only", [False, True])
def test_many_manoeuvres_are_judged_as_single_ones_are(forward_only: bool) -> None:
    rng, seen = np.random.default_rng(5), np.zeros(3, dtype=int)
    free = World(0.0, RobotState(Pose(-1.0, 0.5, 1.0))), Goal(Pose(1.5, -1.0, 0.0))
    for world, goal in (*hard_worlds(6, seed=41), free):
        run = 0.25 * float(rng.integers(2))
        sides = run_sides(LIMITS, 0.3, run) if run else free_sides(LIMITS, 0.0, 0.0)
        start = world.robot.pose
        entries = free_sides(LIMITS, world.robot.v, 0.0)
        candidates = candidates_between(start, goal.pose, entries, sides, LIMITS)
        which = rng.permutation(min(400, len(candidates)))[:30]
        obstacles = Obstacles(ball_of(world), 0.04, run)
        longest = candidates.times[which] + 0.03
        verdicts = screened(candidates.bundle(which), longest, obstacles, ROBOT, forward_only=forward_only)
        for index, most, verdict in zip(which, longest, verdicts, strict=True):
            seen[verdict] += 1
            one = closed(candidates[int(index)])
            allowed = one is not None and one.duration <= most and (one.is_forward() or not forward_only)
            if verdict == Verdict.IMPOSSIBLE:
                assert not allowed
            elif verdict == Verdict.TOUCHES:
                assert one is not None
                assert allowed
                assert not is_clear(one, obstacles, ROBOT)
            elif one is not None and allowed:  # nearly all that are left open are free
                seen[Verdict.OPEN] -= not is_clear(one, obstacles, ROBOT)
    assert seen.min() > 2, "expected some of each verdict"


def test_no_tick_plans_for_more_than_a_slice() -> None:
    long = 0
    for name, world, goal in hard_situations(ROBOT, 40, seed=3):
        slices = slices_of(SOCCER.actions()[name].factory(ROBOT), world, goal)
        assert max(map(sum, slices)) <= planning.SLICE
        assert max(map(max, filter(None, slices)), default=0) <= LARGEST_PORTION
        long += len(slices) > 1
    assert long > 4, "expected plans that take several ticks"


@pytest.mark.parametrize("action", ["goToPose", "dribbleBall"])
def test_an_ordinary_way_is_planned_in_one_tick(action: str) -> None:
    rng = np.random.default_rng(8)
    for _ in range(30):
        situation = SOCCER.actions()[action].sample(ROBOT, rng)
        world = World(0.0, situation.robot, situation.objects)
        assert len(slices_of(SOCCER.actions()[action].factory(ROBOT), world, situation.goal)) == 1


def test_tables_that_happen_to_be_there_cost_the_same() -> None:
    ball = ROBOT.hold_point(Pose(1.0, 1.0, 2.0))
    world = World(0.0, RobotState(Pose(1.0, 1.0, 2.0), 0.4321), {BALL: ObjectState(ball.x, ball.y)})
    goal = Goal(Pose(*field_of(ROBOT).goal_centre(), 0.0), 0.0, Point.HOLD)
    first, again = (slices_of(SOCCER.actions()["shoot"].factory(ROBOT), world, goal) for _ in range(2))
    assert first == again


def planned_at_once(world: World, goal: Goal, monkeypatch: pytest.MonkeyPatch) -> PlannedAction:
    with monkeypatch.context() as patch:
        patch.setattr(planning, "SLICE", 10**9)
        action = GoToPose(ROBOT)
        action.start(world, goal)
    return action


def hard_way(monkeypatch: pytest.MonkeyPatch) -> tuple[World, Goal, PlannedAction]:
    """Find a situation at rest with a way that takes several slices, of a small size, to find."""
    monkeypatch.setattr(planning, "SLICE", 20)
    for drawn, goal in hard_worlds(60, seed=6):
        world = dataclasses.replace(
            drawn,
            robot=RobotState(drawn.robot.pose),
            objects={name: ObjectState(there.x, there.y) for name, there in drawn.objects.items()},
        )
        action = GoToPose(ROBOT)
        try:
            action.start(world, goal)
            if action.planning:
                return world, goal, planned_at_once(world, goal, monkeypatch)
        except ActionError:
            continue
    raise AssertionError("expected such a situation")


def test_a_robot_in_motion_drives_on_brakes_and_plans_from_where_it_stands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world, goal, _ = hard_way(monkeypatch)
    monkeypatch.setattr(planning, "SLICE", 1)
    action, speed, time = GoToPose(ROBOT), 0.4, 0.0
    pose = world.robot.pose.ahead(-(speed**2) / (2.0 * LIMITS.brake) - 0.35 * speed)
    action.start(World(0.0, RobotState(pose, speed), objects_of(ball_of(world))), goal)
    for _ in range(7):
        step = action.step(World(time, RobotState(pose, speed), objects_of(ball_of(world))))
        assert (step.message, step.command.v) == ("driving on while planning", speed)
        time += 0.05
        pose = pose.ahead(0.05 * speed)
    speeds = []
    while speed > 0.0:
        step = action.step(World(time, RobotState(pose, speed), objects_of(ball_of(world))))
        assert step.message == "planning"
        assert 0.0 < speed - step.command.v <= LIMITS.brake * 0.05 + 1e-9 or step.command.v == 0.0
        speed, time = step.command.v, time + 0.05
        pose = pose.ahead(0.05 * speed)
        speeds.append(speed)
    assert len(speeds) == pytest.approx(0.4 / LIMITS.brake / 0.05, abs=1)
    monkeypatch.setattr(planning, "SLICE", 10**9)
    action.step(World(time, RobotState(pose), objects_of(ball_of(world))))
    assert not action.planning
    assert action._tracker.trajectory.at(0.0).pose.distance(pose) < 1e-9


def test_a_robot_keeps_to_its_plan_while_another_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    action = GoToPose(ROBOT)
    action.start(
        World(0.0, RobotState(Pose(0.0, 0.0, 0.0)), {BALL: ObjectState(2.0, 0.0)}), Goal(Pose(3.0, 1.5, 0.0))
    )
    monkeypatch.setattr(planning, "SLICE", 1)
    moved = ObjectState(2.2, 0.0)
    planned = action._tracker.trajectory.at(0.5)
    step = action.step(World(0.5, planned, objects_of(moved)))
    assert "keeping to the plan while planning" in step.message
    assert step.command.v > 0.1
    monkeypatch.setattr(planning, "SLICE", 10**9)
    step = action.step(World(0.55, action._tracker.trajectory.at(0.55), objects_of(moved)))
    assert step.message == "there is another way; planning"
    assert action.planning


def test_a_tick_begins_one_action_at_most() -> None:
    library = SOCCER.library(ROBOT)
    here = Pose(1.0, 0.5, 0.3)
    call = TopCall(library["goToPose"], Goal(here), frozenset({"x", "y", "yaw", "speed"}))
    executor = ChainExecutor(library, TopChain((call,) * 5))
    for tick in range(1, 5):
        step = executor.step(World(0.05 * tick, RobotState(here)))
        assert step.status is Status.RUNNING
        assert len(executor.records) <= tick
    assert math.isclose(step.elapsed, 0.15)
