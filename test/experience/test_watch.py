"""Drives of an action server while they happen: each ends once, and memory stays bounded."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import ROBOT
from domain_files import changed, file_of
from watched_robot import ABORTED, CANCELED, EXECUTING, SUCCEEDED, TICK, Robot

from ator_ros.domains.domain import find_domain
from ator_ros.experience.server_drives import Watch
from ator_ros.experience.server_goals import ServerGoal
from ator_ros.experience.table import Episode
from ator_ros.geometry import Pose


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    domain = find_domain(str(file_of(tmp_path, changed("tops.0.pre", []))))
    return Robot(Watch(ROBOT, domain))


def episode_of(robot: Robot, goal: ServerGoal) -> Any:
    return robot.watch.episode(goal)


def test_a_drive_is_an_episode_as_soon_as_it_has_ended(robot: Robot) -> None:
    goal = robot.drive(1)
    episode = episode_of(robot, goal)
    assert isinstance(episode, Episode)
    assert episode.success
    assert episode.duration == pytest.approx(2.0)
    assert episode.position_error == pytest.approx(0.0, abs=1e-9)
    assert episode.situation.goal.pose == pytest.approx(Pose(1.0, 0.0, 0.0))
    assert goal.first_path == pytest.approx(np.array([(0.0, 0.0), (1.0, 0.0)]))
    assert robot.watch.take_ended() == []


@pytest.mark.parametrize(
    ("code", "recoveries", "reason"),
    [
        (SUCCEEDED, 2, "its server recovered on the way"),
        (CANCELED, 0, "canceled"),
    ],
)
def test_disturbed_drives_are_told_apart(
    robot: Robot, code: int, recoveries: int, reason: str
) -> None:
    assert episode_of(robot, robot.drive(1, code, recoveries)) == reason


def test_a_preempted_drive_is_no_failure(robot: Robot) -> None:
    robot.set_state(1, EXECUTING)
    robot.set_state(2, EXECUTING)
    robot.set_state(1, ABORTED)
    (goal,) = robot.watch.take_ended()
    assert episode_of(robot, goal) == "preempted by another goal"


@pytest.mark.parametrize(("place", "passes"), [(0.9, True), (0.6, False), (1.25, True)])
def test_a_drive_that_is_preempted_at_its_goal_has_passed_it(
    tmp_path: Path, place: float, passes: bool
) -> None:
    fields = changed("tops.0.pre", [])
    fields["actions"][0]["remote"]["early"] = True
    robot = Robot(Watch(ROBOT, find_domain(str(file_of(tmp_path, fields)))))
    robot.start(1)
    for _ in range(round(place / (0.5 * TICK))):
        robot.odometry(0.5)
    robot.set_state(2, EXECUTING)
    robot.set_state(1, ABORTED)
    if passes:
        assert robot.watch.take_ended() == []
        robot.watch.forget()
        while robot.x < 1.5:
            robot.odometry(0.5)
            robot.watch.forget()
    (goal,) = robot.watch.take_ended()
    episode = episode_of(robot, goal)
    assert goal.is_passed is passes
    if passes:
        assert episode.success
        assert episode.duration == pytest.approx(place / 0.5)
        nearest = max(0.0, place - 1.0)
        assert episode.position_error == pytest.approx(nearest, abs=0.02)
        assert episode.nearer == pytest.approx(abs(place - 1.0) - nearest, abs=0.02)
        assert episode.situation.goal.values == {"stop": 0.0}
    else:
        assert episode == "preempted by another goal"


def test_a_server_that_restarts_has_lost_its_goal(robot: Robot) -> None:
    robot.start(1)
    robot.odometry(0.5)
    robot.states.clear()
    robot.start(2)
    (goal,) = robot.watch.take_ended()
    assert episode_of(robot, goal) == "its server ended or restarted"
    (active,) = robot.watch.active
    assert active.goal_id != goal.goal_id
    robot.watch.lose("navigate")
    assert robot.watch.active == []
    assert len(robot.watch.take_ended()) == 1


def test_an_aborted_drive_is_a_failure(robot: Robot) -> None:
    assert not episode_of(robot, robot.drive(1, ABORTED, recoveries=3)).success


def test_estimates_of_the_server_are_of_the_whole_drive(robot: Robot) -> None:
    assert robot.drive(1).server_estimates == pytest.approx([5.0])


def test_estimates_that_come_in_each_loop_of_a_tree_are_of_the_whole_drive(robot: Robot) -> None:
    robot.start(1)
    for _ in range(400):  # 20 s of a drive with feedback at 100 Hz, as of Nav2
        robot.odometry(0.0)
        for _ in range(5):
            robot.feedback(1, 0, 5.0)
    (goal,) = robot.watch.active
    assert len(goal.server_estimates) == pytest.approx(40, abs=1)
    assert goal.server_estimates[-1] == pytest.approx(25.0, abs=0.5)


def test_memory_stays_bounded_and_no_drive_ends_twice(robot: Robot) -> None:
    numbers = []
    for goal in range(200):
        robot.drive(goal)
        for _ in range(100):
            robot.odometry(0.0)
        robot.watch.forget()
        robot.states = dict(list(robot.states.items())[-20:])  # as servers forget theirs
        rows = sum(len(segment.odom) for segment in robot.watch.segments)
        numbers.append((rows, len(robot.watch.goals)))
    assert max(rows for rows, _ in numbers) < 2000
    assert max(goals for _, goals in numbers) <= 101
    assert robot.watch.take_ended() == []


def test_paths_from_elsewhere_are_answers_to_other_clients(robot: Robot) -> None:
    robot.start(1)
    robot.plan((robot.x + 3.0, 0.0), (9.0, 9.0))
    robot.finish(1)
    (goal,) = robot.watch.take_ended()
    assert goal.pose is not None
    assert goal.pose.x == pytest.approx(1.0)


def test_a_path_from_the_robot_to_elsewhere_is_an_answer_to_another_client(robot: Robot) -> None:
    robot.start(1)
    robot.plan((robot.x, 0.0), (1.0, 0.0))  # planned again
    robot.plan((robot.x, 0.0), (9.0, 9.0))
    robot.plan((robot.x, 0.0), (1.0, 0.0))
    robot.plan((robot.x, 0.0), (5.0, 9.0))
    robot.finish(1)
    (goal,) = robot.watch.take_ended()
    assert goal.pose is not None
    assert goal.pose.x == pytest.approx(1.0)
    assert goal.first_path == pytest.approx(np.array([(0.0, 0.0), (1.0, 0.0)]))


def test_a_goal_may_move(robot: Robot) -> None:
    robot.start(1)
    for x in (1.0, 1.2, 1.4, 3.0, 3.2):
        robot.plan((robot.x, 0.0), (x, 0.0))
    (goal,) = robot.watch.active
    assert goal.pose is not None
    assert goal.pose.x == pytest.approx(3.2)


def test_a_goal_without_an_end_does_not_fill_the_memory(robot: Robot) -> None:
    robot.start(1)
    for _ in range(3):
        robot.time += 1300.0  # without odometry
        for _ in range(1100):
            robot.odometry(0.0)
        robot.watch.forget()
    assert sum(len(segment.odom) for segment in robot.watch.segments) < 2300
    robot.finish(1)
    (goal,) = robot.watch.take_ended()
    assert episode_of(robot, goal) == "odometry was interrupted"


def test_a_path_may_come_just_before_the_message_that_its_goal_is_executed(robot: Robot) -> None:
    robot.drive(1)
    robot.plan((robot.x, 0.0), (robot.x + 0.5, 0.0))
    robot.set_state(2, EXECUTING)
    (goal,) = robot.watch.active
    assert goal.pose is not None
    assert goal.pose.x == pytest.approx(robot.x + 0.5)
    robot.plan((robot.x, 0.0), (robot.x + 2.0, 0.0))  # that one led elsewhere
    assert goal.first_path is not None
    assert goal.first_path[-1, 0] == pytest.approx(robot.x + 2.0)


def test_a_drive_that_began_before_is_none(robot: Robot) -> None:
    robot.time += 100.0
    robot.odometry(0.0)
    robot.states[7] = EXECUTING, 1.0
    robot.set_state(7, EXECUTING)
    robot.set_state(7, SUCCEEDED)
    (goal,) = robot.watch.take_ended()
    assert episode_of(robot, goal) == "accepted before the recording began"
