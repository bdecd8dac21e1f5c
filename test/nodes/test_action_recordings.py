"""Recordings of an action server's own topics, with messages as ROS itself writes them; no node runs."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from bag_types import own_types
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from ator_interfaces.action import DriveTo
from ator_interfaces.msg import ActionPerformance
from ator_ros.domains.domain import find_domain
from ator_ros.experience.recordings import RecordingError, read_recording
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import odometry_of, pose_of
from ator_ros.world.state import RobotState

TOUR = find_domain("tour")
ROBOT = TOUR.robot()
ACCEPTED, SUCCEEDED, CANCELED, ABORTED = 1, 4, 5, 6
ASKED, RESULT = DriveTo.Impl.SendGoalService, DriveTo.Impl.GetResultService
DEFINITION = "raw text of an .action file\n---\nas newer recorders put it\n---\n"
TOPICS = {
    "odom": Odometry,
    "drive_to/_action/send_goal/_service_event": ASKED.Event,
    "drive_to/_action/get_result/_service_event": RESULT.Event,
    "drive_to/_action/status": GoalStatusArray,
    "performance/action": ActionPerformance,
}


class Bag:
    """A recording of a robot that drives straight ahead at 0.5 m/s, tick by tick.

    Parameters
    ----------
    folder : Path
        Where it is written.
    namespaces : (str, str)
        Of odometry and of the server.
    """

    def __init__(self, folder: Path, *, namespaces: tuple[str, str] = ("/", "/")) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.open()
        self._links: dict[str, Any] = {}
        self._namespaces, self._store = namespaces, own_types()
        self._time, self.pose, self._number = 0.0, Pose(0.0, 0.0, 0.0), 0

    def write(self, topic: str, message: Any) -> None:
        """Write a message at the present time."""
        if topic not in self._links:
            name = self._namespaces["_action" in topic] + topic
            package, folder, *_ = type(message).__module__.split(".")
            kind = f"{package}/{folder}/{type(message).__name__}"
            known = {"typestore": self._store} if "/msg/" in kind else {"msgdef": DEFINITION, "rihs01": "0"}
            self._links[topic] = self._writer.add_connection(name, kind, **known)
        self._writer.write(self._links[topic], int(1e9 * self._time), serialize_message(message))

    def drive(self, duration: float, v: float = 0.5) -> None:
        """Let the robot drive for so many s."""
        for _ in range(round(duration / 0.05)):
            self._time += 0.05
            self.pose = self.pose.ahead(0.05 * v)
            self.write("odom", odometry_of(self._time, RobotState(self.pose, v), frame="odom", child="base"))

    def ask(self, goal: Pose, *, frame: str = "odom", accepted: bool = True) -> list[int]:
        """Write a request as client and server tell of it, and its answer; return the goal's id."""
        number = list(uuid.uuid4().bytes)
        message = DriveTo.Goal()
        message.goal.pose, message.goal.header.frame_id = pose_of(goal), frame
        request = ASKED.Request(goal=message)
        request.goal_id.uuid = number
        self._number += 1
        for kind in (0, 1):
            self._event("send_goal", ASKED, kind, request=[request])
        for kind in (2, 3):
            self._event("send_goal", ASKED, kind, response=[ASKED.Response(accepted=accepted)])
        return number

    def answer(self, number: list[int], status: int, error: int = 0) -> None:
        """Write how a goal ended."""
        self._number += 1
        request = RESULT.Request()
        request.goal_id.uuid = number
        self._event("get_result", RESULT, 1, request=[request])
        result = DriveTo.Result(error_code=error, error_msg="blocked" if error else "")
        self._event("get_result", RESULT, 2, response=[RESULT.Response(status=status, result=result)])

    def _event(self, service: str, kind: Any, event: int, **parts: Any) -> None:
        message = kind.Event(**parts)
        message.info.event_type, message.info.sequence_number = event, self._number
        self.write(f"drive_to/_action/{service}/_service_event", message)

    def status(self, number: list[int], status: int) -> None:
        """Write the server's list of goals."""
        item = GoalStatus(status=status)
        item.goal_info.goal_id.uuid = number
        self.write("drive_to/_action/status", GoalStatusArray(status_list=[item]))

    def close(self) -> None:
        self._writer.close()


def recorded(folder: Path, happens: Callable[[Bag], None], **options: Any) -> Any:
    """Return the experience of a recording in which something happens."""
    bag = Bag(folder / "bag", **options)
    happens(bag)
    bag.close()
    return read_recording(folder / "bag", ROBOT, TOUR)


def visit(bag: Bag) -> None:
    bag.drive(1.0, v=0.0)
    number = bag.ask(bag.pose.ahead(1.0))
    bag.drive(2.0)
    bag.answer(number, SUCCEEDED)
    bag.drive(0.5, v=0.0)


@pytest.mark.parametrize("namespaces", [("/", "/"), ("/ann/", "/ann/"), ("/ann/", "/fleet/")])
def test_goals_and_results_of_a_server_are_experience(tmp_path: Path, namespaces: tuple[str, str]) -> None:
    frame = recorded(tmp_path, visit, namespaces=namespaces).of("drive_to")
    assert frame["duration"].unique() == pytest.approx([2.0])
    assert frame["t"].tolist() == pytest.approx([0.1 * tick for tick in range(20)])
    start = frame.iloc[0]
    assert start[["x", "y", "yaw", "xg", "yg", "yawg"]].tolist() == pytest.approx([0, 0, 0, 1, 0, 0])
    assert (start["success"], start["reason"]) == (True, "drive_to succeeded")
    assert (start["position_error"], start["heading_error"]) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_failures_are_told_and_what_was_broken_off_is_left_out(tmp_path: Path) -> None:
    def happens(bag: Bag) -> None:
        bag.drive(0.5, v=0.0)
        blocked = bag.ask(Pose(2.0, 0.0, 0.0))
        bag.drive(1.0)
        bag.answer(blocked, ABORTED, error=1)
        far = bag.ask(Pose(9.0, 0.0, 0.0))
        bag.drive(1.0)
        bag.answer(far, SUCCEEDED)
        canceled = bag.ask(Pose(2.0, 0.0, 0.0))
        bag.drive(1.0)
        bag.answer(canceled, CANCELED, error=3)
        bag.ask(Pose(2.0, 0.0, 0.0), accepted=False)
        elsewhere = bag.ask(Pose(2.0, 0.0, 0.0), frame="map")
        bag.drive(1.0)
        bag.answer(elsewhere, SUCCEEDED)
        bag.ask(Pose(2.0, 0.0, 0.0))  # the recording ends before
        bag.drive(1.0)

    experience = recorded(tmp_path, happens)
    frame = experience.of("drive_to").drop_duplicates("episode")
    assert frame["success"].tolist() == [False, False]
    assert frame["reason"].tolist() == [
        "its goal is aborted; error_code: expected 0, got 1 (blocked)",
        "post-condition of visit: expected robot.x within 0.25 of goal.x, it is 8 off",
    ]
    assert experience.metadata["records_left_out"] == 2  # the canceled one, and the one in another frame
    assert "bag: left out 2 of 4 goals of drive_to: expected its end and its result, got canceled" in (
        experience.remarks
    )


def test_a_goal_that_no_robot_can_have_reached_is_left_out_with_its_reason(tmp_path: Path) -> None:
    def happens(bag: Bag) -> None:
        visit(bag)
        number = bag.ask(bag.pose.ahead(1e5))
        bag.drive(1.0)
        bag.answer(number, ABORTED, error=1)

    (said,) = recorded(tmp_path, happens).remarks
    assert said.startswith("bag: left out 1 of 2 goals of drive_to: start: expected at most ")


def test_status_tells_when_goals_begin_and_end_where_results_come_late(tmp_path: Path) -> None:
    def happens(bag: Bag) -> None:
        bag.drive(0.5, v=0.0)
        number = bag.ask(bag.pose.ahead(1.0))
        bag.status(number, ACCEPTED)
        bag.drive(2.0)
        bag.status(number, SUCCEEDED)
        bag.drive(1.0, v=0.0)
        bag.answer(number, SUCCEEDED)

    frame = recorded(tmp_path, happens).of("drive_to")
    assert frame["duration"].unique() == pytest.approx([2.0])


def performed(action: str, duration: float) -> ActionPerformance:
    record = ActionPerformance(action=action)
    record.call.top, record.outcome.code = "visit" if action == "drive_to" else action, 1
    record.start.robot = record.call.goal.pose = pose_of(Pose(0.0, 0.0, 0.0))
    record.actual.duration, record.actual.accuracy, record.heading_error = duration, 0.0, 0.0
    return record


def test_records_count_where_the_servers_topics_do_not_tell(tmp_path: Path) -> None:
    def both(bag: Bag) -> None:
        visit(bag)
        bag.write("performance/action", performed("drive_to", 7.0))
        bag.write("performance/action", performed("creep", 8.0))

    experience = recorded(tmp_path, both)
    assert experience.of("drive_to")["duration"].unique() == pytest.approx([2.0])
    assert experience.of("creep")["duration"].tolist() == [8.0]

    def without_results(bag: Bag) -> None:
        bag.drive(0.5, v=0.0)
        number = bag.ask(bag.pose.ahead(1.0))
        bag.drive(2.0)
        bag.status(number, SUCCEEDED)
        bag.write("performance/action", performed("drive_to", 7.0))

    (tmp_path / "other").mkdir()
    experience = recorded(tmp_path / "other", without_results)
    assert experience.of("drive_to")["duration"].tolist() == [7.0]


def test_a_recording_with_types_that_it_does_not_define_can_be_read(tmp_path: Path) -> None:
    """As Jazzy's recorder leaves those of actions: without a definition, in an unknown encoding."""
    bag = Bag(tmp_path / "bag")
    visit(bag)
    bag.close()
    (file,) = (tmp_path / "bag").glob("*.mcap")
    raw = file.read_bytes()
    before = b"ator_interfaces/action/DriveTo_SendGoal_Event\x07\x00\x00\x00ros2msg"
    assert before in raw
    file.write_bytes(raw.replace(before, before.replace(b"ros2msg", b"unknown")))
    frame = read_recording(tmp_path / "bag", ROBOT, TOUR).of("drive_to")
    assert frame["duration"].unique() == pytest.approx([2.0])


def test_a_server_of_another_type_is_no_experience(tmp_path: Path) -> None:
    def happens(bag: Bag) -> None:
        bag.drive(1.0, v=0.0)
        for _ in range(2):
            bag.write("drive_to/_action/send_goal/_service_event", GoalStatusArray())
        bag.drive(1.0)

    with pytest.raises(RecordingError):
        recorded(tmp_path, happens)
