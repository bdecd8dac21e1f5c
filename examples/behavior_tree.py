"""A behavior of py_trees that executes a chain with the executor, and a tree that uses it.

    python3 examples/behavior_tree.py

The tree drives to two places in turn, with the heading at the first one left to refinement, and ends. The
nodes must run. The program needs rclpy, py_trees and the interfaces, and nothing else of ator_ros.
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

PERIOD = 0.1  # s between two ticks


class ExecuteChainBehaviour(py_trees.behaviour.Behaviour):
    """Executes a chain; its goal is canceled if the tree interrupts the behavior.

    It is running until the executor reports the end, and fails if the executor is gone.

    Parameters
    ----------
    name : str
        Name of the behavior.
    calls : sequence of TopCall
        The steps of the chain.
    refine : bool
        Whether the chain is refined first.
    """

    def __init__(self, name: str, calls: Sequence[TopCall], *, refine: bool = True) -> None:
        super().__init__(name)
        self._goal = ExecuteChain.Goal(chain=TopChain(calls=list(calls)), refine=refine)
        self._client: ActionClient | None = None
        self._sent: Any = None
        self._result: Any = None

    def setup(self, **kwargs: Any) -> None:
        """Make the client of the action on the `node`."""
        self._client = ActionClient(kwargs["node"], ExecuteChain, "execute_chain")

    def initialise(self) -> None:
        """Forget the last goal."""
        self._sent = self._result = None

    def update(self) -> Status:
        """Send the goal once the executor is there; return its state."""
        assert self._client is not None, "setup first"
        if self._sent is None:
            if not self._client.server_is_ready():
                self.feedback_message = "waiting for the executor"
                return Status.RUNNING
            self._sent = self._client.send_goal_async(self._goal, feedback_callback=self._take_feedback)
        if not self._sent.done():
            return Status.RUNNING
        if not self._sent.result().accepted:
            self.feedback_message = "the executor accepts no goal"
            return Status.FAILURE
        if self._result is None:
            self._result = self._sent.result().get_result_async()
        if not self._result.done():
            if self._client.server_is_ready():
                return Status.RUNNING
            self.feedback_message = "the executor is gone"
            return Status.FAILURE
        outcome = self._result.result().result.outcome
        self.feedback_message = outcome.reason
        return Status.SUCCESS if outcome.code == Outcome.SUCCEEDED else Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        """Cancel the goal if the tree interrupts the behavior."""
        if new_status is Status.INVALID and self._sent is not None:
            self._sent.add_done_callback(_cancel)  # at once if it was accepted already

    def _take_feedback(self, message: Any) -> None:
        now = message.feedback
        self.feedback_message = f"step {now.step + 1} of {now.steps}, {now.top}: {now.status}"


def _cancel(sent: Any) -> None:
    if sent.result().accepted:
        sent.result().cancel_goal_async()


def call(x: float, y: float, yaw: float, opened: Sequence[str] = ()) -> TopCall:
    """Return the step to a pose in m and rad; `opened` are the goal variables that refinement chooses."""
    turn = Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))
    pose = Pose(position=Point(x=x, y=y), orientation=turn)
    return TopCall(top="goToPose", goal=PoseStamped(pose=pose), open=list(opened))


def main() -> int:
    """Tick the tree until it ends, or interrupt it at Ctrl-C; return the exit code."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # so goals can still be canceled
    node = Node("behavior_tree")
    tour = ExecuteChainBehaviour("tour", [call(1.0, 1.0, 0.0, ["yaw"]), call(-1.0, 1.5, math.pi)])
    home = ExecuteChainBehaviour("home", [call(-2.0, 0.0, 0.0)], refine=False)
    root = py_trees.composites.Sequence("round", memory=True, children=[tour, home])
    tree = py_trees.trees.BehaviourTree(root)
    tree.setup(node=node)
    ticking = node.create_timer(PERIOD, tree.tick)
    try:
        while root.status not in (Status.SUCCESS, Status.FAILURE):
            rclpy.spin_once(node)
        print(py_trees.display.unicode_tree(root, show_status=True))
        return 0 if root.status is Status.SUCCESS else 1
    except KeyboardInterrupt:
        ticking.cancel()
        root.stop(Status.INVALID)
        rclpy.spin_once(node, timeout_sec=1.0)  # until the executor answers
        return 130
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    raise SystemExit(main())
