"""The stages of a chain, in each of which a failure may occur."""

import signal
from collections.abc import Callable

from arena import Arena, ArenaClient
from chain_client import SentChain, call

from ator_interfaces.srv import PlaceObject
from ator_ros.geometry import Pose

CHAIN = [call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",)), call("dribbleBall", Pose(1.2, 0.0, 0.0))]
SHOT = [
    call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",)),
    call("dribbleBall", Pose(1.6, 0.0, 0.0)),
    call("shoot", Pose(4.0, 0.0, 0.0)),
]
Stage = Callable[[Arena, ArenaClient], SentChain]


def waiting(arena: Arena, client: ArenaClient) -> SentChain:
    """Send a goal that waits for a ball."""
    assert client.ros.call(PlaceObject, "place_ball", PlaceObject.Request(remove=True)).success
    count = len(client.ros.robots)
    client.ros.eventually(
        lambda: len(client.ros.robots) > count + 50, "no ball for longer than any timeout here"
    )
    sent = client.send(CHAIN)
    sent.wait_for_status("waiting for the ball")
    return sent


def refining(arena: Arena, client: ArenaClient) -> SentChain:
    """Send a goal that waits for the frozen refinement node."""
    client.place()
    arena.nodes["refinement"].send(signal.SIGSTOP)
    sent = client.send(CHAIN, refine=True)
    sent.wait_for_status("waiting for refinement")
    return sent


def approach(arena: Arena, client: ArenaClient) -> SentChain:
    """Send a goal; wait until the robot drives to the ball."""
    client.place()
    sent = client.send(CHAIN)
    client.ros.eventually(lambda: client.ros.robot().v > 0.2, "the robot drives")
    return sent


def dribble(arena: Arena, client: ArenaClient) -> SentChain:
    """Send a goal; wait until the robot drives with the ball."""
    sent = approach(arena, client)
    client.ros.eventually(lambda: any(each.top == "dribbleBall" for each in sent.feedback), "the dribble")
    client.ros.eventually(lambda: client.ros.robot().v > 0.2, "the robot drives")
    return sent


def shoot(arena: Arena, client: ArenaClient) -> SentChain:
    """Send a goal; wait until the robot shoots."""
    client.place()
    sent = client.send(SHOT)
    client.ros.eventually(lambda: any(message.top == "shoot" for message in sent.feedback), "the shot")
    client.ros.eventually(lambda: client.ros.robot().v > 0.2, "the robot drives")
    return sent


MOVING = (approach, dribble, shoot)
STAGES = (waiting, refining, *MOVING)
