#!/usr/bin/env python3
"""An action server that drives to a pose: one command for each odometry message.

Its habit: it leaves a station with a slow turn, because people stand around it. At its goal it
turns three times as fast.
"""

import contextlib
import math
from typing import Any

import rclpy
from geometry_msgs.msg import Quaternion, Twist
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.task import Future
from shuttle.action import Go

LEAVING_TURN, ARRIVED_TURN = 0.5, 1.5  # rad/s at most


def yaw_of(turn: Quaternion) -> float:
    """Return the heading of a quaternion in rad."""
    return 2.0 * math.atan2(turn.z, turn.w)


class Shuttle(Node):
    """Drives to one pose at a time."""

    def __init__(self) -> None:
        super().__init__("shuttle")
        self.goal: ServerGoalHandle | None = None
        self.near, self.ended = False, Future()
        self.commands = self.create_publisher(Twist, "cmd_vel", 1)
        self.create_subscription(Odometry, "odom", self.steer, 1)
        self.server = ActionServer(
            self, Go, "go", self.execute, cancel_callback=lambda _: CancelResponse.ACCEPT
        )

    async def execute(self, goal: ServerGoalHandle) -> Any:
        """Wait until `steer` has ended the drive; return the result."""
        if self.goal is not None:  # a newer goal ends the one before
            self.ended.set_result(False)
        self.near, self.ended = False, Future()
        self.goal = goal
        alone = await self.ended
        if goal.is_cancel_requested:
            goal.canceled()
            return Go.Result(text="canceled")
        if not alone:
            goal.abort()
            return Go.Result(text="a newer goal took over")
        goal.succeed()
        return Go.Result(arrived=True)

    def steer(self, odom: Odometry) -> None:
        """Send the command for an odometry message."""
        if self.goal is None:
            return
        here, target = odom.pose.pose, self.goal.request.target.pose
        dx, dy = target.position.x - here.position.x, target.position.y - here.position.y
        distance = math.hypot(dx, dy)
        self.near = self.near or distance < 0.1
        aim = yaw_of(target.orientation) if self.near else math.atan2(dy, dx)
        off = math.remainder(aim - yaw_of(here.orientation), math.tau)
        command = Twist()
        if self.goal.is_cancel_requested or (self.near and abs(off) < 0.05):
            self.goal = None
            self.ended.set_result(True)
        else:
            fastest = ARRIVED_TURN if self.near else LEAVING_TURN
            command.angular.z = max(-fastest, min(fastest, 2.0 * off))
            command.linear.x = (
                min(0.6, max(0.1, distance)) if abs(off) < 0.3 and not self.near else 0.0
            )
        self.commands.publish(command)


def main() -> None:
    """Run the server until it is stopped."""
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Shuttle())


if __name__ == "__main__":
    main()
