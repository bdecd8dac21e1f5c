"""Drives of an action server while they happen: each ends once, and memory stays bounded."""

from pathlib import Path
from types import SimpleNamespace as Message
from typing import Any

import numpy as np
import pytest
from bags import ROBOT, Messages, Tick
from domain_files import changed, file_of

from ator_ros.domains.domain import find_domain
from ator_ros.experience.server_drives import Watch
from ator_ros.experience.server_goals import ServerGoal
from ator_ros.experience.table import Episode
from ator_ros.geometry import Pose

SERVER = "navigate_to_pose"
STATUS, FEEDBACK = f"{SERVER}/_action/status", f"{SERVER}/_action/feedback"
EXECUTING, SUCCEEDED, CANCELED, ABORTED = 2, 4, 5, 6
TICK, SPEED = 0.05, 0.5


class Robot:
    """Drives along x at 0.5 m/s for each goal; each drive is 1 m and takes 2 s."""

    def __init__(self, watch: Watch) -> None:
        self.watch, self.make = watch, Messages()
        self.time = self.x = 0.0
        self.states: dict[int, tuple[int, float]] = {}
        self.odometry(0.0)

    def odometry(self, speed: float) -> None:
        self.time += TICK
        self.x += TICK * speed
        tick = Tick(self.time, Pose(self.x, 0.0, 0.0), speed, 0.0)
        self.watch.add("odom", self.make.odometry(tick))

    def set_state(self, goal: int, code: int) -> None:
        self.states[goal] = code, self.states.get(goal, (0, self.time))[1]
        items = []
        for number, (status, accepted) in self.states.items():
            stamp = self.make.header(accepted, "").stamp
            info = Message(goal_id=Message(uuid=np.full(16, number, np.uint8)), stamp=stamp)
            items.append(Message(goal_info=info, status=status))
        self.watch.add(STATUS, Message(status_list=items))

    def plan(self, *places: tuple[float, float]) -> None:
        poses = [self.make.stamped(self.time, *place) for place in places]
        header = self.make.header(self.time, "odom")
        self.watch.add("plan", Message(header=header, poses=poses))

    def feedback(self, goal: int, recoveries: int, remaining: float) -> None:
        seconds = self.make.header(remaining, "").stamp
        values = Message(number_of_recoveries=recoveries, estimated_time_remaining=seconds)
        goal_id = Message(uuid=np.full(16, goal, np.uint8))
        self.watch.add(FEEDBACK, Message(goal_id=goal_id, feedback=values))

    def drive(self, goal: int, code: int = SUCCEEDED, recoveries: int = 0) -> ServerGoal:
        self.set_state(goal, EXECUTING)
        self.plan((self.x, 0.0), (self.x + 1.0, 0.0))
        for _ in range(round(1.0 / SPEED / TICK)):
            self.odometry(SPEED)
        self.feedback(goal, recoveries, 3.0)
        self.set_state(goal, code)
        (ended,) = self.watch.take_ended()
        return ended


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


def test_an_aborted_drive_is_a_failure(robot: Robot) -> None:
    assert not episode_of(robot, robot.drive(1, ABORTED, recoveries=3)).success


def test_estimates_of_the_server_are_of_the_whole_drive(robot: Robot) -> None:
    assert robot.drive(1).server_estimates == pytest.approx([2.0 + 3.0])


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
