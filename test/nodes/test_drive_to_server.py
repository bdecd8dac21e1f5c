"""The example servers: status and result of their goals."""

import pytest
from action_msgs.msg import GoalStatus
from conftest import Start
from moving_base import MovingBase
from process import PATIENCE
from rclpy.action import ActionClient
from ros_client import Client, SentGoal

from ator_interfaces.action import DriveTo
from ator_ros.geometry import Pose
from ator_ros.nodes.messages import pose_of


@pytest.mark.parametrize(
    ("executable", "action"),
    [
        pytest.param("drive_to_server", "drive_to", marks=pytest.mark.long),
        ("pursuit_server", "pursue"),
    ],
)
def test_a_goal_executes_until_arrival_cancellation_or_a_newer_goal(
    start: Start, client: Client, executable: str, action: str
) -> None:
    base = MovingBase(client)
    start(executable)
    server = ActionClient(client.node, DriveTo, action)
    assert server.wait_for_server(timeout_sec=PATIENCE)
    client.wait_for_discovery_by(action)

    def sent(x: float) -> SentGoal:
        goal = DriveTo.Goal()
        goal.goal.pose = pose_of(Pose(x, 0.0, 0.0))
        made = SentGoal(client, server, goal)
        client.eventually(
            lambda: made.handle.status == GoalStatus.STATUS_EXECUTING, "it is executed"
        )
        return made

    older = sent(5.0)
    client.eventually(lambda: base.pose.x > 0.05, "the base drives")
    newer = sent(4.0)
    assert older.response().result.error_code == DriveTo.Result.SUPERSEDED
    assert newer.cancel()
    assert newer.response().status == GoalStatus.STATUS_CANCELED
    assert sent(base.pose.x + 0.2).response().status == GoalStatus.STATUS_SUCCEEDED
