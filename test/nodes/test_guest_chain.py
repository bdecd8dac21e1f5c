"""A view's stage beside an executor to which somebody else sends chains."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import pytest
from chain_client import ChainClient, chain_of_the_paper
from conftest import Start
from ros_client import Client

from ator_interfaces.msg import ChainPerformance, Outcome
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.geometry import Pose
from ator_ros.nodes import silence
from ator_ros.nodes.guests import Guests
from ator_ros.nodes.live_stage import LiveStage
from ator_ros.nodes.qos import LATCHED
from ator_ros.nodes.spun_node import SpunNode
from ator_ros.viewing.desk import NAIVE, Desk

pytestmark = pytest.mark.node
ROBOT = SOCCER.robot()
PATIENCE = 240.0
START = Pose(0.3, 2.0, -1.6)
"""From where the straight way to the ball is the wrong one."""


@pytest.fixture
def stage(domain: int, start: Start) -> Iterator[LiveStage]:
    """Yield a stage beside three nodes, for which a busy machine is no fault."""
    start("simulation", command_wait=10.0, real_time_factor=3.0)
    start("refinement", deadline=5.0)
    start("executor", odom_timeout=10.0, refinement_timeout=20.0, start_timeout=30.0)
    own = SpunNode("view", domain=domain, patience=PATIENCE)
    stage = LiveStage(own, SOCCER, ROBOT)
    own.start()
    stage.ready(simulated=False)
    yield stage
    own.close()


def steps(desk: Desk, happened: Callable[[], object], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, f"expected {what}; {desk.problem}"
        desk.step()
        time.sleep(0.02)


@pytest.mark.long
def test_a_chain_of_others_is_seen_until_it_ends_and_can_be_stopped(stage: LiveStage, client: Client) -> None:
    desk = Desk(stage, SOCCER, {name: SOCCER.library(ROBOT, name) for name in SOCCER.action_sets})
    desk.control(stage)
    chains = ChainClient(client)
    client.place(robot=START, ball=(0.0, 0.0))
    steps(desk, lambda: desk.advice is not None, "advice")
    sent = chains.send(chain_of_the_paper(), refine=True)
    steps(desk, lambda: stage.guest is not None and stage.guest.begun, "the chain")
    steps(desk, lambda: desk.playing and desk.shown[0] is not desk.draft, "that it is shown")
    draft, advice = desk.shown
    assert draft.world.robot.pose.distance(START) < 0.1
    assert advice is not None
    assert [call.top.name for call in advice.chain.calls] == ["goToBall", "dribbleBall", "shoot"]
    steps(desk, lambda: "waiting" not in str(getattr(desk.shown[1], "reason", "")), "that it is driven")
    _, advice = desk.shown
    assert advice is not None
    assert advice.naive != advice.chain
    assert advice.curves
    assert all(value > 0.0 for value in (*advice.before, *advice.after))
    steps(desk, sent.ended, "the end")
    result = sent.result()
    steps(desk, lambda: not desk.playing, "the end, seen")
    [run] = desk.runs
    assert result.outcome.code == Outcome.SUCCEEDED
    assert run.duration == pytest.approx(result.record.actual.duration)
    assert run.actual == pytest.approx([action.actual.duration for action in result.record.actions])
    assert advice.reason == result.record.refinement
    assert advice.refined == result.record.refined
    guest = stage.guest
    assert guest is not None
    [first, *_] = result.record.chain.calls
    assert guest.chain.calls[0].goal.pose.yaw == pytest.approx(
        2.0 * math.atan2(first.goal.pose.orientation.z, first.goal.pose.orientation.w), abs=1e-6
    )

    client.place(robot=START, ball=(0.0, 0.0))
    sent = chains.send(chain_of_the_paper(), refine=True)
    steps(desk, lambda: desk.playing, "the next chain")
    desk.step([desk.stop])
    assert sent.outcome().code == Outcome.CANCELED
    steps(desk, lambda: not desk.playing, "the end")

    desk.play(NAIVE)  # what is sent from here is no guest
    steps(desk, lambda: desk.run is not None and desk.run.ended, "our chain")
    assert stage.guest is None
    late = client.listen(ChainPerformance, "chain_under_way", LATCHED)
    client.eventually(lambda: late, "the last word, latched")
    assert late[-1].outcome.code != 0


def test_an_executor_that_vanishes_ends_what_others_sent(
    domain: int, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(silence, "_LONGEST", 0.5)
    own = SpunNode("view", domain=domain, patience=PATIENCE)
    heard = Guests(own, {"default": SOCCER.library(ROBOT)}, frame="odom", is_ours=lambda _: False)
    own.start()
    try:
        topic = client.node.create_publisher(ChainPerformance, "chain_under_way", LATCHED)
        message = ChainPerformance(chain_id="0" * 32)
        message.chain.calls = chain_of_the_paper()
        topic.publish(message)
        client.eventually(lambda: heard.present is not None, "the chain")
        guest = heard.present
        assert guest is not None
        heard.watch(1.0)
        time.sleep(0.6)
        heard.watch(1.0)  # time stands still
        assert not guest.run.ended
        heard.watch(2.0)
        assert guest.run.ended
        assert guest.run.status == "lost: the executor does not answer"
        for chain_id, calls in (("x", chain_of_the_paper()), ("0" * 32, [])):
            message.chain_id, message.chain.calls = chain_id, calls
            topic.publish(message)
            client.eventually(lambda: heard.present is None, "that it is ignored")
            message.chain_id, message.chain.calls = "1" * 32, chain_of_the_paper()
            topic.publish(message)
            client.eventually(lambda: heard.present is not None, "the next one")
    finally:
        own.close()
