"""What is too large or would upset a terminal, in every message: refused at once, in a short plain line."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from nav_msgs.msg import Odometry

import ator_interfaces.msg as msg
from ator_interfaces.srv import RefineSubgoal
from ator_ros.domains.soccer.domain import SOCCER
from ator_ros.nodes import checks, conversions
from ator_ros.nodes.checks import MessageError
from ator_ros.nodes.refinement_answers import refused
from ator_ros.robot.description import load_robot

LIBRARY = SOCCER.library(load_robot())
MEGABYTES = 10_000_000
FOREIGN = "\x1b[2J\u202e\n\x00" * (MEGABYTES // 7)
LONGEST_LINE = 200
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


def odometry(child: str = "odom", frame: str = "odom") -> Odometry:
    message = Odometry(child_frame_id=child)
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
    "odom": lambda text: lambda: conversions.robot_from(odometry(frame=text), frame="odom"),
    "ball": lambda text: lambda: conversions.ball_from(odometry(frame=text), frame="odom"),
    "child of the ball": lambda text: lambda: conversions.ball_from(odometry(child=text), frame="odom"),
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
