"""Odometry, objects and transforms read by their fields: checks, repairs and reports."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from ator_ros.geometry import Pose, wrap_angle
from ator_ros.world.messages import (
    FrameError,
    MessageError,
    ObjectReader,
    ObjectSource,
    OdometryReader,
    SendersError,
    goal_pose_from,
)

EPOCH = 1_764_000_000


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    return SimpleNamespace(x=x, y=y, z=z)


def quaternion(x: float, y: float, z: float, w: float) -> Any:
    return SimpleNamespace(x=x, y=y, z=z, w=w)


def turned(yaw: float, length: float = 1.0) -> Any:
    return quaternion(0.0, 0.0, length * math.sin(yaw / 2.0), length * math.cos(yaw / 2.0))


def header(time: float, frame: str) -> Any:
    nanoseconds = round(time * 1e9)
    stamp = SimpleNamespace(sec=EPOCH + nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    return SimpleNamespace(stamp=stamp, frame_id=frame)


def odometry(
    pose: Pose,
    linear: Any,
    w: float = 0.0,
    *,
    time: float = 0.0,
    frame: str = "odom",
    child: str = "base_link",
    orientation: Any = None,
) -> Any:
    planar = SimpleNamespace(
        position=vector(pose.x, pose.y), orientation=orientation or turned(pose.yaw)
    )
    twist = SimpleNamespace(linear=linear, angular=vector(z=w))
    return SimpleNamespace(
        header=header(time, frame),
        child_frame_id=child,
        pose=SimpleNamespace(pose=planar),
        twist=SimpleNamespace(twist=twist),
    )


FAR = Pose(691_608.25, 5_334_761.5, 2.0)  # UTM coordinates, in m


def test_stamps_since_1970_and_projected_coordinates_keep_their_precision() -> None:
    first, robot = OdometryReader("odom").read(odometry(FAR, vector(15.0), 0.5, time=0.02))
    second, _ = OdometryReader("odom").read(odometry(FAR, vector(15.0), time=0.04))
    assert second - first == pytest.approx(0.02, abs=1e-6)
    assert (robot.pose.x, robot.pose.y, robot.vx, robot.w) == (FAR.x, FAR.y, 15.0, 0.5)


@pytest.mark.parametrize("length", [1e-3, 1.5])
def test_a_quaternion_of_any_length_is_normalized(length: float) -> None:
    for yaw in (-3.0, -1.2, 0.0, 0.4, 1.687, 3.1):
        message = odometry(FAR._replace(yaw=0.0), vector(), orientation=turned(yaw, length))
        _, robot = OdometryReader().read(message)
        assert wrap_angle(robot.pose.yaw - yaw) == pytest.approx(0.0, abs=1e-12)


def test_the_tilt_on_a_ramp_is_valid_but_another_axis_is_not() -> None:
    ramp = quaternion(0.0, math.sin(0.1), 0.0, math.cos(0.1))  # pitched by 11 degrees
    _, robot = OdometryReader().read(odometry(FAR, vector(0.3), orientation=ramp))
    assert robot.pose.yaw == pytest.approx(0.0)
    half = math.sqrt(0.5)
    with pytest.raises(
        MessageError, match=r"orientation: expected roll and pitch of at most 30 degrees"
    ):
        OdometryReader().read(odometry(FAR, vector(), orientation=quaternion(half, 0.0, 0.0, half)))


@pytest.mark.parametrize(
    "parts", [(0.0,) * 4, (0.0, 0.0, math.nan, 1.0), (0.0, 0.0, math.inf, 1.0)]
)
def test_a_quaternion_without_orientation_is_rejected(
    parts: tuple[float, float, float, float],
) -> None:
    with pytest.raises(
        MessageError, match=r"^odom\.pose\.pose\.orientation: expected a quaternion .* got"
    ):
        OdometryReader().read(odometry(FAR, vector(), orientation=quaternion(*parts)))


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("x", math.nan, r"odom\.pose\.pose\.position\.x: expected a finite number"),
        (
            "x",
            1e12,
            r"odom\.pose\.pose\.position\.x: expected a finite number from -1\d+ to 1\d+ m",
        ),
        ("v", 1e4, r"odom\.twist\.twist\.linear\.x: expected a finite number from -100 to 100 m/s"),
        ("sec", -EPOCH - 1, r"odom\.header\.stamp: expected a time since 0 s"),
    ],
)
def test_unrealistic_numbers_are_rejected(field: str, value: Any, expected: str) -> None:
    message = odometry(FAR, vector())
    owner = {
        "x": message.pose.pose.position,
        "v": message.twist.twist.linear,
        "sec": message.header.stamp,
    }
    setattr(owner[field], "x" if field == "v" else field, value)
    with pytest.raises(MessageError, match=expected):
        OdometryReader().read(message)


@pytest.mark.parametrize("given", ["map", "/map", ""])
@pytest.mark.parametrize("expected", ["map", "/map"])
def test_a_leading_slash_of_a_frame_is_ignored(given: str, expected: str) -> None:
    reader = OdometryReader(expected)
    reader.read(odometry(FAR, vector(), frame=given))
    with pytest.raises(
        FrameError, match=r"header\.frame_id: expected the frame 'map', got 'robot1/map'"
    ):
        reader.read(odometry(FAR, vector(), frame="robot1/map"))


def remarks(
    *,
    scale: float = 1.0,
    in_world: bool = False,
    jump: float = 0.0,
    every: int = 50,
    seconds: float = 8.0,
    speed: float = 1.0,
) -> list[str]:
    """Drive arcs with a scaled or world-frame twist, or with jumping poses; return the remarks."""
    reader, pose, found = OdometryReader("odom"), FAR, list[str]()
    for tick in range(int(20 * seconds)):
        v, w = (0.5 * speed, 0.8 * speed) if tick % 60 < 40 else (0.0, 0.0)
        linear = (
            vector(v * math.cos(pose.yaw), v * math.sin(pose.yaw))
            if in_world
            else vector(scale * v)
        )
        reader.read(odometry(pose, linear, scale * w, time=0.05 * tick))
        found += [reader.remark] * bool(reader.remark)
        pose = pose.compose(Pose(0.05 * v, 0.0, 0.05 * w))
        if tick % every == every // 2:
            pose = pose._replace(x=pose.x + jump)
    return found


@pytest.mark.parametrize(
    "wrong",
    [
        {"scale": 0.0},
        {"scale": 3.6},
        {"scale": -1.0},
        {"in_world": True},
        {"scale": 0.0, "speed": 0.2},
        {"scale": 2.0, "speed": 0.2},
    ],
)
def test_a_twist_that_contradicts_the_poses_is_reported_once(wrong: dict[str, Any]) -> None:
    (line,) = remarks(**wrong)
    assert line.startswith("odom: pose and twist.")
    assert "contradict each other" in line
    assert "'base_link'" in line
    assert "\n" not in line


@pytest.mark.parametrize(
    "right",
    [
        {},
        {"scale": 0.8},
        {"scale": 1.2, "speed": 0.2},
        {"jump": 2.0},
        {"jump": 0.4},
        {"jump": 2.0, "every": 10},
    ],
)
def test_slip_and_corrected_poses_are_not_reported(right: dict[str, Any]) -> None:
    assert remarks(**right, seconds=60.0) == []


def test_the_velocity_of_an_object_is_in_the_declared_child_frame() -> None:
    reader = ObjectReader(ObjectSource("cart"), "map")
    here = Pose(3.0, 4.0, math.pi / 2.0)
    same, own = (0.5, 0.1), (-0.1, 0.5)
    for child, expected in (("", same), ("map", same), ("/map", same), ("cart", own)):
        _, there = reader.read(odometry(here, vector(0.5, 0.1), frame="/map", child=child))
        assert (there.x, there.y) == (3.0, 4.0)
        assert (there.vx, there.vy) == pytest.approx(expected)


@pytest.mark.parametrize("wrong", ["unsigned", "scaled", "none"])
def test_where_pose_and_twist_contradict_each_other_the_pose_decides(wrong: str) -> None:
    reader, pose, off = OdometryReader("odom"), FAR, []
    for tick in range(240):
        time = 0.05 * tick
        v = 0.4 * math.sin(0.8 * time)  # forward and backward
        given = {"unsigned": abs(v), "scaled": 3.6 * v, "none": 0.0}[wrong]
        _, robot = reader.read(odometry(pose, vector(given), time=time))
        off.append(abs(robot.vx - v))
        pose = pose.compose(Pose(0.05 * 0.4 * math.sin(0.8 * (time + 0.025)), 0.0, 0.0))
    confirmed = off[12:] if wrong != "unsigned" else off  # after 3 cm
    assert max(confirmed) < 0.09  # at the first change of direction
    assert sum(confirmed) / len(confirmed) < 0.02


def test_odometry_of_two_senders_is_refused() -> None:
    reader, refused = OdometryReader("odom", is_shared=lambda: True), list[str]()
    for tick in range(100):
        pose = Pose(0.005 * tick, 0.4 if tick % 2 and tick < 60 else 0.0, 0.0)
        try:
            reader.read(odometry(pose, vector(0.2), time=0.025 * tick))
        except SendersError as error:
            refused.append(str(error))
    assert all("jump to and fro by 0.40 m" in text for text in refused)
    assert 50 < len(refused) < 100  # until 1.5 s after the second sender has ended
    reader.read(odometry(Pose(0.5, 0.0, 0.0), vector(0.2), time=4.0))


def test_odometry_of_two_senders_that_differ_in_heading_only_is_refused() -> None:
    reader, refused = OdometryReader("odom", is_shared=lambda: True), list[str]()
    for tick in range(60):
        pose = Pose(0.005 * tick, 0.0, 1.0 + (0.17 if tick % 2 else 0.0))
        try:
            reader.read(odometry(pose, vector(0.2), time=0.025 * tick))
        except SendersError as error:
            refused.append(str(error))
    assert len(refused) > 40
    assert all("jump to and fro by 0.17 rad" in text for text in refused)


def test_an_object_of_two_senders_is_refused() -> None:
    is_shared = False
    reader = ObjectReader(ObjectSource("cart"), "map", is_shared=lambda: is_shared)

    def read(tick: int) -> None:
        here = Pose(3.0, 4.0 + 0.4 * (tick % 2), 0.0)
        reader.read(odometry(here, vector(), frame="map", time=0.025 * tick))

    for tick in range(40):
        read(tick)
    is_shared = True
    with pytest.raises(SendersError, match=r"cart: expected one sender, got poses that jump"):
        read(40)


def test_a_goal_in_degrees_is_refused_and_other_lengths_are_normalized() -> None:
    def pose(orientation: Any) -> Any:
        return SimpleNamespace(position=vector(1.0, 2.0), orientation=orientation)

    with pytest.raises(MessageError, match=r"goal\.orientation: .* length 1, got the length 90\.0"):
        goal_pose_from(pose(quaternion(0.0, 0.0, 90.0, 1.0)), "goal")
    for length in (0.1, 1.0, 1.9):
        assert goal_pose_from(pose(turned(1.2, length)), "goal") == pytest.approx(
            Pose(1.0, 2.0, 1.2)
        )
