"""An action server that drives a differential base to a pose, as an example of an external server.

It imports nothing of ator_ros but its control law. It computes a command for each odometry message,
by its stamp, so that it also works in a simulation that is faster than real time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future

from ator_interfaces.action import DriveTo
from ator_ros.nodes.main_loop import run_node
from ator_ros_examples.pursuit import Law, Pursuit
from ator_ros_examples.rotate_drive_rotate import Phase, RotateDriveRotate, State

_FEEDBACK_PERIOD = 0.5
_CODES = {
    Phase.ARRIVED: DriveTo.Result.NONE,
    Phase.MISSED: DriveTo.Result.MISSED,
    Phase.TOO_LONG: DriveTo.Result.TOO_LONG,
}
LawOf = Callable[[tuple[float, float, float]], Law]


class _Drive:
    """An active goal."""

    def __init__(self, handle: ServerGoalHandle, law: Law) -> None:
        self.handle = handle
        self.law = law
        self.ended = Future()
        self.feedback_at = -math.inf  # s, by the stamps


class DriveToServer(Node):
    """Drives to one goal at a time; a newer goal preempts it.

    `law` returns the control law for a goal: x, y (m) and yaw (rad).

    Action server
        drive_to (ator_interfaces/DriveTo), or the name `action`.
    Subscribes to
        odom (nav_msgs/Odometry).
    Publishes
        cmd_vel (geometry_msgs/Twist): one for each odometry message while a goal is active.
    """

    def __init__(
        self,
        name: str = "drive_to_server",
        action: str = "drive_to",
        law: LawOf = RotateDriveRotate,
    ) -> None:
        super().__init__(name)
        self._law = law
        self._state: State | None = None
        self._frame = ""
        self._drive: _Drive | None = None
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._commands = self.create_publisher(Twist, "cmd_vel", 1)
        self.create_subscription(
            Odometry,
            "odom",
            self._take_odom,
            newest,
        )
        self._server = ActionServer(
            self, DriveTo, action, self._execute,
            goal_callback=self._consider, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def _consider(self, request: Any) -> GoalResponse:
        """Accept a pose in the frame of odometry."""
        pose = request.goal.pose
        frame = request.goal.header.frame_id
        finite = all(map(math.isfinite, place_of(pose)))
        known = not self._frame or frame in ("", self._frame)
        if finite and known:
            return GoalResponse.ACCEPT
        self.get_logger().warning(
            f"goal rejected: expected a pose in {self._frame or 'the frame of odom'}"
        )
        return GoalResponse.REJECT

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        code, text = await self.driven(handle, self._law(place_of(handle.request.goal.pose)))
        return DriveTo.Result(error_code=code, error_msg=text)

    async def driven(self, handle: ServerGoalHandle, law: Law) -> tuple[int, str]:
        """Drive by a law; return code and text of the result when odometry has ended it."""
        drive = _Drive(handle, law)
        former = self._drive
        self._drive = drive
        if former is not None:
            if isinstance(drive.law, Pursuit):
                drive.law.take_over(former.law)
            former.ended.set_result((DriveTo.Result.SUPERSEDED, "a newer goal took over"))
        self._steer()
        code, text = await drive.ended
        ends = {DriveTo.Result.NONE: handle.succeed, DriveTo.Result.CANCELED: handle.canceled}
        ends.get(code, handle.abort)()
        return code, text

    def _take_odom(self, message: Odometry) -> None:
        pose = message.pose.pose
        twist = message.twist.twist
        stamp = message.header.stamp
        self._frame = message.header.frame_id
        self._state = State(
            stamp.sec + 1e-9 * stamp.nanosec,
            pose.position.x,
            pose.position.y,
            yaw_of(pose.orientation),
            twist.linear.x,
            twist.angular.z,
        )
        self._steer()

    def _steer(self) -> None:
        """Publish the command for the newest odometry."""
        drive = self._drive
        state = self._state
        if drive is None or state is None:
            return
        command = Twist()
        phase = drive.law.phase
        if drive.handle.is_cancel_requested:
            self._end(drive, DriveTo.Result.CANCELED, "canceled")
        else:
            command.linear.x, command.angular.z = drive.law.step(state)
            phase = drive.law.phase
            if phase in _CODES:
                self._end(drive, _CODES[phase], phase.value)
        self._commands.publish(command)
        if state.time - drive.feedback_at >= _FEEDBACK_PERIOD and self._drive is not None:
            drive.feedback_at = state.time
            if isinstance(drive.handle.request, DriveTo.Goal):
                distance = drive.law.distance
                feedback = DriveTo.Feedback(distance_remaining=distance, phase=phase.value)
                drive.handle.publish_feedback(feedback)

    def _end(
        self,
        drive: _Drive,
        code: int,
        text: str,
    ) -> None:
        self._drive = None
        drive.ended.set_result((code, text))


def place_of(pose: Any) -> tuple[float, float, float]:
    """Return x, y (m) and yaw (rad) of a pose."""
    return pose.position.x, pose.position.y, yaw_of(pose.orientation)


def yaw_of(q: Any) -> float:
    """Return the yaw in rad of a quaternion."""
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))


def main(args: list[str] | None = None) -> None:
    """Run the server with its law until Ctrl-C or SIGTERM."""
    run_node(DriveToServer, (), args)


if __name__ == "__main__":
    main()
