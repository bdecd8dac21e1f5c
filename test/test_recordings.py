"""Experience from recordings, made here with rosbags' writer."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_types import own_types
from turning_action import TurnDriveTurn

from ator_ros.actions.base import Goal, Point, Status
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.experience.drives import _spans
from ator_ros.experience.recordings import RecordingError, read_recording
from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.robot.description import load_robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.tools import train
from ator_ros.world.state import STOP, Command, World

ROBOT = load_robot()
FEEDBACK = "nav2_msgs/action/NavigateToPose_FeedbackMessage"
GOALS = (Pose(1.0, 0.5, 1.0), Pose(-0.5, 0.5, 3.0))


def record(
    folder: Path,
    *,
    topics: tuple[str, ...] = ("/robot/odom", "/robot/cmd_vel"),
    jump: float = 0.0,
    undefined: bool = False,
) -> list[float]:
    """Record two drives with pauses as the nodes would, and give their durations in s.

    The robot's clock jumps by `jump` s between them. An `undefined` topic is one of an action's types.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types = {"odom": "nav_msgs/msg/Odometry", "cmd_vel": "geometry_msgs/msg/Twist"}
    durations = []
    with (
        Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
        Simulation(ROBOT) as sim,
    ):
        links = {
            topic.rpartition("/")[2]: writer.add_connection(
                topic, types[topic.rpartition("/")[2]], typestore=store
            )
            for topic in topics
        }
        if undefined:
            writer.add_connection("/nav/_action/feedback", FEEDBACK, msgdef="text\n---\n", rihs01="0")

        def write(topic: str, message: object, time: float) -> None:
            if topic in links:
                kind = types[topic]
                writer.write(links[topic], int(time * 1e9), store.serialize_cdr(message, kind))

        def tick(command: Command) -> World:
            world = sim.world()
            shifted = dataclasses.replace(world, time=world.time + jump * bool(durations))
            write("odom", odometry(store, shifted), world.time)
            write("cmd_vel", twist(store, command), world.time + 0.001)
            sim.command(command)
            sim.tick()
            return sim.world()

        for goal in GOALS:
            action = TurnDriveTurn(ROBOT)
            world = sim.world()
            start = world.time
            action.start(world, Goal(goal, 0.0, Point.AXLE))
            while (step := action.step(world)).status is Status.RUNNING:
                world = tick(step.command)
            durations.append(world.time - start)
            for _ in range(12):
                tick(STOP)
    return durations


def odometry(store: Any, world: World) -> object:
    types = store.types
    robot, zeros = world.robot, np.zeros(36)
    vector, point = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Point"]
    seconds = int(world.time)
    stamp = types["builtin_interfaces/msg/Time"](seconds, round((world.time - seconds) * 1e9) % 1_000_000_000)
    pose = types["geometry_msgs/msg/Pose"](
        point(robot.pose.x, robot.pose.y, 0.0),
        types["geometry_msgs/msg/Quaternion"](*quaternion_from_yaw(robot.pose.yaw)),
    )
    speed = types["geometry_msgs/msg/Twist"](vector(robot.v, 0.0, 0.0), vector(0.0, 0.0, robot.w))
    return types["nav_msgs/msg/Odometry"](
        types["std_msgs/msg/Header"](stamp, "odom"),
        "base_link",
        types["geometry_msgs/msg/PoseWithCovariance"](pose, zeros),
        types["geometry_msgs/msg/TwistWithCovariance"](speed, zeros),
    )


def twist(store: Any, command: Command) -> object:
    vector = store.types["geometry_msgs/msg/Vector3"]
    return store.types["geometry_msgs/msg/Twist"](vector(command.v, 0.0, 0.0), vector(0.0, 0.0, command.w))


def test_drives_are_found_with_their_goals_and_durations(tmp_path: Path) -> None:
    durations = record(tmp_path / "bag")
    experience = read_recording(tmp_path / "bag", ROBOT, SOCCER)
    frame = experience.of("goToPose")
    starts = frame[frame["t"] == 0.0]
    assert starts["duration"].to_numpy() == pytest.approx(durations, abs=0.06)
    assert starts[["xg", "yg"]].to_numpy() == pytest.approx(np.array([goal[:2] for goal in GOALS]), abs=0.07)
    assert np.allclose(frame["t"] + frame["time_to_go"], frame["duration"])
    assert set(frame["hold"]) == {0}
    assert starts["v"].abs().max() < 0.05
    assert experience.metadata["robot_digest"] == ROBOT.digest()


def test_topics_of_actions_without_a_definition_are_passed_over(tmp_path: Path) -> None:
    durations = record(tmp_path / "bag", undefined=True)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    before = FEEDBACK.encode() + b"\x07\x00\x00\x00ros2msg"
    raw = file.read_bytes()
    assert before in raw
    file.write_bytes(raw.replace(before, before.replace(b"ros2msg", b"unknown")))
    frame = read_recording(tmp_path / "bag", ROBOT, SOCCER).of("goToPose")
    assert frame[frame["t"] == 0.0]["duration"].to_numpy() == pytest.approx(durations, abs=0.06)


@pytest.mark.parametrize("jump", [-2.0, 1e9])
def test_the_robots_clock_may_jump_between_drives(tmp_path: Path, jump: float) -> None:
    durations = record(tmp_path / "bag", jump=jump)
    frame = read_recording(tmp_path / "bag", ROBOT, SOCCER).frame
    assert frame.groupby("episode")["duration"].first().max() < max(durations) + 0.1


def test_commands_that_cease_without_a_stop_are_no_drive() -> None:
    moving = [(tick / 10.0, 0.5, 0.0) for tick in range(20)]
    later = [(12.0 + time, v, w) for time, v, w in moving]
    stop, rest = (14.0, 0.0, 0.0), (14.5, 0.0, 0.0)
    ceased = np.array([*moving, *later, stop, rest])
    assert list(_spans(ceased, lambda since, until: (since, until) == (1.9, 12.0))) == [(12.0, 14.0)]
    assert list(_spans(ceased, lambda *_: False)) == [(0.0, 14.0)]  # it drove on all the time
    both = np.array([*moving, (2.0, 0.0, 0.0), *later, stop, rest])
    assert list(_spans(both, lambda *_: True)) == [(0.0, 2.0), (12.0, 14.0)]


def test_a_single_file_can_be_given(tmp_path: Path) -> None:
    record(tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    assert read_recording(file, ROBOT, SOCCER).frame["episode"].nunique() == len(GOALS)


def test_a_recording_without_the_topics_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "bag", topics=("/robot/odom",))
    with pytest.raises(RecordingError, match=r"or odom \(Odometry\) and cmd_vel .*: /robot/odom; name them"):
        read_recording(tmp_path / "bag", ROBOT, SOCCER)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "drive.mcap"
    file.write_bytes(b"nothing of the kind")
    with pytest.raises(RecordingError, match=r"drive\.mcap: expected a recording"):
        read_recording(file, ROBOT, SOCCER)


def test_missing_rosbags_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(RecordingError, match="pip install rosbags"):
        read_recording(tmp_path, ROBOT, SOCCER)


def test_records_of_the_executor_are_taken_as_they_are(tmp_path: Path) -> None:
    store = own_types()
    record = action_performance(store, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=3.25, code=1)
    failed = action_performance(store, goal=Pose(2.5, 0.5, 0.7), speed=0.0, duration=9.0, code=2)
    canceled = action_performance(store, goal=Pose(2.5, 0.5, 0.7), speed=0.0, duration=1.0, code=4)
    write_records(tmp_path / "bag", store, [record, failed, canceled])
    frame = read_recording(tmp_path / "bag", ROBOT, SOCCER).of("goToPose")
    assert frame["duration"].tolist() == [3.25, 9.0]
    assert frame["success"].tolist() == [True, False]
    assert frame[["x", "y", "v", "xg", "yg", "speedg", "hold"]].iloc[0].tolist() == [
        -1,
        0.25,
        0.1,
        1.5,
        0.5,
        0.3,
        1,
    ]
    assert frame["yawg"].iloc[0] == pytest.approx(0.7)
    assert frame["position_error"].iloc[0] == 0.01


def test_records_with_numbers_that_are_none_are_left_out(tmp_path: Path) -> None:
    store = own_types()
    good = action_performance(store, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=3.25, code=1)
    bad = [
        action_performance(store, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=np.nan, code=1),
        action_performance(store, goal=Pose(np.inf, 0.5, 0.7), speed=0.3, duration=3.0, code=1),
        action_performance(store, goal=Pose(1.5, 0.5, np.nan), speed=0.3, duration=3.0, code=2),
    ]
    for place, error, length in (
        (np.inf, 0.02, 3.0),
        (2e8, 0.02, 3.0),
        (0.0, np.inf, 3.0),
        (0.0, 0.02, -1.0),
    ):
        odd = action_performance(store, goal=Pose(1.5, 0.5, 0.7), speed=0.3, duration=length, code=1)
        odd.start.objects[0].position.x, odd.heading_error = place, error
        bad.append(odd)
    write_records(tmp_path / "bag", store, [*bad, good])
    experience = read_recording(tmp_path / "bag", ROBOT, SOCCER)
    assert experience.of("goToPose")["duration"].tolist() == [3.25]
    assert experience.metadata["records_left_out"] == len(bad)


def test_records_that_no_executor_makes_are_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = own_types()
    usual = {"goal": Pose(1.5, 0.5, 0.7), "speed": 0.0, "code": 1}
    good = [
        action_performance(store, **usual, duration=2.0 + 0.1 * number, start=(-1.0 + 0.1 * number, 0.0))
        for number in range(25)
    ]
    failed_far = action_performance(store, **{**usual, "code": 2}, duration=3.0, start=(-90.0, 0.0))
    bad = [
        action_performance(store, **usual, duration=3.0, action="shoot", top="goToPose"),
        action_performance(store, **usual, duration=3.0, action="goToPose", top="shoot"),
        action_performance(store, **usual, duration=3.0, top="visit"),
        action_performance(store, **usual, duration=3.0, start=(-90.0, 0.0)),  # too far for 3 s
        action_performance(store, **{**usual, "code": 2}, duration=3.0, start=(0.0, 5000.0)),
        action_performance(store, **usual, duration=3.0, action="shoot", top="shoot", start=(-900.0, 0.0)),
    ]
    long = action_performance(store, **usual, duration=3.0)
    long.start.objects[0].name = "b" * 1_000
    far_ball = action_performance(store, **usual, duration=3.0)
    far_ball.start.objects[0].position.y = -4000.0
    bad += [long, far_ball]
    write_records(tmp_path / "bag", store, [*good, failed_far, *bad])
    experience = read_recording(tmp_path / "bag", ROBOT, SOCCER)
    assert experience.metadata["records_left_out"] == len(bad)
    assert len(experience.of("goToPose")) == len(good) + 1
    assert train.main([str(tmp_path / "bag"), "--models", str(tmp_path / "models")]) == 0
    said = capsys.readouterr().err
    assert f"train: left out {len(bad)} records that cannot be used" in said
    assert (
        f"train: bag: left out {len(bad)} of {len(good) + 1 + len(bad)} records: call.top: expected" in said
    )


def test_a_base_that_is_faster_than_described_keeps_its_records(tmp_path: Path) -> None:
    """Over 2.5 m and more in the time that a robot at 2.4 times the described limit takes."""
    store, limit = own_types(), ROBOT.limits.v
    records = [
        action_performance(
            store,
            goal=Pose(4.0, 0.0, 0.0),
            speed=0.0,
            code=1,
            start=(x, 0.0),
            duration=(4.0 - x) / (2.4 * limit),
        )
        for x in (-3.0, -1.0, 1.5)
    ]
    write_records(tmp_path / "bag", store, records)
    experience = read_recording(tmp_path / "bag", ROBOT, SOCCER)
    assert len(experience.of("goToPose")) == len(records)
    assert not experience.remarks


def action_performance(
    store: Any,
    *,
    goal: Pose,
    speed: float,
    duration: float,
    code: int,
    action: str = "goToPose",
    action_set: str = "default",
    top: str = "goToBall",
    start: tuple[float, float] = (-1.0, 0.25),
) -> Any:
    """Return the record of a goToBall, or of another TOP."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](0, 0)
    header = types["std_msgs/msg/Header"](stamp, "odom")
    point, vector = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Vector3"]

    def pose(where: Pose) -> Any:
        turn = types["geometry_msgs/msg/Quaternion"](*quaternion_from_yaw(where.yaw))
        return types["geometry_msgs/msg/Pose"](point(where.x, where.y, 0.0), turn)

    ball = types["ator_interfaces/msg/ObjectState"](
        name="ball", position=point(goal.x, goal.y, 0.0), velocity=vector(0.0, 0.0, 0.0)
    )
    situation = types["ator_interfaces/msg/Situation"](
        header=header, robot=pose(Pose(*start, 0.1)), v=0.1, w=0.0, objects=[ball]
    )
    call = types["ator_interfaces/msg/TopCall"](
        top=top, goal=types["geometry_msgs/msg/PoseStamped"](header, pose(goal)), speed=speed,
        open=[], values=[],
    )  # fmt: skip
    performance = types["ator_interfaces/msg/Performance"]
    unknown = performance(duration=np.nan, spread=np.nan, success=np.nan, accuracy=np.nan)
    actual = performance(duration=duration, spread=0.0, success=float(code == 1), accuracy=0.01)
    return types["ator_interfaces/msg/ActionPerformance"](
        header=header, chain_id="0", step=0, steps=1, action=action, action_set=action_set, call=call,
        start=situation, end=situation, predicted=unknown, actual=actual, heading_error=0.02,
        outcome=types["ator_interfaces/msg/Outcome"](code=code, reason="so it went"),
    )  # fmt: skip


def write_records(folder: Path, store: Any, records: list[Any]) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    kind = "ator_interfaces/msg/ActionPerformance"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        link = writer.add_connection("/performance/action", kind, typestore=store)
        for number, record in enumerate(records):
            writer.write(link, 1_000_000_000 * number, store.serialize_cdr(record, kind))
