"""Recordings made for tests: their types, drives, and records of the executor."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from turning_action import TurnDriveTurn

from ator_ros.actions.base import Goal, Point, Status
from ator_ros.geometry import Pose, quaternion_from_yaw
from ator_ros.resources import share_folder
from ator_ros.robot.description import load_robot
from ator_ros.simulation.simulation import Simulation
from ator_ros.world.state import STOP, Command, World

ROBOT = load_robot()
GOALS = (Pose(1.0, 0.5, 1.0), Pose(-0.5, 0.5, 3.0))


def record(
    folder: Path,
    *,
    topics: tuple[str, ...] = ("/robot/odom", "/robot/cmd_vel"),
    jump: float = 0.0,
) -> list[float]:
    """Record two drives with pauses as the nodes would, and give their durations in s.

    The robot's clock jumps by `jump` s between them.
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


def own_types() -> Any:
    """Return a store of types with our interfaces, read from their files."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for file in sorted(share_folder().glob("ator_interfaces/msg/*.msg")):
        types |= get_types_from_msg(file.read_text(), f"ator_interfaces/msg/{file.stem}")
    store.register(types)
    return store
