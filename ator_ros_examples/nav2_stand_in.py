"""Publishes what Nav2 publishes while it drives, with a simulated base: to work beside it.

    scripts/run python -m ator_ros_examples.nav2_stand_in --ros-args -p real_time_factor:=5.0

It has the actions navigate_to_pose and compute_path_to_pose, their status and feedback, plan, map,
odometry, tf and footprint, and those parameters of Nav2's nodes that the node `watch` needs. The
control law and the planner are those of `pursuit_server`, which drives as Nav2 does; the base and
the building are those of the domain `building`. It needs nav2_msgs.
"""

from __future__ import annotations

import importlib
import math
import signal
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import Point32, PolygonStamped, PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.msg import Path as PathMessage
from numpy.typing import NDArray
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from tf2_msgs.msg import TFMessage

from ator_ros.domains.domain import find_domain
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import occupancy_grid_of, odometry_of, pose_of, stamp_of
from ator_ros.nodes.nav2_setup import FOOTPRINT
from ator_ros.nodes.qos import LATCHED
from ator_ros.nodes.simulation import transform_of
from ator_ros.simulation.scene_simulation import Simulation
from ator_ros.world.state import STOP, Command
from ator_ros_examples.drive_to_server import yaw_of
from ator_ros_examples.pursuit import Pursuit
from ator_ros_examples.rotate_drive_rotate import Phase, State
from ator_ros_examples.stand_ins import navfn

_TICK = 0.05  # s, of the simulated base and the control law
_FEEDBACK_PERIOD = 0.5  # s, at 2 Hz as Nav2's
_PLAN_PERIOD = 1.0  # s; Nav2's default tree plans again every second
START = Pose(-6.0, 0.0, 0.0)
"""Where the robot begins: in the corridor."""
PARAMETERS: dict[tuple[str, str], dict[str, Any]] = {
    ("bt_navigator", ""): {
        "global_frame": "map",
        "robot_base_frame": "base_link",
        "odom_topic": "odom",
    },
    ("controller_server", ""): {
        "goal_checker_plugins": ["general_goal_checker"],
        "general_goal_checker.xy_goal_tolerance": Pursuit.tuning.xy_goal_tolerance,
        "general_goal_checker.yaw_goal_tolerance": Pursuit.tuning.yaw_goal_tolerance,
        "FollowPath.desired_linear_vel": Pursuit.tuning.desired_linear_vel,
    },
    ("local_costmap", "local_costmap"): {"footprint": "[]", "robot_radius": 0.17},
    ("velocity_smoother", ""): {
        "max_velocity": [0.75, 0.0, 1.6],
        "max_accel": [0.6, 0.0, 2.5],
        "max_decel": [-0.6, 0.0, -2.5],
    },
}
"""Parameters of Nav2's nodes, by name and namespace of the node."""


class _Drive:
    """An active goal of navigate_to_pose."""

    def __init__(self, handle: ServerGoalHandle, law: Pursuit, goal: PoseStamped) -> None:
        self.handle = handle
        self.law = law
        self.goal = goal
        self.began = math.nan  # s, as all times by the stamps
        self.planned_at = -math.inf
        self.fed_back_at = -math.inf
        self.length = 0.0  # m, of the newest path
        self.estimated = 0.0  # s
        self.ended = Future()


class Nav2StandIn(Node):
    """Serves Nav2's actions for a simulated base; a newer goal preempts the active one."""

    def __init__(self) -> None:
        super().__init__("nav2_stand_in")
        factor = self.declare_parameter("real_time_factor", 1.0).value
        actions = importlib.import_module("nav2_msgs.action")
        self._navigate_kind = actions.NavigateToPose
        self._compute_kind = actions.ComputePathToPose
        self._robot = find_domain("building").robot()
        assert self._robot.grid is not None
        self._planner = navfn(self._robot.grid, self._robot)
        self._simulation = Simulation(self._robot)
        self._simulation.place_robot(START)
        self._drive: _Drive | None = None
        self._odom = self.create_publisher(Odometry, "odom", 10)
        self._tf = self.create_publisher(TFMessage, "/tf", 100)
        fixed = self.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._plan = self.create_publisher(PathMessage, "plan", 10)
        self._footprint = self.create_publisher(PolygonStamped, FOOTPRINT, 10)
        map_publisher = self.create_publisher(OccupancyGrid, "map", LATCHED)
        map_publisher.publish(occupancy_grid_of(self._robot.grid, frame="map"))
        odom = transform_of(0.0, Pose(0.0, 0.0, 0.0), frame="map", child="odom")
        fixed.publish(TFMessage(transforms=[odom]))
        accept = {"cancel_callback": lambda _: CancelResponse.ACCEPT}
        self._servers = [
            ActionServer(self, self._navigate_kind, "navigate_to_pose", self._navigate, **accept),
            ActionServer(self, self._compute_kind, "compute_path_to_pose", self._compute, **accept),
        ]
        self.create_timer(_TICK / factor, self._tick)

    async def _navigate(self, handle: ServerGoalHandle) -> Any:
        pose = handle.request.pose.pose
        goal = (pose.position.x, pose.position.y, yaw_of(pose.orientation))
        drive = _Drive(handle, Pursuit(goal, self._planner), handle.request.pose)
        former = self._drive
        self._drive = drive
        if former is not None:
            former.ended.set_result("preempted")
        ending = await drive.ended
        result = self._navigate_kind.Result()
        if ending == "arrived":
            handle.succeed()
        elif ending == "canceled":
            handle.canceled()
        else:
            result.error_code = 9000
            handle.abort()
        return result

    async def _compute(self, handle: ServerGoalHandle) -> Any:
        request = handle.request
        ends = [
            (item.pose.position.x, item.pose.position.y) for item in (request.start, request.goal)
        ]
        if not request.use_start:
            ends[0] = self._simulation.world().robot.pose[:2]
        result = self._compute_kind.Result()
        path = self._planner(*ends)
        if path is None:
            result.error_code = result.NO_VALID_PATH
            handle.abort()
        else:
            result.path = self._path(path, request.goal.pose)
            handle.succeed()
        return result

    def _tick(self) -> None:
        world = self._simulation.world()
        drive = self._drive
        command = STOP
        if drive is not None:
            command = self._steer(drive, world.robot.vx)
        self._simulation.command(command)
        self._simulation.tick()
        world = self._simulation.world()
        now = world.time
        self._odom.publish(odometry_of(now, world.robot, frame="odom", child="base_link"))
        moved = transform_of(now, world.robot.pose, frame="odom", child="base_link")
        self._tf.publish(TFMessage(transforms=[moved]))
        self._footprint.publish(self._footprint_at(now, world.robot.pose))

    def _footprint_at(self, now: float, pose: Pose) -> PolygonStamped:
        """Return the message of the robot's outline at a pose, as a costmap publishes it."""
        robot = self._robot
        message = PolygonStamped()
        message.header.frame_id = "odom"
        message.header.stamp = stamp_of(now)
        for x in (robot.front, -robot.rear):
            for y in (robot.half_width, -robot.half_width):
                corner = pose.compose(Pose(x, y, 0.0))
                message.polygon.points.append(Point32(x=corner.x, y=corner.y))
        return message

    def _steer(self, drive: _Drive, speed: float) -> Command:
        """Return the command for a goal; publish its path and feedback."""
        world = self._simulation.world()
        now = world.time
        robot = world.robot
        drive.began = now if math.isnan(drive.began) else drive.began
        if drive.handle.is_cancel_requested:
            self._end(drive, "canceled")
            return STOP
        if now - drive.planned_at >= _PLAN_PERIOD:
            drive.planned_at = now
            position = drive.goal.pose.position
            path = self._planner(robot.pose[:2], (position.x, position.y))
            if path is not None:
                drive.length = float(np.hypot(*np.diff(path, axis=0).T).sum())
                self._plan.publish(self._path(path, drive.goal.pose))
        velocities = drive.law.step(State(now, *robot.pose, robot.vx, robot.w))
        if drive.law.phase is Phase.ARRIVED:
            self._end(drive, "arrived")
        elif drive.law.phase in (Phase.MISSED, Phase.TOO_LONG):
            self._end(drive, "failed")
        elif now - drive.fed_back_at >= _FEEDBACK_PERIOD:
            drive.fed_back_at = now
            if speed > 0.01 and drive.length > 0.01:  # as Nav2 estimates: distance by speed
                drive.estimated = drive.length / speed
            drive.handle.publish_feedback(
                self._navigate_kind.Feedback(
                    navigation_time=Duration(seconds=now - drive.began).to_msg(),
                    estimated_time_remaining=Duration(seconds=drive.estimated).to_msg(),
                    distance_remaining=drive.length,
                )
            )
        return Command(*velocities)

    def _end(self, drive: _Drive, ending: str) -> None:
        self._drive = None
        drive.ended.set_result(ending)

    def _path(self, path: NDArray[np.float64], goal: Any) -> PathMessage:
        """Return the message of a path, shape (n, 2), whose last pose is the goal."""
        message = PathMessage()
        message.header.frame_id = "map"
        message.header.stamp = stamp_of(self._simulation.time)
        for x, y in path.tolist():
            stamped = PoseStamped(header=message.header)
            stamped.pose = pose_of(Pose(x, y, 0.0))
            message.poses.append(stamped)
        message.poses[-1].pose = goal
        return message


def parameter_nodes(namespace: str) -> list[Node]:
    """Return Nav2's nodes in a namespace, as far as they have parameters."""
    nodes = []
    for (name, inner), values in PARAMETERS.items():
        place = "/".join(filter(None, (namespace.rstrip("/"), inner)))
        node = Node(name, namespace=place, use_global_arguments=False)
        for parameter, value in values.items():
            node.declare_parameter(parameter, value)
        nodes.append(node)
    return nodes


def main(args: list[str] | None = None) -> None:
    """Run the stand-in until Ctrl-C or SIGTERM."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    rclpy.init(args=args)
    stand_in = Nav2StandIn()
    nodes = [stand_in, *parameter_nodes(stand_in.get_namespace())]
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
