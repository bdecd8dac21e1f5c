"""Who publishes on the topics that a node listens to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from ator_ros.nodes.senders import rival_senders


def node(*names: str, topic: str = "odom") -> Any:
    """Return a node that sees publishers of these names on a topic."""
    found = [
        SimpleNamespace(node_namespace=n.rpartition("/")[0], node_name=n.rpartition("/")[2]) for n in names
    ]
    return SimpleNamespace(get_publishers_info_by_topic=lambda asked: found if asked == topic else [])


@pytest.mark.parametrize("names", [(), ("/simulation",)])
def test_one_publisher_of_a_state_is_nothing_to_tell(names: tuple[str, ...]) -> None:
    assert rival_senders(node(*names), ("odom", "ball")) == ""


def test_two_publishers_of_a_state_are_named() -> None:
    told = rival_senders(node("/simulation", "/b/base"), ("odom", "ball"))
    assert told == "odom: expected one publisher, got 2: /b/base, /simulation"
    twins = rival_senders(node("/simulation", "/simulation", topic="ball"), ("odom", "ball"))
    assert twins == "ball: expected one publisher, got 2: /simulation, /simulation"


def test_many_publishers_are_told_in_a_short_line() -> None:
    told = rival_senders(node(*(f"/robot_{number}/base" for number in range(100))), ("odom",))
    assert "got 100: /robot_0/base" in told
    assert len(told) < 200
