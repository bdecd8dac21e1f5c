"""The node `goal_pose`: drives to the poses of a topic, as of RViz's tool 2D Goal Pose."""

from __future__ import annotations

from functools import partial

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.task import Future

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome, TopChain
from ator_ros.geometry import Pose
from ator_ros.nodes.chain_client import ChainClient
from ator_ros.nodes.main_loop import run_node
from ator_ros.nodes.messages import call_of
from ator_ros.nodes.parameters import (
    DOMAIN,
    ROBOT,
    declare_parameters,
    domain_and_robot,
    driving_top,
)
from ator_ros.nodes.qos import RESULTS
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
        self._chains = ChainClient(self)
        self.create_subscription(PoseStamped, "goal_pose", self._take, RESULTS)
        self.get_logger().info(
            f"poses on goal_pose become goals of {top.name} (domain {domain.name})"
        )

    def _take(self, pose: PoseStamped) -> None:
        self._call.goal = pose  # the executor checks it
        goal = ExecuteChain.Goal(chain=TopChain(calls=[self._call]))
        self._chains.send(goal).result.add_done_callback(self._report)

    def _report(self, result: Future) -> None:
        outcome = result.result().outcome
        # Two call sites: rclpy raises if one call site changes its severity.
        if outcome.code == Outcome.SUCCEEDED:
            self.get_logger().info(outcome.reason)
        else:
            self.get_logger().warning(outcome.reason)


main = partial(run_node, GoalPoseNode, PARAMETERS)
