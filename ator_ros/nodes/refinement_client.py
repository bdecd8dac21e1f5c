"""The executor's client of refine_subgoal."""

from __future__ import annotations

from typing import Any

from rclpy.client import Client
from rclpy.node import Node

from ator_interfaces.srv import RefineSubgoal
from ator_ros.nodes.bounded import bounded, with_parts
from ator_ros.nodes.qos import SERVICES

_MOST_IN_ANSWERS = 256
"""Items of a sequence in an answer that are looked at; honest ones have up to 128."""


def refinement_client(node: Node) -> Client:
    """Return a client of refine_subgoal whose answers are cut to size."""
    client: Any = node.create_client(RefineSubgoal, "refine_subgoal", qos_profile=SERVICES)
    answer = bounded(RefineSubgoal.Response, _MOST_IN_ANSWERS)
    client.srv_type = with_parts(RefineSubgoal, Response=answer)
    return client
