"""What rounds would have saved: by hand, for a model that turns, drives and turns."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from refinement_fakes import FakeModel

from ator_ros.domains.domain import find_domain
from ator_ros.experience.watched_paths import WatchedPaths
from ator_ros.geometry import Pose, wrap_angles
from ator_ros.learning.savings import (
    LONGEST_ROUND,
    Round,
    Rounds,
    RoundSavings,
    Saving,
    missing_legs,
    savings_of,
)
from ator_ros.world.state import RobotState

DOMAIN = find_domain("pursuit")
LIBRARY = DOMAIN.library(DOMAIN.robot())
START = RobotState(Pose(0.0, 0.0, 0.0))
RIGHT_ANGLE = math.pi / 2.0


def duration(direct: Any) -> Any:
    """Turn to the goal, drive at 1 m/s, turn to its heading; turns at 1 rad/s."""
    dx, dy = direct["xg"] - direct["x"], direct["yg"] - direct["y"]
    bearing = np.arctan2(dy, dx)
    turns = np.abs(wrap_angles(bearing - direct["yaw"]))
    return np.hypot(dx, dy) + turns + np.abs(wrap_angles(direct["yawg"] - bearing))


USED = frozenset({"x", "y", "yaw", "xg", "yg", "yawg"})
MODELS = {"pursue": FakeModel(duration, USED)}


def savings(*goals: Pose, knows_all: bool = True) -> RoundSavings:
    return savings_of(Round("pursue", START, goals), LIBRARY, MODELS, knows_all=knows_all)


def test_a_heading_across_the_way_costs_both_turns() -> None:
    found = savings(Pose(2.0, 0.0, RIGHT_ANGLE), Pose(4.0, 0.0, 0.0))
    assert found.headings.seconds == pytest.approx(2.0 * RIGHT_ANGLE, abs=0.05)
    assert found.headings.half > 0.0
    assert math.isnan(found.passing.seconds)  # the server cannot pass goals


def test_the_last_goal_keeps_its_heading_and_its_place() -> None:
    found = savings(Pose(2.0, 0.0, 0.0), Pose(4.0, 0.0, RIGHT_ANGLE))
    assert found.headings.seconds == pytest.approx(0.0, abs=0.01)
    forth_and_back = savings(Pose(1.0, 0.0, 0.0), Pose(4.0, 0.0, 0.0), Pose(2.0, 0.0, math.pi))
    assert forth_and_back.order.seconds == pytest.approx(0.0, abs=0.01)


def test_another_order_saves_the_way_beyond_what_headings_save() -> None:
    goals = (Pose(3.0, 0.0, 0.0), Pose(1.0, 0.0, math.pi), Pose(5.0, 0.0, 0.0))
    found = savings(*goals)
    # Driven: 3 m, half a turn, 2 m, half a turn, 4 m. In order: 5 m without a turn.
    assert found.headings.seconds == pytest.approx(0.0, abs=0.01)
    assert found.order.seconds == pytest.approx(4.0 + 2.0 * math.pi, abs=0.1)
    assert math.isnan(savings(*goals, knows_all=False).order.seconds)


def test_passing_saves_the_stop_beyond_what_headings_save() -> None:
    stop = 1.5  # s
    patrol = find_domain("patrol")
    model = FakeModel(lambda d: duration(d) + stop * d["stopg"], USED | {"stopg"})
    stations = (Pose(2.0, 0.0, 0.0), Pose(4.0, 0.0, 0.0))
    found = savings_of(
        Round("pursue", START, stations),
        patrol.library(patrol.robot()),
        {"pursue": model},
        may_pass=True,
    )
    assert found.headings.seconds == pytest.approx(0.0, abs=0.01)
    short = 0.3  # m before the station where the robot passes it, and s at 1 m/s afterwards
    assert found.passing.seconds == pytest.approx(stop - short, abs=0.1)


def test_savings_of_several_rounds_add_up_with_their_intervals() -> None:
    total = RoundSavings(Saving(1.0, 0.2)).plus(
        RoundSavings(Saving(2.0, 0.3), order=Saving(4.0, 1))
    )
    assert total.headings == Saving(3.0, 0.5)
    assert total.order == Saving(4.0, 1)
    assert math.isnan(total.passing.seconds)


def drive(number: int, begin: float, *, success: bool = True) -> Any:
    """Return a drive of 10 s from station to station, 2 m apart."""
    start, goal = Pose(2.0 * number, 0.0, 0.0), Pose(2.0 * number + 2.0, 0.0, 0.0)
    situation = SimpleNamespace(
        action="pursue", robot=RobotState(start), goal=SimpleNamespace(pose=goal)
    )
    episode = SimpleNamespace(situation=situation, success=success)
    ended = SimpleNamespace(action="pursue", begin=begin, end=begin + 10.0)
    return SimpleNamespace(goal=ended, episode=episode)


def test_drives_that_follow_each_other_are_a_round() -> None:
    rounds = Rounds()
    for number in range(3):
        assert rounds.add(drive(number, 15.0 * number)) is None
    assert not rounds.is_over(60.0)
    assert rounds.is_over(110.0)
    found = rounds.close()
    assert found is not None
    assert [goal.x for goal in found.goals] == [2.0, 4.0, 6.0]
    assert rounds.close() is None


@pytest.mark.parametrize("begin", [100.0, 40.0])
def test_a_pause_or_a_failure_ends_a_round(begin: float) -> None:
    rounds = Rounds()
    for number in range(2):
        rounds.add(drive(number, 15.0 * number))
    found = rounds.add(drive(2, begin, success=begin > 90.0))
    assert found is not None
    assert len(found.goals) == 2


def test_a_long_round_is_divided() -> None:
    rounds = Rounds()
    found = [rounds.add(drive(number, 11.0 * number)) for number in range(LONGEST_ROUND + 1)]
    assert [each is not None for each in found] == [False] * LONGEST_ROUND + [True]


def test_legs_without_a_path_are_missing() -> None:
    goals = (Pose(2.0, 0.0, 0.0), Pose(4.0, 0.0, 0.0))
    paths = WatchedPaths()
    paths.add((0.0, 0.0), (2.0, 0.0), np.array([(0.0, 0.0), (2.0, 0.0)]))
    found = missing_legs(Round("pursue", START, goals), paths)
    assert (goals[0], goals[1]) in found
    assert (START.pose, goals[0]) not in found
    assert len(found) == 3
