"""The `executor` node with a displaced ball, over ROS.

The simulation runs at real time, so that the ball is moved while the robot drives, also on a slow
machine. With late ticks the robot may lose the ball, and may fetch it again.
"""

import pytest
from chain_client import ChainClient, call, chain_of_the_paper
from conftest import Start
from ros_client import Client

from ator_interfaces.msg import AlternativeChain, Outcome
from ator_ros.geometry import Pose

LONG = 120.0
"""Real seconds that a chain may take on a loaded machine."""


@pytest.mark.long
def test_a_displaced_ball_is_refined_again_while_the_robot_drives(
    start: Start, client: Client
) -> None:
    start("simulation")
    start("refinement", gate=False, deadline=5.0)
    start(
        "executor", odom_timeout=5.0, ball_timeout=0.5, start_timeout=60.0, refinement_timeout=20.0
    )
    chains, calls = ChainClient(client), chain_of_the_paper()[:2]
    chains.place(Pose(-2.0, 0.0, 0.0))
    others = [AlternativeChain(calls=[call("goToPose", Pose(-1.0, 0.5, 0.0)), *calls])]
    sent = chains.send(calls, refine=True, fetches=9, alternatives=others)
    client.eventually(
        lambda: sent.feedback and sent.feedback[-1].top == "goToBall", "the approach", LONG
    )
    chains.wait_until_moving()
    client.place(ball=(0.0, -0.5))
    result = sent.result(LONG)
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert result.record.refined
    assert result.record.refined_again >= 1, result.record.refinement
    assert "refined again after" in result.record.refinement
