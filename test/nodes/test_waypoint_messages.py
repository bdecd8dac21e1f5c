"""Messages of the node `waypoints` with the fields of nav2_msgs after Jazzy."""

import sys
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock, call

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals

from ator_ros.nodes.waypoints import WaypointGoal

POSES = [PoseStamped() for _ in range(3)]


def waypoint_goal(request: Any, **result: Any) -> WaypointGoal:
    """Return a goal whose results have these fields."""
    kind = SimpleNamespace(Result=lambda **fields: SimpleNamespace(**result, **fields))
    return WaypointGoal(Mock(request=request, is_cancel_requested=False), kind, pace=2.0)


@pytest.fixture(autouse=True)
def later(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(
        sys.modules, "nav2_msgs.msg", SimpleNamespace(WaypointStatus=SimpleNamespace)
    )


def test_each_pose_has_a_status() -> None:
    through = waypoint_goal(SimpleNamespace(poses=Goals(goals=POSES)), waypoint_statuses=[])
    through.leg = 1
    code, reason = through.miss(1, "blocked")
    statuses = through.finish(code, reason).waypoint_statuses
    assert (code, through.handle.method_calls) == (9100, [call.abort()])
    assert [each.waypoint_status for each in statuses] == [1, 3, 0]
    assert (statuses[1].error_code, statuses[1].error_msg) == (9000, "blocked")


def test_a_missed_waypoint_has_a_reason() -> None:
    follow = waypoint_goal(SimpleNamespace(poses=POSES, number_of_loops=0, goal_index=0))
    follow.miss(2, "blocked")
    (missed,) = follow.finish(0, "").missed_waypoints
    assert follow.handle.method_calls == [call.succeed()]
    assert (missed.waypoint_index, missed.waypoint_status, missed.error_msg) == (2, 3, "blocked")
