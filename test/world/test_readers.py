"""Odometry, objects and transforms read by their fields: checks, repairs and reports."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from ator_ros.geometry import Pose, quaternion_from_yaw, wrap_angle
from ator_ros.schema import SchemaError
from ator_ros.world import readers
from ator_ros.world.readers import (
    FrameError,
    MessageError,
    ObjectReader,
    ObjectSource,
    OdometryReader,
    SendersError,
    goal_pose_from,
)
from ator_ros.world.robot_velocity import RobotVelocity
from ator_ros.world.state import Command, ObjectState, RobotState, World
from ator_ros.world.transforms import Placement, Transforms

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


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_turn_rate_in_degrees_beyond_the_bound_is_that_of_the_poses(sign: float) -> None:
    """A base that speeds up to 2.4 rad/s, which are 138 degrees per second."""
    reader = OdometryReader("odom")
    yaw = 0.0
    for step in range(40):
        w = sign * min(2.4, 4.0 * 0.04 * step)
        yaw += 0.04 * w
        message = odometry(Pose(1.0, 2.0, yaw), vector(), math.degrees(w), time=0.04 * step)
        _, robot = reader.read(message)
    assert robot.w == pytest.approx(sign * 2.4, abs=0.05)
    with pytest.raises(MessageError, match=r"angular\.z: expected a finite number"):
        reader.read(odometry(Pose(1.0, 2.0, yaw), vector(), math.nan, time=1.6))


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
        ("v", 1e6, r"odom\.twist\.twist\.linear\.x: expected a finite number from -1\d+ to 1\d+"),
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
        {"scale": 2.0},
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


@pytest.mark.parametrize(
    ("axis", "factor", "unit"),
    [
        ("v", 1000.0, "mm/s: publish m/s"),
        ("v", 100.0, "cm/s: publish m/s"),
        ("v", 3.6, "km/h: publish m/s"),
        ("w", math.degrees(1.0), "degrees/s: publish rad/s"),
        ("w", 1000.0, "mrad/s: publish rad/s"),
    ],
)
def test_a_twist_in_another_unit_is_replaced_and_named(axis: str, factor: float, unit: str) -> None:
    reader, pose, time, found = OdometryReader("odom", limits=(1.2, 2.0)), FAR, 0.0, set[str]()
    for tick in range(200):
        v = min(0.5 * time, 0.8)  # it begins with 5 mm/s
        w = min(0.6 * time, 0.9)
        linear, angular = (factor * v, w) if axis == "v" else (v, factor * w)
        _, robot = reader.read(odometry(pose, vector(linear), angular, time=time))
        # plausible velocities are used until the poses have contradicted them
        assert robot.vx <= (1.8 if tick < 60 else v + 0.05)
        assert robot.w <= (3.0 if tick < 60 else w + 0.05)
        found |= {reader.remark} - {""}
        pose = pose.compose(Pose(0.01 * v, 0.0, 0.01 * w))
        time += 0.01
    (line,) = found
    assert line.endswith(f"it looks like {unit}")


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


# Numbers, names and sequences


@pytest.mark.parametrize("value", [-1.0, 2.5, 0])
def test_a_number_within_its_bounds_is_returned_as_a_float(value: float) -> None:
    found = readers.number(value, "here", low=-1.0, high=2.5)
    assert found == value
    assert type(found) is float


@pytest.mark.parametrize("value", [-1.01, 2.51, math.nan, math.inf, -math.inf])
def test_a_number_beyond_its_bounds_is_refused(value: float) -> None:
    text = "here: expected a finite number from -1 to 2.5 m, got "
    with pytest.raises(MessageError, match=text):
        readers.number(value, "here", low=-1.0, high=2.5, unit="m")


@pytest.mark.parametrize(
    ("value", "has_hint"),
    [(math.nan, True), (5e-324, True), (math.inf, False), (2.0, False)],
)
def test_a_number_as_python_clients_send_whole_ones_has_a_hint(
    value: float, has_hint: bool
) -> None:
    with pytest.raises(MessageError) as error:
        readers.number(value, "x", low=-1.0, high=1.0)
    assert ("must assign 2.0" in str(error.value)) == has_hint


def test_positions_and_velocities_have_physical_bounds() -> None:
    assert readers.position(-1e8, "x") == -1e8
    assert readers.velocity(100.0, "v") == 100.0
    with pytest.raises(MessageError, match="to 100000000 m, got"):
        readers.position(1.1e8, "x")
    with pytest.raises(MessageError, match="-100 to 100 rad/s, got"):
        readers.velocity(-101.0, "w", "rad/s")


def test_names_are_those_that_are_allowed_each_once() -> None:
    assert readers.name("cup", "here", allowed=["ball", "cup"]) == "cup"
    with pytest.raises(MessageError, match=r"here: expected one of \['ball', 'cup'\], got 'hat'"):
        readers.name("hat", "here", allowed=["cup", "ball"])
    assert readers.names(["cup"], "here", allowed=["ball", "cup"]) == {"cup"}
    for wrong in (["cup", "cup"], ["hat"]):
        with pytest.raises(MessageError, match=r"here: expected names of .* each once, got"):
            readers.names(wrong, "here", allowed=["cup", "ball"])


@pytest.mark.parametrize(("count", "is_right"), [(1, False), (2, True), (4, True), (5, False)])
def test_items_are_counted(count: int, is_right: bool) -> None:
    if is_right:
        readers.count([0] * count, "here", least=2, most=4)
    else:
        with pytest.raises(MessageError, match=f"here: expected 2 to 4 items, got {count}"):
            readers.count([0] * count, "here", least=2, most=4)
    with pytest.raises(MessageError, match=f"here: expected 9 items, got {count}"):
        readers.count([0] * count, "here", least=9, most=9)


@pytest.mark.parametrize(("sec", "nanosec"), [(-1, 0), (0, 10**9), (0, -1)])
def test_a_stamp_is_a_time_since_zero(sec: int, nanosec: int) -> None:
    with pytest.raises(MessageError, match="stamp: expected a time since 0 s"):
        readers.seconds_from(SimpleNamespace(sec=sec, nanosec=nanosec), "stamp")
    whole = SimpleNamespace(sec=3, nanosec=999_999_999)
    assert readers.seconds_from(whole) == pytest.approx(3.999999999, abs=1e-9)
    assert readers.seconds_from(SimpleNamespace(sec=0, nanosec=0)) == 0.0


def test_any_frame_will_do_where_none_is_expected() -> None:
    readers.expect_frame("map", "here", expected="")
    readers.expect_frame("", "here", expected="map")
    readers.expect_frame("/map", "here", expected="map")
    with pytest.raises(FrameError, match="here: expected the frame 'map', got 'odom'") as error:
        readers.expect_frame("odom", "here", expected="map")
    assert error.value.got == "odom"


@pytest.mark.parametrize(
    ("degrees", "is_right"), [(29.0, True), (-29.0, True), (31.0, False), (-31.0, False)]
)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_robot_tilts_by_at_most_thirty_degrees(degrees: float, axis: int, is_right: bool) -> None:
    half = math.radians(degrees) / 2.0
    parts = [0.0, 0.0, 0.0, math.cos(half)]
    parts[axis] = math.sin(half)
    pose = SimpleNamespace(position=vector(), orientation=quaternion(*parts))
    if is_right:
        assert readers.pose_from(pose, "here").yaw == pytest.approx(0.0)
    else:
        with pytest.raises(MessageError, match="at most 30 degrees"):
            readers.pose_from(pose, "here")


@pytest.mark.parametrize(("length", "is_right"), [(1.99, True), (2.01, False)])
def test_the_quaternion_of_a_goal_has_at_most_twice_its_length(
    length: float, is_right: bool
) -> None:
    pose = SimpleNamespace(position=vector(1.0, 2.0), orientation=turned(1.2, length))
    if is_right:
        assert goal_pose_from(pose, "goal") == pytest.approx(Pose(1.0, 2.0, 1.2))
    else:
        with pytest.raises(MessageError, match=r"got the length 2.01"):
            goal_pose_from(pose, "goal")


# Commands, transforms and situations


def twist(**parts: float) -> Any:
    linear = vector(parts.get("x", 0.0), parts.get("y", 0.0), parts.get("z", 0.0))
    angular = vector(parts.get("roll", 0.0), parts.get("pitch", 0.0), parts.get("w", 0.0))
    return SimpleNamespace(linear=linear, angular=angular)


def test_a_command_is_in_the_plane() -> None:
    given = twist(x=0.5, y=0.2, w=-1.0)
    assert readers.command_from(given, "cmd") == Command(0.5, -1.0, vy=0.2)
    stamped = SimpleNamespace(twist=twist(x=0.5, w=-1.0, z=9e-4))
    assert readers.command_from(stamped, "cmd") == Command(0.5, -1.0)
    for name in ("z", "roll", "pitch"):
        for value in (2e-3, -2e-3):
            with pytest.raises(MessageError, match=r"cmd: linear\.z.*expected 0"):
                readers.command_from(twist(x=0.5, **{name: value}), "cmd")
    for name, place in (("x", r"linear\.x"), ("y", r"linear\.y"), ("w", r"angular\.z")):
        for value in (101.0, math.nan):
            with pytest.raises(MessageError, match=rf"cmd\.{place}"):
                readers.command_from(twist(**{name: value}), "cmd")


def transform(frame: str, child: str, yaw: float = 0.5) -> Any:
    return SimpleNamespace(
        header=header(0.5, frame),
        child_frame_id=child,
        transform=SimpleNamespace(translation=vector(1.0, 2.0, 3.0), rotation=turned(yaw, 2.0)),
    )


def test_a_transform_is_read_with_its_frames() -> None:
    frame, child, time, placement = readers.transform_from(transform("/odom", "/base_link"))
    assert (frame, child, time) == ("odom", "base_link", EPOCH + 0.5)
    assert placement.origin == (1.0, 2.0, 3.0)
    assert placement.turn == pytest.approx(quaternion_from_yaw(0.5))
    for frame, child in (("odom", "odom"), ("", "odom"), ("odom", "/"), ("/odom", "odom")):
        with pytest.raises(MessageError, match="tf: expected two frames, got"):
            readers.transform_from(transform(frame, child))


def placement(x: float, y: float, yaw: float = 0.0) -> Placement:
    return Placement((x, y, 0.3), quaternion_from_yaw(yaw))


def test_a_robot_in_tf_has_the_velocity_of_its_poses_in_odometry() -> None:
    plain, corrected = RobotVelocity(2.0, 2.0), RobotVelocity(2.0, 2.0)
    for tick in range(20):
        time, here = 0.05 * tick, placement(0.04 * tick, 1.0)
        found = readers.robot_from_placement(plain, time, here)
        jumping = placement(5.0 + 0.04 * tick + 0.02 * (tick % 2), -1.0)
        moved = readers.robot_from_placement(corrected, time, jumping, (time, here))
    assert found[0] == time
    assert found[1].pose == pytest.approx(Pose(0.76, 1.0, 0.0))
    assert (found[1].vx, found[1].w) == pytest.approx((0.8, 0.0))
    assert moved[1].pose == pytest.approx(Pose(5.78, -1.0, 0.0))
    assert (moved[1].vx, moved[1].w) == pytest.approx((0.8, 0.0))


def test_an_object_in_tf_or_as_a_pose_has_the_velocity_of_its_positions() -> None:
    in_tf = ObjectReader(ObjectSource("cup", type="tf"))
    stamped = ObjectReader(ObjectSource("cup", type="PoseStamped"), "map")
    covered = ObjectReader(ObjectSource("cup", type="PoseWithCovarianceStamped"), "map")
    for tick in range(10):
        time = 0.05 * tick
        pose = SimpleNamespace(position=vector(1.0, 0.02 * tick), orientation=None)
        wrapped = SimpleNamespace(pose=pose)
        found = [
            in_tf.read_placement(EPOCH + time, placement(1.0, 0.02 * tick)),
            stamped.read(SimpleNamespace(header=header(time, "map"), pose=pose)),
            covered.read(SimpleNamespace(header=header(time, "map"), pose=wrapped)),
        ]
    for stamp, state in found:
        assert stamp == pytest.approx(EPOCH + 0.45)
        assert (state.x, state.y) == pytest.approx((1.0, 0.18))
        assert (state.vx, state.vy) == pytest.approx((0.0, 0.4), abs=1e-3)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_a_twist_in_the_frame_of_the_pose_is_rotated(yaw: float) -> None:
    given = Pose(1.0, 2.0, yaw)
    linear = vector(0.5 * math.cos(yaw), 0.5 * math.sin(yaw))
    for child in ("odom", "/odom"):
        _, robot = OdometryReader("odom").read(odometry(given, linear, child=child))
        assert robot.vx == pytest.approx(0.5)
    _, robot = OdometryReader("odom").read(odometry(given, vector(0.5, 9.0), child=""))
    assert robot.vx == pytest.approx(0.5)


def test_the_frame_of_the_first_message_is_expected_of_all() -> None:
    reader = OdometryReader()
    reader.read(odometry(FAR, vector(), frame="/odom"))
    assert reader.frame == "odom"
    with pytest.raises(FrameError):
        reader.read(odometry(FAR, vector(), time=0.05, frame="map"))


def test_a_recording_is_read_as_it_is() -> None:
    reader = OdometryReader("odom", corrects=False)
    for tick in range(60):
        _, robot = reader.read(
            odometry(Pose(0.05 * tick, 0.0, 0.0), vector(-1.0), time=0.05 * tick)
        )
        assert robot.vx == -1.0
    assert reader.remark == ""


def situation(*objects: Any, **changes: Any) -> Any:
    robot = SimpleNamespace(position=vector(1.0, 2.0), orientation=turned(0.5))
    fields = {"header": header(0.5, "odom"), "robot": robot, "vx": 0.3, "vy": 0.1, "w": -0.2}
    return SimpleNamespace(**{**fields, "objects": list(objects), **changes})


def thing(name: str, x: float = 3.0) -> Any:
    return SimpleNamespace(name=name, position=vector(x, 4.0), velocity=vector(0.5, -0.6))


def test_a_situation_is_a_world() -> None:
    objects = {"cup": ObjectState(3.0, 4.0, 0.5, -0.6), "ball": ObjectState(5.0, 4.0, 0.5, -0.6)}
    read = readers.world_from(situation(thing("cup"), thing("ball", 5.0)), frame="odom")
    assert read.robot.pose == pytest.approx(Pose(1.0, 2.0, 0.5))
    assert read == World(EPOCH + 0.5, RobotState(read.robot.pose, 0.3, -0.2, vy=0.1), objects)


def test_a_situation_of_a_former_recording_has_a_forward_velocity() -> None:
    former = situation(v=0.4)
    del former.vx, former.vy
    robot = readers.world_from(former).robot
    assert (robot.vx, robot.vy, robot.w) == (0.4, 0.0, -0.2)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (situation(thing("a cup")), r"situation\.objects\[0\]\.name: expected a name"),
        (situation(thing("cup"), thing("cup")), "expected each name once"),
        (situation(*(thing(f"cup{n}") for n in range(17))), "expected 0 to 16 items, got 17"),
        (situation(thing("cup", math.inf)), r"objects\[0\]\.position: x: expected a finite"),
        (situation(header=header(0.0, "map")), "expected the frame 'odom', got 'map'"),
        (situation(w=101.0), r"situation\.w: .* rad/s"),
    ],
)
def test_a_wrong_situation_is_refused(given: Any, text: str) -> None:
    with pytest.raises(MessageError, match=text):
        readers.world_from(given, frame="odom")


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"name": "a cup"}, "name: expected a name"),
        ({"name": "robot"}, "name: expected a name .* none of robot, hold, goal"),
        ({"name": "cup", "topic": "a topic"}, "topic: expected the name of a topic"),
        ({"name": "cup", "type": "tf", "frame": "a frame"}, "frame: expected the name of a frame"),
        ({"name": "cup", "type": "tf", "topic": "cup"}, "topic: expected none with type tf"),
        ({"name": "cup", "frame": "cup"}, "frame: expected none with type Odometry"),
    ],
)
def test_the_source_of_an_object_is_checked(fields: dict[str, Any], text: str) -> None:
    with pytest.raises(SchemaError, match=text):
        ObjectSource(**fields)


def test_the_source_of_an_object_has_a_topic_or_a_frame() -> None:
    assert ObjectSource("cup").topic_or_frame == "cup"
    assert ObjectSource("cup", topic="/a/b").topic_or_frame == "/a/b"
    assert ObjectSource("cup", type="tf", frame="/a").topic_or_frame == "a"
    assert ObjectSource("cup", type="tf").topic_or_frame == "cup"


def test_second_senders_in_tf_are_refused() -> None:
    known = Transforms()
    for tick in range(40):
        known.add("odom", "base_link", 0.025 * tick, placement(0.4 * (tick % 2), 0.0))
    with pytest.raises(SendersError, match=r"tf: 'odom' to 'base_link': .* to and fro by 0.40 m"):
        readers.check_senders(known, "odom", "base_link")
    known = Transforms()
    for tick in range(40):
        known.add("odom" if tick % 2 else "map", "base_link", 0.1 * tick, placement(0.0, 0.0))
    text = "tf: 'base_link': expected one parent, got 'map' and 'odom' in turn"
    assert readers.second_parent(known, "odom", "base_link").startswith(text)
    with pytest.raises(SendersError, match=text):
        readers.check_senders(known, "odom", "base_link")
    known = Transforms()
    known.add("odom", "base_link", 0.0, placement(0.0, 0.0))
    assert readers.second_parent(known, "odom", "base_link") == ""
    readers.check_senders(known, "odom", "base_link")
