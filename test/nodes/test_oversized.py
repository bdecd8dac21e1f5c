"""What is too large or would upset a terminal, in every message: refused at once, in a short plain line."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from chain_client import ChainClient
from nav_msgs.msg import Odometry
from process import Process
from rcl_interfaces.srv import GetParameters
from rclpy.serialization import deserialize_message, serialize_message
from ros_client import Client

import ator_interfaces.msg as msg
from ator_interfaces.action import ExecuteChain
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.nodes import conversions
from ator_ros.nodes.bounded import bounded
from ator_ros.nodes.refinement_answers import refused
from ator_ros.robot.description import load_robot
from ator_ros.tools.benchmarks.requests import worst_request
from ator_ros.tools.benchmarks.service import resident_mib
from ator_ros.world import messages
from ator_ros.world.messages import MOST_ITEMS, MessageError, ObjectReader, ObjectSource

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
    conversions.action_set_from(message, allowed={"default": None})
    conversions.chain_from(message, LIBRARY, frame="odom")


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
    "situation": lambda text: lambda: conversions.world_from(situation(text), frame="odom"),
    "odom": lambda text: lambda: messages.robot_from(odometry(frame=text), frame="odom"),
    "ball": lambda text: lambda: BALL.read(odometry(frame=text)),
    "cmd_vel, place_robot and place_ball": lambda text: lambda: messages.frame(text, "pose", expected="odom"),
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
        answer = refused(str(raised.value), conversions.echo_of(message))
        assert time.thread_time() - began < LIMIT
        assert not answer.chain.calls
        assert not answer.original.calls


@pytest.mark.parametrize(
    "message",
    [chain(top=FOREIGN), framed("A" * MEGABYTES), chain(open=[FOREIGN])],
    ids=["top", "frame", "open"],
)
def test_large_texts_are_not_sent_back(message: msg.TopChain) -> None:
    assert conversions.echo_of(message) == msg.TopChain()


def test_a_chain_of_ordinary_size_is_sent_back() -> None:
    message = chain(top="fly")
    assert conversions.echo_of(message) is message
    answer: RefineSubgoal.Response = refused("no", message)
    assert answer.chain == message


def large_request(calls: int) -> RefineSubgoal.Request:
    request = RefineSubgoal.Request(chain=msg.TopChain(calls=chain().calls * calls))
    request.chain.calls[0] = chain(open=["x"] * 1000).calls[0]
    return request


def test_what_is_taken_is_cut_before_it_becomes_objects_and_memory_is_freed() -> None:
    # rclpy's own conversion takes 0.8 s; the 10 ms that remain are those of rosidl's, in C.
    raw, kind = serialize_message(large_request(20_000)), bounded(RefineSubgoal.Request, MOST_ITEMS)
    taken = deserialize_message(raw, kind)
    began, memory = time.thread_time(), resident_mib(os.getpid())
    for _ in range(5):
        taken = deserialize_message(raw, kind)
    assert time.thread_time() - began < 5 * 0.1
    assert resident_mib(os.getpid()) - memory < 30.0
    assert type(taken) is RefineSubgoal.Request
    assert (len(taken.chain.calls), len(taken.chain.calls[0].open)) == (MOST_ITEMS, MOST_ITEMS)
    with pytest.raises(MessageError, match="expected 1 to 32 items, got 64 or more"):
        read(taken.chain)


def test_whatever_has_no_long_sequences_is_taken_as_it_is() -> None:
    goal = ExecuteChain.Goal(chain=worst_request().chain, refine=True, fetches=3)
    sent = ExecuteChain.Impl.SendGoalService.Request(goal=goal)
    sent.goal_id.uuid = list(range(16))
    situation = msg.Situation(objects=[msg.ObjectState(name="ball")] * 3, v=1.5)
    record = msg.ActionPerformance(call=worst_request().chain.calls[0], step=7, start=situation)
    result = ExecuteChain.Result(record=msg.ChainPerformance(actions=[record] * 3, fetched=2))
    curve = msg.SearchCurve(variables=["yaw", "speed"], values=[0.25] * 1000, totals=[1.0] * 500)
    answer = RefineSubgoal.Response(accepted=True, free=[msg.FreeVariable(name="yaw")] * 60, curves=[curve])
    for message in (worst_request(), sent, result, answer, Odometry(child_frame_id="x" * 300)):
        assert deserialize_message(serialize_message(message), bounded(type(message), MOST_ITEMS)) == message


def test_fields_of_any_name_are_cut() -> None:
    sent = GetParameters.Request(names=["x"] * (MOST_ITEMS + 1))  # ctypes.Structure is no place for that name
    taken = deserialize_message(serialize_message(sent), bounded(GetParameters.Request, MOST_ITEMS))
    assert taken.names == ["x"] * MOST_ITEMS


@pytest.mark.node
@pytest.mark.long
def test_nodes_refuse_a_large_message_and_go_on(start: Callable[..., Process], client: Client) -> None:
    refinement, chains = start("refinement"), ChainClient(client)
    start("executor")
    client.call(RefineSubgoal, "refine_subgoal", worst_request())
    before, request = resident_mib(refinement.pid), large_request(100_000)
    for _ in range(3):
        answer = client.call(RefineSubgoal, "refine_subgoal", request)
        assert not answer.accepted
        assert len(answer.reason) <= LONGEST_LINE
        assert "got 64 or more" in answer.reason
        assert not answer.chain.calls
    assert resident_mib(refinement.pid) - before < 100.0  # what came is kept once, until the next comes
    outcome = chains.send(request.chain.calls).outcome()
    assert outcome.code == msg.Outcome.REFUSED
    assert "got 64 or more" in outcome.reason
