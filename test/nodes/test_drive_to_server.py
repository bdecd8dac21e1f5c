"""The example servers: status and result of their goals."""

from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from conftest import Start
from moving_base import MovingBase
from process import PATIENCE
from rclpy.action import ActionClient
from ros_client import Client

from ator_interfaces.action import DriveTo
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of


@pytest.mark.parametrize(
    ("executable", "action"), [("drive_to_server", "drive_to"), ("pursuit_server", "pursue")]
)
def test_a_goal_executes_until_arrival_cancellation_or_a_newer_goal(
    start: Start, client: Client, executable: str, action: str
) -> None:
    base = MovingBase(client)
    start(executable)
    server = ActionClient(client.node, DriveTo, action)
    assert server.wait_for_server(timeout_sec=PATIENCE)
    client.wait_for_discovery_by(action)

    def sent(x: float) -> Any:
        goal = DriveTo.Goal()
        goal.goal.pose = pose_of(Pose(x, 0.0, 0.0))
        future = client.within(lambda: server.send_goal_async(goal))
        client.eventually(future.done, "an answer")
        handle = future.result()
        client.eventually(lambda: handle.status == GoalStatus.STATUS_EXECUTING, "it is executed")
        return handle

    def ended(handle: Any) -> Any:
        future = client.within(handle.get_result_async)
        client.eventually(future.done, "the result")
        return future.result()

    older = sent(5.0)
    client.eventually(lambda: base.pose.x > 0.05, "the base drives")
    newer = sent(4.0)
    assert ended(older).result.error_code == DriveTo.Result.SUPERSEDED
    client.within(newer.cancel_goal_async)
    assert ended(newer).status == GoalStatus.STATUS_CANCELED
    assert ended(sent(base.pose.x + 0.2)).status == GoalStatus.STATUS_SUCCEEDED
