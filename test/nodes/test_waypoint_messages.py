"""The node `waypoints` without the messages of Nav2."""

import importlib.util

import pytest
from conftest import Start


@pytest.mark.skipif(importlib.util.find_spec("nav2_msgs") is not None, reason="nav2_msgs is installed")
def test_without_nav2_msgs_the_node_ends_with_one_line(start: Start) -> None:
    node = start("waypoints")
    assert node.wait() == 1
    (line,) = node.output.splitlines()
    assert "expected nav2_msgs/action/FollowWaypoints to be installed, as by `apt install" in line
