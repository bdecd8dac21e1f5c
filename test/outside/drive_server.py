"""An action server of somebody else's, which knows nothing of subgoals: it turns, drives and turns again.

It is written as such servers are: the callback of a goal waits in a thread of its own, tolerances are its
own, and it says that it has succeeded when it is satisfied. Its goals are the first step of a chain, for want
of another action type in the wheels of ROS.
"""

from __future__ import annotations

import math
import threading
from typing import Any

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain

_FAST, _TURN = 0.6, 1.2
_NEAR, _ALIGNED, _STILL = 0.08, 0.06, 0.03


class DriveServer(Node):
    """Drives one goal at a time, by odometry; it publishes velocities only while it does."""

    def __init__(self, context: Context) -> None:
        super().__init__("drive_server", context=context)
        self._goal: Any = None
        self._phase = 0
        self._done = threading.Event()
        self.driven: list[tuple[float, float]] = []
        group = ReentrantCallbackGroup()
        self._commands = self.create_publisher(Twist, "cmd_vel", 1)
        self.create_subscription(Odometry, "odom", self._control, 10, callback_group=group)
        self._server = ActionServer(
            self,
            ExecuteChain,
            "drive",
            self._execute,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=group,
        )

    def _execute(self, handle: Any) -> ExecuteChain.Result:
        self._done.clear()
        self._phase, self._goal = 0, handle.request.chain.calls[0].goal.pose
        while not self._done.wait(0.02) and not handle.is_cancel_requested:
            pass
        self._goal = None
        self._send(0.0, 0.0)
        result = ExecuteChain.Result()
        if self._done.is_set():
            result.outcome.code = 1
            handle.succeed()
        else:
            handle.canceled()
        return result

    def _control(self, odometry: Odometry) -> None:
        goal = self._goal
        if goal is None:
            return
        pose, twist = odometry.pose.pose, odometry.twist.twist
        x, y = goal.position.x - pose.position.x, goal.position.y - pose.position.y
        left, heading = math.hypot(x, y), _yaw(pose.orientation)
        ahead, final = _wrapped(math.atan2(y, x) - heading), _wrapped(_yaw(goal.orientation) - heading)
        still = abs(twist.linear.x) < _STILL and abs(twist.angular.z) < _STILL
        if self._phase == 0:
            self._phase = 1 if left < _NEAR or (abs(ahead) < _ALIGNED and still) else 0
            self._send(0.0, _turning(ahead))
        elif self._phase == 1:
            self._phase = 2 if left < _NEAR and still else 1
            self._send(min(_FAST, left) if left >= _NEAR else 0.0, _turning(ahead) if left > 0.2 else 0.0)
        elif abs(final) < _ALIGNED and still:
            self.driven.append((pose.position.x, pose.position.y))
            self._done.set()
        else:
            self._send(0.0, _turning(final))

    def _send(self, v: float, w: float) -> None:
        twist = Twist()
        twist.linear.x, twist.angular.z = v, w
        self._commands.publish(twist)


def _turning(angle: float) -> float:
    return max(-_TURN, min(_TURN, 2.0 * angle)) if abs(angle) >= _ALIGNED / 2.0 else 0.0


def _wrapped(angle: float) -> float:
    return math.atan2(math.sin(angle), math.cos(angle))


def _yaw(q: Any) -> float:
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))


class Running:
    """The server, at work in this process until it is closed."""

    def __init__(self, domain: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain)
        self.node = DriveServer(self._context)
        self._executor = MultiThreadedExecutor(num_threads=3, context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._thread.join(timeout=10.0)
        for waitable in list(self.node.waitables):
            getattr(waitable, "destroy", bool)()
        self.node.destroy_node()
        self._context.try_shutdown()
