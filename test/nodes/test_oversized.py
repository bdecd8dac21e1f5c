"""What is too large or would upset a terminal, in every message: refused at once, in a short plain line."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from chain_client import ChainClient
from load import resident_mib, worst_request
from nav_msgs.msg import Odometry
from process import Process
from ros_client import Client

import ator_interfaces.msg as msg
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.nodes import messages
from ator_ros.nodes.messages import refused
from ator_ros.robot.description import load_robot
from ator_ros.world import messages as checks
from ator_ros.world.messages import MessageError, ObjectReader, ObjectSource

LIBRARY = SOCCER.library(load_robot())
MEGABYTES = 10_000_000
FOREIGN = "\x1b[2J\u202e\n\x00" * (MEGABYTES // 7)
LONGEST_LINE = 200
BALL = ObjectReader(ObjectSource("ball"), "odom")
LIMIT = 0.01  # s


def chain(**fields: Any) -> msg.TopChain:
    call = msg.TopCall(top="goToPose")
    call.goal.pose.orientation.w = 1.0
    for name, value in fields.items():
        setattr(call, name, value)
    return msg.TopChain(calls=[call])


def framed(frame: str) -> msg.TopChain:
    made = chain()
    made.calls[0].goal.header.frame_id = frame
    return made


def read(message: msg.TopChain) -> None:
    messages.action_set_from(message, allowed={"default": None})
    messages.chain_from(message, LIBRARY, frame="odom")


def odometry(frame: str) -> Odometry:
    message = Odometry()
    message.header.frame_id = frame
    return message


def situation(frame: str) -> msg.Situation:
    message = msg.Situation()
    message.header.frame_id = frame
    return message


HOSTILE: dict[str, Callable[[str], Callable[[], Any]]] = {
    "top": lambda text: partial(read, chain(top=text)),
    "frame of a goal": lambda text: partial(read, framed(text)),
    "open": lambda text: partial(read, chain(open=[text])),
    "action set": lambda text: partial(read, msg.TopChain(calls=chain().calls, action_set=text)),
    "situation": lambda text: lambda: messages.world_from(situation(text), frame="odom"),
    "odom": lambda text: lambda: checks.robot_from(odometry(frame=text), frame="odom"),
    "ball": lambda text: lambda: BALL.read(odometry(frame=text)),
    "cmd_vel, place_robot and place_ball": lambda text: lambda: checks.frame(text, "pose", expected="odom"),
}


@pytest.mark.parametrize("text", [FOREIGN, "A" * MEGABYTES, "\x1b[31mred"], ids=["foreign", "long", "red"])
@pytest.mark.parametrize("place", HOSTILE)
def test_a_hostile_text_is_refused_at_once_in_one_short_line(place: str, text: str) -> None:
    check = HOSTILE[place](text)
    began = time.thread_time()
    with pytest.raises(MessageError) as raised:
        check()
    assert time.thread_time() - began < LIMIT
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) <= LONGEST_LINE


def test_a_hundred_thousand_calls_or_names_are_refused_at_once_and_not_sent_back() -> None:
    calls = msg.TopChain(calls=chain().calls * 100_000)
    names = chain(open=["x"] * 100_000)
    for message in (calls, names):
        began = time.thread_time()
        with pytest.raises(MessageError) as raised:
            read(message)
        assert len(str(raised.value)) <= LONGEST_LINE
        answer = refused(str(raised.value), messages.echo_of(message))
        assert time.thread_time() - began < LIMIT
        assert not answer.chain.calls
        assert not answer.original.calls


@pytest.mark.parametrize(
    "message",
    [chain(top=FOREIGN), framed("A" * MEGABYTES), chain(open=[FOREIGN])],
    ids=["top", "frame", "open"],
)
def test_large_texts_are_not_sent_back(message: msg.TopChain) -> None:
    assert messages.echo_of(message) == msg.TopChain()


def test_a_chain_of_ordinary_size_is_sent_back() -> None:
    message = chain(top="fly")
    assert messages.echo_of(message) is message
    answer: RefineSubgoal.Response = refused("no", message)
    assert answer.chain == message


def large_request(calls: int) -> RefineSubgoal.Request:
    return RefineSubgoal.Request(chain=msg.TopChain(calls=chain().calls * calls))


@pytest.mark.node
def test_nodes_refuse_a_large_message_and_go_on(start: Callable[..., Process], client: Client) -> None:
    refinement, chains = start("refinement"), ChainClient(client)
    start("executor")
    client.call(RefineSubgoal, "refine_subgoal", worst_request())
    before, request = resident_mib(refinement.pid), large_request(1000)
    for _ in range(3):
        answer = client.call(RefineSubgoal, "refine_subgoal", request)
        assert not answer.accepted
        assert len(answer.reason) <= LONGEST_LINE
        assert "got 1000" in answer.reason
        assert not answer.chain.calls
    assert resident_mib(refinement.pid) - before < 100.0  # what came is kept once, until the next comes
    outcome = chains.send(request.chain.calls).outcome()
    assert outcome.code == msg.Outcome.REFUSED
    assert "got 1000" in outcome.reason
