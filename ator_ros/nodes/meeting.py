"""Being known to an action server before a goal is sent.

A client sees a server as soon as it has discovered the server. The server sends no answer to a client that it
has not discovered in turn: on a loaded machine the goal is then executed, and its client never hears of it.
So a client first asks something harmless, again and again until it is answered.
"""

from __future__ import annotations

import uuid
from typing import Any

from action_msgs.srv import CancelGoal
from rclpy.node import Node


def meeting_client(node: Node, action: str) -> Any:
    """Return a client that can ask the server of an action whether it knows us; made after its ActionClient.

    Discovery keeps the order of creation: an answer to the last client implies that all are known.
    """
    return node.create_client(CancelGoal, f"{action}/_action/cancel_goal")


def nobodys_goal() -> CancelGoal.Request:
    """Return a cancel request for an unknown goal; the server answers it without effect."""
    request = CancelGoal.Request()
    request.goal_info.goal_id.uuid = list(uuid.uuid4().bytes)
    return request
