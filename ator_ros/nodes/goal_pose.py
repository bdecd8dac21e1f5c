"""The node `goal_pose`: drives the robot to the poses of a topic, as of RViz's tool 2D Goal Pose."""

from __future__ import annotations

from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient
from rclpy.node import Node

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import TopChain
from ator_ros.geometry import Pose
from ator_ros.nodes.leases import publish_lease
from ator_ros.nodes.messages import call_of
from ator_ros.nodes.parameters import (
    DOMAIN,
    ROBOT,
    declare_parameters,
    domain_and_robot,
    driving_top,
)
from ator_ros.nodes.qos import ACTION_QUEUES, RESULTS
from ator_ros.nodes.running import run_node
from ator_ros.tops.chain import TopCall

PARAMETERS = (DOMAIN, ROBOT)


class GoalPoseNode(Node):
    """Sends the executor a chain of one step for each pose that it receives; a newer pose preempts.

    Subscribes to
        goal_pose (geometry_msgs/PoseStamped): the goal of the middle of the axle.
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
        self._chains = ActionClient(self, ExecuteChain, "execute_chain", **ACTION_QUEUES)
        self._lease = publish_lease(self)
        self.create_subscription(PoseStamped, "goal_pose", self._take, RESULTS)
        self.get_logger().info(
            f"poses on goal_pose become goals of {top.name} (domain {domain.name})"
        )

    def _take(self, pose: PoseStamped) -> None:
        executor: Any = self.executor
        executor.create_task(self._drive_to, pose)

    async def _drive_to(self, pose: PoseStamped) -> None:
        if not self._chains.server_is_ready():
            self.get_logger().warning(
                "execute_chain: expected its action server, got none; start the executor"
            )
            return
        self._call.goal = pose  # the executor checks it
        goal = ExecuteChain.Goal(chain=TopChain(calls=[self._call]), lease=self._lease)
        handle: Any = await self._chains.send_goal_async(goal)
        if not handle.accepted:
            self.get_logger().warning("execute_chain: the executor rejected the goal; see its log")
            return
        answer = await handle.get_result_async()
        # Two call sites: rclpy raises if one call site changes its severity.
        if answer.status == GoalStatus.STATUS_SUCCEEDED:
            self.get_logger().info(answer.result.outcome.reason)
        else:
            self.get_logger().warning(answer.result.outcome.reason)


main = partial(run_node, GoalPoseNode, PARAMETERS)
