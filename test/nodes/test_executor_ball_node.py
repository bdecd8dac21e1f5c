"""The `executor` node with a moving ball, over ROS; all tests share one set of processes.

The simulation runs at real time, so that the ball is moved while the robot drives, also on a slow
machine. With late ticks the robot may lose the ball once more than planned, and may fetch it again.
"""

import pytest
from chain_client import ChainClient, SentChain, call, chain_of_the_paper
from process import Processes
from ros_client import Client

from ator_interfaces.msg import Outcome, TopChain
from ator_ros.geometry import Pose
from ator_ros.world.messages import pose_from

START = Pose(-2.0, 0.0, 0.0)
LONG = 120.0
"""Real seconds that a chain may take on a loaded machine."""


@pytest.fixture(scope="module")
def chains(shared: tuple[Processes, Client]) -> ChainClient:
    processes, client = shared
    processes.start("simulation")
    processes.start("refinement", gate=False, deadline=5.0)
    processes.start(
        "executor", odom_timeout=5.0, ball_timeout=0.5, start_timeout=60.0, refinement_timeout=20.0
    )
    return ChainClient(client)


@pytest.fixture(autouse=True)
def placed(chains: ChainClient) -> None:
    chains.place(START)


def until(chains: ChainClient, sent: SentChain, top: str) -> None:
    """Wait until the robot drives in step `top`."""
    chains.ros.eventually(lambda: sent.feedback and sent.feedback[-1].top == top, top, LONG)
    chains.wait_until_moving()


def steps(sent: SentChain) -> list[tuple[int, int]]:
    """Return the step and outcome of each action."""
    return [(action.step, action.outcome.code) for action in sent.result(LONG).record.actions]


@pytest.mark.long
def test_a_lost_ball_is_fetched_again_if_the_goal_allows_it(chains: ChainClient) -> None:
    sent = chains.send(chain_of_the_paper()[:2], fetches=9)
    until(chains, sent, "dribbleBall")
    chains.ros.place(ball=(0.5, 1.5))
    result = sent.result(LONG)
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert result.record.fetched >= 1
    done = steps(sent)
    # With late ticks the new approach is also aborted, or the ball is lost once more.
    assert [step for step, _ in done[:3]] == [0, 1, 0]
    assert (done[0], done[-1]) == ((0, Outcome.SUCCEEDED), (1, Outcome.SUCCEEDED))
    fetch = result.record.actions[2].call.goal.pose
    assert (fetch.position.x, fetch.position.y) == pytest.approx((0.5, 1.5), abs=0.02)
    planned = chain_of_the_paper()[0].goal.pose
    assert pose_from(fetch, "goal").yaw == pytest.approx(pose_from(planned, "goal").yaw)
    ball = chains.ros.ball()
    assert (ball.x, ball.y) == pytest.approx((2.4, 0.3), abs=0.15)


@pytest.mark.long
def test_a_displaced_ball_is_refined_again_while_the_robot_drives(chains: ChainClient) -> None:
    calls = chain_of_the_paper()[:2]
    others = [TopChain(calls=[call("goToPose", Pose(-1.0, 0.5, 0.0)), *calls])]
    sent = chains.send(calls, refine=True, fetches=9, alternatives=others)
    until(chains, sent, "goToBall")
    chains.ros.place(ball=(0.0, -0.5))
    result = sent.result(LONG)
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    assert result.record.refined
    assert result.record.refined_again >= 1, result.record.refinement
    assert "refined again after" in result.record.refinement
