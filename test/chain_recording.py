"""A recording with an executed chain, written as `ros2 bag record -s mcap` would, for tests of the replay."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bag_types import own_types
from test_recordings import odometry

from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.world.state import RobotState, World

GOALS = (Pose(-0.5, 0.0, 0.0), Pose(1.0, 0.0, 0.0))
PREDICTED, ACTUAL = (2.8, 3.5), (3.0, 3.0)
BEGAN, ENDED, DURATION = 1.0, 7.0, 8.0
RECORDS = ("performance/chain", "performance/action")


def x_at(stamp: float) -> float:
    """Return where the robot is (m, y is 0) at a stamp of 0 to 8 s."""
    return 0.5 * stamp - 2.0


_types = functools.cache(own_types)


class Messages:
    """Makes messages of the types of a recording."""

    def __init__(self) -> None:
        self.store: Any = _types()
        self._types = self.store.types

    def header(self, stamp: float) -> Any:
        time = self._types["builtin_interfaces/msg/Time"](int(stamp), round(stamp % 1.0 * 1e9))
        return self._types["std_msgs/msg/Header"](time, "odom")

    def pose(self, where: Pose) -> Any:
        point = self._types["geometry_msgs/msg/Point"](where.x, where.y, 0.0)
        turn = self._types["geometry_msgs/msg/Quaternion"](*quaternion_from_yaw(where.yaw))
        return self._types["geometry_msgs/msg/Pose"](point, turn)

    def situation(self, stamp: float) -> Any:
        vector = self._types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        there = self._types["geometry_msgs/msg/Point"](1.5, 0.5, 0.0)
        ball = self._types["ator_interfaces/msg/ObjectState"]("ball", there, vector)
        robot = self.pose(Pose(x_at(stamp), 0.0, 0.0))
        return self._types["ator_interfaces/msg/Situation"](self.header(stamp), robot, 0.5, 0.0, [ball])

    def performance(self, duration: float) -> Any:
        return self._types["ator_interfaces/msg/Performance"](duration, 0.0, 1.0, np.nan)

    def call(self, top: str, goal: Pose) -> Any:
        there = self._types["geometry_msgs/msg/PoseStamped"](self.header(0.0), self.pose(goal))
        return self._types["ator_interfaces/msg/TopCall"](top, there, 0.0, [], [])

    def action(self, step: int, *, later: float = 0.0) -> Any:
        began = BEGAN + 3.0 * step
        call = self.call(("goToBall", "dribbleBall")[step], GOALS[step])
        record = self._types["ator_interfaces/msg/ActionPerformance"](
            self.header(later + began + 3.0), "chain 1", step, 2, "goToPose", "default", call,
            self.situation(began), self.situation(began + 3.0), self.performance(PREDICTED[step]),
            self.performance(ACTUAL[step]), 0.0, self.outcome(),
        )  # fmt: skip
        record.start.header, record.end.header = self.header(later + began), self.header(later + began + 3.0)
        return record

    def outcome(self) -> Any:
        return self._types["ator_interfaces/msg/Outcome"](1, "done")

    def chain(self, *, later: float = 0.0) -> Any:
        actions = [self.action(step, later=later) for step in (0, 1)]
        chain = self._types["ator_interfaces/msg/TopChain"]([one.call for one in actions], "default")
        record = self._types["ator_interfaces/msg/ChainPerformance"](
            self.header(later + ENDED), "chain 1", chain, self.situation(BEGAN), True, "gains {0.50} s", 0, 0,
            self.performance(sum(PREDICTED)), self.performance(sum(ACTUAL)), actions, self.outcome(),
        )  # fmt: skip
        record.start.header = self.header(later + BEGAN)
        return record


def write_recording(
    folder: Path,
    *,
    topics: Sequence[str] = ("odom", *RECORDS),
    robots: Sequence[str] = ("",),
    change: Callable[[Any], object] = id,
) -> Path:
    """Write 8 s of each robot's odometry, and a chain of two steps from 1 s to 7 s; return the .mcap file."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    make = Messages()
    kinds = {
        "odom": "nav_msgs/msg/Odometry",
        "performance/chain": "ator_interfaces/msg/ChainPerformance",
        "performance/action": "ator_interfaces/msg/ActionPerformance",
    }
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        links = {
            f"{robot}/{topic}": writer.add_connection(f"{robot}/{topic}", kinds[topic], typestore=make.store)
            for robot in robots
            for topic in topics
        }

        def write(topic: str, message: Any, stamp: float) -> None:
            for robot in robots:
                if topic in topics:
                    raw = make.store.serialize_cdr(message, kinds[topic])
                    writer.write(links[f"{robot}/{topic}"], int(stamp * 1e9), raw)

        for stamp in np.arange(0.0, DURATION + 0.01, 0.05).tolist():
            state = RobotState(Pose(x_at(stamp), 0.0, 0.0), 0.5, 0.0)
            write("odom", odometry(make.store, World(stamp, state)), stamp)
            if abs(stamp - ENDED) < 0.01:
                for step in (0, 1):
                    write("performance/action", make.action(step), stamp)
                record = make.chain()
                change(record)
                write("performance/chain", record, stamp)
    return next(folder.glob("*.mcap"))
