"""Random situations: which goals are short, and draws that find no place."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from ator_ros.actions.base import Action, Goal, Status, Step, finished
from ator_ros.actions.remote import UnreachableAction
from ator_ros.actions.situation import (
    SHORT,
    ActionSpec,
    NoPlaceError,
    Situation,
    drawn_until,
    short_goal,
)
from ator_ros.bases.description import Robot, load_robot
from ator_ros.geometry import Pose, wrap_angle
from ator_ros.world.state import RobotState, World

START = Pose(1.0, -2.0, 0.7)
DRAWS = 20_000


def short_goals(*, turns: bool = True) -> tuple[list[Pose], int]:
    """Draw many goals: the short ones, and the number of others."""
    rng = np.random.default_rng(3)
    drawn = [short_goal(START, rng, turns=turns) for _ in range(DRAWS)]
    found = [goal for goal in drawn if goal is not None]
    return found, DRAWS - len(found)


def test_the_shares_of_short_goals() -> None:
    goals, others = short_goals()
    turned = [goal for goal in goals if goal[:2] == START[:2] and goal != START]
    same = [goal for goal in goals if goal == START]
    near = [goal for goal in goals if goal.distance(START) > 0.0]
    assert others / DRAWS == pytest.approx(0.85, abs=0.01)
    assert len(turned) / DRAWS == pytest.approx(0.06, abs=0.006)
    assert len(same) / DRAWS == pytest.approx(0.015, abs=0.004)
    assert len(near) / DRAWS == pytest.approx(0.075, abs=0.008)


def test_turns_on_the_spot_and_short_drives_have_all_headings_and_directions() -> None:
    goals, _ = short_goals()
    turned = [goal.yaw for goal in goals if goal[:2] == START[:2] and goal != START]
    driven = [goal for goal in goals if goal.distance(START) > 0.05]
    directions = [math.atan2(goal.y - START.y, goal.x - START.x) for goal in driven]
    for angles in (turned, directions, [goal.yaw for goal in driven]):
        assert all(-math.pi <= angle <= math.pi for angle in angles)
        shares = np.histogram(angles, bins=4, range=(-math.pi, math.pi))[0] / len(angles)
        assert shares == pytest.approx([0.25] * 4, abs=0.04)
    lengths = [goal.distance(START) for goal in driven]
    assert max(lengths) <= SHORT
    assert np.histogram(lengths, bins=3, range=(0.05, SHORT))[0] == pytest.approx(
        [len(lengths) / 3] * 3, rel=0.2
    )


def test_a_robot_at_its_goal_is_within_centimeters_and_some_degrees() -> None:
    goals, _ = short_goals()
    at_goal = [goal for goal in goals if 0.0 < goal.distance(START) < 0.02]
    turned = [wrap_angle(goal.yaw - START.yaw) for goal in at_goal]
    small = [angle for angle in turned if abs(angle) < 0.1]
    assert len(small) > 0.6 * len(at_goal)  # a few are short drives with any heading
    assert max(map(abs, small)) <= 0.08
    assert min(small) < -0.06 < 0.06 < max(small)
    distances = [
        goal.distance(START)
        for goal, angle in zip(at_goal, turned, strict=True)
        if abs(angle) <= 0.08
    ]
    assert np.mean(np.array(distances) > 0.01) == pytest.approx(0.5, abs=0.15)
    beyond = [goal for goal in goals if 0.03 < goal.distance(START) < 0.06]
    assert np.mean([abs(wrap_angle(goal.yaw - START.yaw)) < 0.08 for goal in beyond]) < 0.15


def test_without_turns_the_other_short_goals_remain() -> None:
    goals, others = short_goals(turns=False)
    assert others / DRAWS == pytest.approx(0.91, abs=0.01)
    assert not [goal for goal in goals if goal[:2] == START[:2] and goal != START]


def test_draws_are_repeated_until_one_fits() -> None:
    numbers = itertools.count()
    assert drawn_until(lambda: next(numbers), lambda found: found == 7, lambda: "a 7") == 7
    assert next(numbers) == 8


@pytest.mark.parametrize(("most", "message"), [(1, "a 7"), (3, "a 7: none of 3 draws fits")])
def test_draws_without_success_end(most: int, message: str) -> None:
    numbers = itertools.count()
    with pytest.raises(NoPlaceError) as raised:
        drawn_until(lambda: next(numbers), lambda _: False, lambda: "a 7", most=most)
    assert str(raised.value) == message
    assert next(numbers) == most


def test_by_default_rare_situations_are_found() -> None:
    numbers = itertools.count()
    assert drawn_until(lambda: next(numbers), lambda found: found == 9_000, lambda: "") == 9_000
    with pytest.raises(NoPlaceError):
        drawn_until(lambda: next(numbers), lambda _: False, lambda: "")


class Wait(Action):
    name = "wait"

    def start(self, world: World, goal: Goal) -> None:
        pass

    def step(self, world: World) -> Step:
        return finished(Status.SUCCEEDED, "waited")


def drive(robot: Robot, rng: np.random.Generator) -> Situation:
    end = Pose(float(rng.uniform(-1.0, 1.0)), 0.0, 0.0)
    return Situation("drive", RobotState(START), {}, Goal(end))


@pytest.mark.parametrize(
    ("factory", "reason"),
    [
        (Wait, None),
        (UnreachableAction, "drive has no `stand_in`, so only `collect --over-ros` and the nodes"),
    ],
)
def test_only_an_action_with_a_program_runs_in_the_simulator(
    factory: Callable[[Robot], Action], reason: str | None
) -> None:
    found = ActionSpec("drive", factory, drive).over_ros_only
    assert found is None if reason is None else str(found).startswith(reason)


def test_an_unreachable_action_never_starts() -> None:
    action = UnreachableAction(load_robot())
    world = World(0.0, RobotState(START))
    with pytest.raises(ValueError, match="over ROS only"):
        action.start(world, Goal(START))
    with pytest.raises(NotImplementedError):
        action.step(world)


def test_the_situations_of_an_action_are_those_of_its_sampler() -> None:
    robot = load_robot()
    spec = ActionSpec("drive", Wait, drive)
    drawn = spec.situation(robot, np.random.default_rng(5))
    assert drawn == drive(robot, np.random.default_rng(5))
