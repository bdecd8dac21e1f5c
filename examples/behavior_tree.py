"""A py_trees behavior that executes a chain, and a tree that uses it.

    python3 examples/behavior_tree.py

The tree drives to two stations, with the heading at the first one left to refinement, and back
home. The nodes must run. The program needs rclpy, py_trees and ator_interfaces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import py_trees
import rclpy
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from py_trees.common import Status
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome, TopCall, TopChain
from ator_ros.nodes.leases import publish_lease

TICK_PERIOD = 0.1  # s


class ExecuteChainBehaviour(py_trees.behaviour.Behaviour):
    """Executes a chain of `calls`, refined first if `refine`.

    Cancels the goal if the tree interrupts it.
    """

    def __init__(self, name: str, calls: Sequence[TopCall], *, refine: bool = True) -> None:
        super().__init__(name)
        self._goal = ExecuteChain.Goal(chain=TopChain(calls=list(calls)), refine=refine)
        self._client: ActionClient | None = None
        self._acceptance: Any = None  # future of the goal handle
        self._result: Any = None  # future of the result

    def setup(self, **kwargs: Any) -> None:
        """Create the action client on `node`."""
        self._goal.lease = publish_lease(kwargs["node"])  # the goal ends with this program
        self._client = ActionClient(kwargs["node"], ExecuteChain, "execute_chain")

    def initialise(self) -> None:
        """Reset the goal."""
        self._acceptance = self._result = None

    def update(self) -> Status:
        """Send the goal once the executor is available; return the state of the goal."""
        assert self._client is not None, "call setup first"
        if self._acceptance is None:
            if not self._client.server_is_ready():
                self.feedback_message = "waiting for the executor"
                return Status.RUNNING
            self._acceptance = self._client.send_goal_async(
                self._goal, feedback_callback=self._take_feedback
            )
        if not self._acceptance.done():
            return Status.RUNNING
        if not self._acceptance.result().accepted:
            self.feedback_message = "the executor rejected the goal"
            return Status.FAILURE
        if self._result is None:
            self._result = self._acceptance.result().get_result_async()
        if not self._result.done():
            if self._client.server_is_ready():
                return Status.RUNNING
            self.feedback_message = "the executor has ended"
            return Status.FAILURE
        outcome = self._result.result().result.outcome
        self.feedback_message = outcome.reason
        return Status.SUCCESS if outcome.code == Outcome.SUCCEEDED else Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        """Cancel the goal if the tree interrupts the behavior."""
        if new_status is Status.INVALID and self._acceptance is not None:
            # immediately if the goal was already accepted
            self._acceptance.add_done_callback(_cancel)

    def _take_feedback(self, message: Any) -> None:
        now = message.feedback
        self.feedback_message = f"step {now.step + 1} of {now.steps}, {now.top}: {now.status}"


def _cancel(acceptance: Any) -> None:
    if acceptance.result().accepted:
        acceptance.result().cancel_goal_async()


def go_to_pose(x: float, y: float, yaw: float, open_variables: Sequence[str] = ()) -> TopCall:
    """Return a step to a pose in m and rad; refinement chooses the open variables."""
    orientation = Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))
    pose = Pose(position=Point(x=float(x), y=float(y)), orientation=orientation)
    return TopCall(top="goToPose", goal=PoseStamped(pose=pose), open=list(open_variables))


def main() -> int:
    """Tick the tree until it ends, or interrupt it at Ctrl-C; return the exit code."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # Ctrl-C must still cancel the goal
    node = Node("behavior_tree")
    stations = [go_to_pose(1.0, 1.0, 0.0, ["yaw"]), go_to_pose(-1.0, 1.5, math.pi)]
    tour = ExecuteChainBehaviour("tour", stations)
    home = ExecuteChainBehaviour("home", [go_to_pose(-2.0, 0.0, 0.0)], refine=False)
    root = py_trees.composites.Sequence("tour and home", memory=True, children=[tour, home])
    tree = py_trees.trees.BehaviourTree(root)
    tree.setup(node=node)
    timer = node.create_timer(TICK_PERIOD, tree.tick)
    try:
        while root.status not in (Status.SUCCESS, Status.FAILURE):
            rclpy.spin_once(node)
        print(py_trees.display.unicode_tree(root, show_status=True))
        return 0 if root.status is Status.SUCCESS else 1
    except KeyboardInterrupt:
        timer.cancel()
        root.stop(Status.INVALID)
        rclpy.spin_once(node, timeout_sec=1.0)  # receives the answer to the cancellation
        return 130
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    raise SystemExit(main())
