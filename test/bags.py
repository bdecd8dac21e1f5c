"""Recordings made for tests: their types, drives, and records of the executor."""

import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ator_ros.bases.description import load_robot
from ator_ros.geometry import Pose, quaternion_from_yaw, wrap_angle
from ator_ros.resources import share_folder

ROBOT = load_robot()
ODOMETRY, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/Twist"


class Tick(NamedTuple):
    """A state of the robot, and its stamp; the command that follows is its velocity."""

    time: float
    pose: Pose
    v: float
    w: float


class Messages:
    """Makes messages for a recording.

    `offset` (s) is added to all stamps, `place` (m) to all positions.
    """

    def __init__(self, offset: float = 0.0, place: tuple[float, float] = (0.0, 0.0)) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.types = self.store.types
        self.offset, self.place = offset, place

    def header(self, time: float, frame: str) -> Any:
        nanoseconds = round((time + self.offset) * 1e9)
        stamp = self.types["builtin_interfaces/msg/Time"](nanoseconds // 10**9, nanoseconds % 10**9)
        return self.types["std_msgs/msg/Header"](stamp, frame)

    def pose(self, x: float, y: float, turn: tuple[float, float] = (0.0, 1.0)) -> Any:
        point = self.types["geometry_msgs/msg/Point"](x + self.place[0], y + self.place[1], 0.0)
        return self.types["geometry_msgs/msg/Pose"](
            point, self.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, *turn)
        )

    def twist(self, vx: float, vy: float, w: float) -> Any:
        vector = self.types["geometry_msgs/msg/Vector3"]
        return self.types[TWIST](vector(vx, vy, 0.0), vector(0.0, 0.0, w))

    def command(self, tick: Tick) -> Any:
        return self.twist(tick.v, 0.0, tick.w)

    def odometry(
        self,
        tick: Tick,
        *,
        length: float = 1.0,
        in_world: bool = False,
        frame: str = "odom",
        slip: float = 1.0,
    ) -> Any:
        half, v = tick.pose.yaw / 2.0, slip * tick.v
        turn = length * math.sin(half), length * math.cos(half)
        cosine, sine = (
            (math.cos(tick.pose.yaw), math.sin(tick.pose.yaw)) if in_world else (1.0, 0.0)
        )
        zeros = np.zeros(36)
        return self.types[ODOMETRY](
            self.header(tick.time, frame),
            frame if in_world else "base_footprint",
            self.types["geometry_msgs/msg/PoseWithCovariance"](
                self.pose(tick.pose.x, tick.pose.y, turn), zeros
            ),
            self.types["geometry_msgs/msg/TwistWithCovariance"](
                self.twist(v * cosine, v * sine, tick.w), zeros
            ),
        )

    def stamped(self, time: float, x: float, y: float) -> Any:
        return self.types["geometry_msgs/msg/PoseStamped"](
            self.header(time, "odom"), self.pose(x, y)
        )

    def transforms(self, time: float, *links: tuple[str, str, Pose]) -> Any:
        """Return a message for /tf; `links` are frame, child frame, and pose of the child."""
        vector, quaternion = (
            self.types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Quaternion")
        )
        stamped = [
            self.types["geometry_msgs/msg/TransformStamped"](
                self.header(time, frame),
                child,
                self.types["geometry_msgs/msg/Transform"](
                    vector(pose.x, pose.y, 0.0), quaternion(*quaternion_from_yaw(pose.yaw))
                ),
            )
            for frame, child, pose in links
        ]
        return self.types["tf2_msgs/msg/TFMessage"](stamped)


Extra = tuple[str, str, Callable[[Messages, Tick], Any]]
TICK = 0.04
HEADINGS = (0.6, -1.1, 2.0, -2.8, 1.4)
"""Headings to which the robot turns before each drive."""


def drives(jump: float = 0.0) -> list[list[Tick]]:
    """Return ticks of drives: turn, drive and stop for each heading, without a lag.

    The robot's clock jumps by `jump` s after the first drive.
    """
    time, pose, made = 0.0, Pose(0.3, -0.2, 0.1), list[list[Tick]]()
    for heading in HEADINGS:
        turn = wrap_angle(heading - pose.yaw)
        count = math.ceil(abs(turn) / (0.8 * TICK))
        made.append([])
        for v, w, number in ((0.0, turn / count / TICK, count), (0.4, 0.0, 40), (0.0, 0.0, 30)):
            for _ in range(number):
                made[-1].append(Tick(time, pose, v, w))
                half = pose.yaw + 0.5 * w * TICK
                x, y = pose.x + v * TICK * math.cos(half), pose.y + v * TICK * math.sin(half)
                pose, time = Pose(x, y, wrap_angle(pose.yaw + w * TICK)), time + TICK
        time += jump * (len(made) == 1)
    return made


def write_bag(
    bag: Path,
    make: Messages,
    ticks: Sequence[Tick],
    *topics: Extra,
    storage: str = "MCAP",
    compressed: str = "NONE",
) -> Path:
    """Write a recording.

    `topics` are name, type, and factory of the messages, at most one for each tick. `compressed` is
    what is compressed with zstd: MESSAGE, FILE or NONE.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    opened = Writer(bag, version=9, storage_plugin=StoragePlugin[storage])
    opened.set_compression(CompressionMode[compressed], CompressionFormat.ZSTD)
    with opened as writer:
        links = [
            writer.add_connection(topic, kind, typestore=make.store) for topic, kind, _ in topics
        ]
        for number, tick in enumerate(ticks):
            for link, (_, kind, factory) in zip(links, topics, strict=True):
                if (message := factory(make, tick)) is not None:
                    writer.write(link, 1000 * number, make.store.serialize_cdr(message, kind))
    return bag


def recorded(
    folder: Path,
    *extra: Extra,
    odom: str = "/odom",
    cmd_vel: str = "/cmd_vel",
    offset: float = 0.0,
    place: tuple[float, float] = (0.0, 0.0),
    jump: float = 0.0,
    **odometry: Any,
) -> Path:
    """Write a recording of odometry and commands of drives, and of `extra` topics."""
    states: Extra = (odom, ODOMETRY, lambda make, tick: make.odometry(tick, **odometry))
    commands: Extra = (cmd_vel, TWIST, Messages.command)
    ticks = list(chain.from_iterable(drives(jump)))
    return write_bag(folder / "bag", Messages(offset, place), ticks, *extra, states, commands)


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
    situation_type = types["ator_interfaces/msg/Situation"]
    names = [field.name for field in dataclasses.fields(situation_type)]
    moving = {"vx": 0.1, "vy": 0.0} if "vx" in names else {"v": 0.1}
    situation = situation_type(
        header=header, robot=pose(Pose(*start, 0.1)), **moving, w=0.0, objects=[ball]
    )
    call = types["ator_interfaces/msg/TopCall"](
        top=top, goal=types["geometry_msgs/msg/PoseStamped"](header, pose(goal)), speed=speed,
        passing=False, open=[], allowed=[], after=np.empty(0, np.uint32), values=[],
    )  # fmt: skip
    performance = types["ator_interfaces/msg/Performance"]
    numbers = dict.fromkeys(("duration", "spread", "bound", "success", "accuracy"), np.nan)
    unknown = performance(**numbers)
    actual = performance(
        duration=duration, spread=0.0, bound=duration, success=float(code == 1), accuracy=0.01
    )
    return types["ator_interfaces/msg/ActionPerformance"](
        header=header, chain_id="0", step=0, steps=1, action=action, action_set=action_set,
        call=call,
        start=situation, end=situation, predicted=unknown, actual=actual,
        stopped=True, first_turn=0.4, last_turn=0.6, driven=1.5, heading_error=0.02,
        outcome=types["ator_interfaces/msg/Outcome"](code=code, reason="so it went"),
    )  # fmt: skip


def write_records(folder: Path, store: Any, records: list[Any], storage: str = "MCAP") -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    kind = "ator_interfaces/msg/ActionPerformance"
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        link = writer.add_connection("/performance/action", kind, typestore=store)
        for number, record in enumerate(records):
            writer.write(link, 1_000_000_000 * number, store.serialize_cdr(record, kind))


def own_types(*, former_velocity: bool = False) -> Any:
    """Return a store of types with our interfaces, read from their files.

    With `former_velocity`, a Situation has the forward velocity `v`, as in version 0.2.
    """
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for file in sorted(share_folder().glob("ator_interfaces/msg/*.msg")):
        text = file.read_text()
        if former_velocity and file.stem == "Situation":
            text = re.sub(r"^float64 vy.*\n", "", text, flags=re.MULTILINE)
            text = re.sub(r"^float64 vx", "float64 v", text, flags=re.MULTILINE)
        types |= get_types_from_msg(text, f"ator_interfaces/msg/{file.stem}")
    store.register(types)
    return store
