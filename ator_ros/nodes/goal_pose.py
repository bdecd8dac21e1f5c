"""The node `goal_pose`: drives the robot to poses on a topic, as of RViz's tool 2D Goal Pose."""

from __future__ import annotations

from typing import Any

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import TopChain
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import call_of
from ator_ros.nodes.parameters import DOMAIN, ROBOT, declare_parameters, domain_and_robot, driving_top
from ator_ros.nodes.qos import RESULTS
from ator_ros.nodes.running import run_node
from ator_ros.tops.chain import TopCall

PARAMETERS = (DOMAIN, ROBOT)


class GoalPoseNode(Node):
    """Sends the executor a chain of one step for each pose that comes; a newer pose preempts.

    Parameters: see `PARAMETERS`.

    Subscribes to
        goal_pose (geometry_msgs/PoseStamped): where the middle of the axle shall come to rest.
    Calls
        execute_chain (ator_interfaces/ExecuteChain).
    """

    def __init__(self) -> None:
        super().__init__("goal_pose", automatically_declare_parameters_from_overrides=True)
        settings = declare_parameters(self, PARAMETERS)
        domain, robot = domain_and_robot(settings)
        library = domain.library(robot)
        top = driving_top(library)
        self._call = call_of(TopCall(top, library.goal(top, Pose(0.0, 0.0, 0.0))), frame="")
        self._chains = ActionClient(self, ExecuteChain, "execute_chain")
        self.create_subscription(PoseStamped, "goal_pose", self._take, RESULTS)
        self.get_logger().info(f"poses on goal_pose become goals of {top.name} (domain {domain.name})")

    def _take(self, message: PoseStamped) -> None:
        if not self._chains.server_is_ready():
            self.get_logger().warning("ignored: expected the action execute_chain, it is not there")
            return
        self._call.goal = message  # which the executor checks
        goal = ExecuteChain.Goal(chain=TopChain(calls=[self._call]))
        self._chains.send_goal_async(goal).add_done_callback(self._accepted)

    def _accepted(self, future: Future) -> None:
        handle: Any = future.result()
        if handle.accepted:
            handle.get_result_async().add_done_callback(self._ended)
        else:
            self.get_logger().warning("rejected: the executor accepts no goal now; see its log")

    def _ended(self, future: Future) -> None:
        answer = future.result()
        # rclpy refuses a line that logs now as information, now as a warning.
        if answer.status == GoalStatus.STATUS_SUCCEEDED:
            self.get_logger().info(answer.result.outcome.reason)
        else:
            self.get_logger().warning(answer.result.outcome.reason)


def main(args: list[str] | None = None) -> None:
    """Run the node."""
    run_node(GoalPoseNode, PARAMETERS, args)
