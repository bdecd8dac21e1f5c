"""The stages of a chain, as places where something can fail."""

from __future__ import annotations

import signal
from collections.abc import Callable

from arena import Arena, Visit
from chain_client import Sent, call

from ator_interfaces.srv import PlaceObject
from ator_ros.geometry import Pose

CHAIN = [
    call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",)),
    call("dribbleBall", Pose(1.2, 0.0, 0.0)),
]
SHOT = [
    call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",)),
    call("dribbleBall", Pose(1.6, 0.0, 0.0)),
    call("shoot", Pose(4.0, 0.0, 0.0)),
]
Stage = Callable[[Arena, Visit], Sent]


def waiting(arena: Arena, visit: Visit) -> Sent:
    """Let a goal wait for a ball."""
    assert visit.ros.call(PlaceObject, "place_ball", PlaceObject.Request(remove=True)).success
    heard = len(visit.ros.robots)
    visit.ros.eventually(
        lambda: len(visit.ros.robots) > heard + 50, "no ball for longer than any timeout here"
    )
    sent = visit.send(CHAIN)
    visit.ros.eventually(lambda: said(sent, "waiting for the ball"), "the goal waits")
    return sent


def refining(arena: Arena, visit: Visit) -> Sent:
    """Let a goal wait for refinement, which is frozen."""
    visit.place()
    arena.nodes["refinement"].send(signal.SIGSTOP)
    sent = visit.send(CHAIN, refine=True)
    visit.ros.eventually(lambda: said(sent, "waiting for refinement"), "the goal is being refined")
    return sent


def approach(arena: Arena, visit: Visit) -> Sent:
    """Let the robot drive to the ball."""
    visit.place()
    sent = visit.send(CHAIN)
    visit.ros.eventually(lambda: visit.ros.robot().v > 0.2, "the robot drives")
    return sent


def dribble(arena: Arena, visit: Visit) -> Sent:
    """Let the robot drive with the ball."""
    sent = approach(arena, visit)
    visit.ros.eventually(lambda: any(told.top == "dribbleBall" for told in sent.feedback), "the dribble")
    visit.ros.eventually(lambda: visit.ros.robot().v > 0.2, "the robot drives")
    return sent


def shoot(arena: Arena, visit: Visit) -> Sent:
    """Let the robot run at the goal with the ball."""
    visit.place()
    sent = visit.send(SHOT)
    visit.ros.eventually(lambda: any(told.top == "shoot" for told in sent.feedback), "the shot")
    visit.ros.eventually(lambda: visit.ros.robot().v > 0.2, "the robot drives")
    return sent


MOVING = (approach, dribble, shoot)
STAGES = (waiting, refining, *MOVING)


def said(sent: Sent, words: str) -> bool:
    """Return whether a goal's feedback has held these words."""
    return any(words in told.status for told in sent.feedback)
