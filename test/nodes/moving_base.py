"""An external base for tests: it follows cmd_vel of one type and publishes odometry."""

import math
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from ros_client import Client

from ator_ros.geometry import Pose
from ator_ros.nodes.messages import odometry_of
from ator_ros.nodes.qos import NEWEST, SENSOR_DATA
from ator_ros.world.state import RobotState

PERIOD = 0.05


class MovingBase:
    """Follows commands immediately.

    Starts at the origin, and moves at a `share` of the commanded speed.
    """

    def __init__(
        self,
        client: Client,
        kind: type[Any] = Twist,
        *,
        topic: str = "cmd_vel",
        odom: str = "odom",
        frame: str = "odom",
        qos: QoSProfile = SENSOR_DATA,
        share: float = 1.0,
    ) -> None:
        self.pose, self.commanded, self.received = Pose(0.0, 0.0, 0.0), Twist(), 0
        self.frame, self._share = frame, share
        self._odom = client.node.create_publisher(Odometry, odom, NEWEST)
        client.node.create_subscription(kind, topic, self._take, qos)
        self.time = 100.0
        self.timer = client.node.create_timer(PERIOD, self._step)

    def _take(self, message: Twist | TwistStamped) -> None:
        self.received += 1
        self.commanded = message.twist if isinstance(message, TwistStamped) else message

    def set_pace(self, rate: float) -> None:
        """Let time pass `rate` times as fast as real time: by stamps a tick still takes PERIOD."""
        self.timer.timer_period_ns = round(1e9 * PERIOD / rate)

    def state(self) -> RobotState:
        v, w = self._share * self.commanded.linear.x, self._share * self.commanded.angular.z
        return RobotState(self.pose, v, w)

    def _step(self) -> None:
        state = self.state()
        yaw = self.pose.yaw + 0.5 * PERIOD * state.w
        self.pose = Pose(
            self.pose.x + PERIOD * state.vx * math.cos(yaw),
            self.pose.y + PERIOD * state.vx * math.sin(yaw),
            self.pose.yaw + PERIOD * state.w,
        )
        self.time += PERIOD
        self.publish(self.state())

    def publish(self, state: RobotState) -> None:
        self._odom.publish(odometry_of(self.time, state, frame=self.frame, child="base_link"))
