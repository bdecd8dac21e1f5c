"""An action server that drives a differential base to a pose as Nav2 does, without Nav2.

It differs from `drive_to_server` in its action, `pursue`, and in its control law, which plans on a
map. If `map` has a publisher, goals are rejected until the first map was received.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.qos import DurabilityPolicy, QoSProfile

from ator_interfaces.action import DriveTo
from ator_ros.nodes.main_loop import run_node
from ator_ros_examples.drive_to_server import DriveToServer, place_of, yaw_of
from ator_ros_examples.navfn import NavFn
from ator_ros_examples.pursuit import Pursuit, PursuitThrough

_FREE = 25  # percent


class PursuitServer(DriveToServer):
    """Drives on a map, if one is published; the parameter robot_radius is in m.

    Also has the action server
        pursue_through (nav2_msgs/NavigateThroughPoses), if nav2_msgs is installed.
    Also subscribes to
        map (nav_msgs/OccupancyGrid, transient local), in the frame of odom.
    """

    def __init__(self) -> None:
        super().__init__("pursuit_server", "pursue", lambda goal: Pursuit(goal, self._planner))
        self._radius = self.declare_parameter("robot_radius", 0.17).value
        self._planner: NavFn | None = None
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(
            OccupancyGrid,
            "map",
            self._take_map,
            latched,
        )
        if importlib.util.find_spec("nav2_msgs") is not None:
            self._through_kind = importlib.import_module("nav2_msgs.action").NavigateThroughPoses
            self._through = ActionServer(
                self, self._through_kind, "pursue_through", self._execute_through,
                goal_callback=self._consider_poses,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )  # fmt: skip

    def _consider_poses(self, request: Any) -> GoalResponse:
        goals = [DriveTo.Goal(goal=pose) for pose in request.poses]
        accepted = [self._consider(goal) == GoalResponse.ACCEPT for goal in goals]
        return GoalResponse.ACCEPT if goals and all(accepted) else GoalResponse.REJECT

    async def _execute_through(self, handle: ServerGoalHandle) -> Any:
        places = [place_of(pose.pose) for pose in handle.request.poses]
        code, text = await self.driven(handle, PursuitThrough(places, self._planner))
        return self._through_kind.Result(error_code=code, error_msg=text)

    def _take_map(self, message: OccupancyGrid) -> None:
        info = message.info
        values = np.array(message.data).reshape(info.height, -1)
        free = (values >= 0) & (values <= _FREE)
        place = info.origin.position
        origin = (place.x, place.y, yaw_of(info.origin.orientation))
        self._planner = NavFn(
            free,
            info.resolution,
            origin,
            self._radius,
        )
        self.get_logger().info(f"planning on a map of {info.width} x {info.height} cells")

    def _consider(self, request: Any) -> GoalResponse:
        if self._planner is None and self.count_publishers("map"):
            return GoalResponse.REJECT
        return super()._consider(request)


def main(args: list[str] | None = None) -> None:
    """Run the server until Ctrl-C or SIGTERM."""
    run_node(PursuitServer, (), args)


if __name__ == "__main__":
    main()
