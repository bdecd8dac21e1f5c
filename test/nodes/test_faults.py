"""The robot stops if inputs stop, nodes freeze, die or restart, or goals end, at any time."""

import itertools
import random
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from arena import STOP_DEADLINE, Arena, ArenaClient, arena_with
from chain_client import SentChain, call
from nav_msgs.msg import Odometry
from ros_client import Client, stamp
from selection import few

from ator_interfaces.msg import Outcome
from ator_interfaces.srv import PlaceObject
from ator_ros.geometry import Pose
from ator_ros.nodes.qos import SENSOR_DATA

CHAIN = [
    call("goToBall", Pose(0.0, 0.0, 0.0), opened=("yaw",)),
    call("dribbleBall", Pose(1.2, 0.0, 0.0)),
]
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
    client.ros.eventually(lambda: client.ros.robot().vx > 0.2, "the robot drives")
    return sent


def dribble(arena: Arena, client: ArenaClient) -> SentChain:
    """Send a goal; wait until the robot drives with the ball."""
    sent = approach(arena, client)
    client.ros.eventually(
        lambda: any(each.top == "dribbleBall" for each in sent.feedback), "the dribble"
    )
    client.ros.eventually(lambda: client.ros.robot().vx > 0.2, "the robot drives")
    return sent


def shoot(arena: Arena, client: ArenaClient) -> SentChain:
    """Send a goal; wait until the robot shoots."""
    client.place()
    sent = client.send(SHOT)
    client.ros.eventually(
        lambda: any(message.top == "shoot" for message in sent.feedback), "the shot"
    )
    client.ros.eventually(lambda: client.ros.robot().vx > 0.2, "the robot drives")
    return sent


MOVING = (approach, dribble, shoot)
STAGES = (waiting, refining, *MOVING)


pytestmark = pytest.mark.node

INPUTS = ("odom", "ball")
SETTINGS: dict[str, dict[str, object]] = {
    "executor": {"remap": {name: f"relayed/{name}" for name in INPUTS}}
}
DROPOUTS, LATE_TICKS = 0.05, 2


class Relay:
    """A relay between simulation and executor that can drop messages.

    Topics in `silent` are dropped; with `poor`, messages are lost at random and the ball is late.
    """

    def __init__(self, client: Client) -> None:
        self.silent: set[str] = set()
        self.poor = False
        self.last: dict[str, float] = {}
        self._random, self._balls = random.Random(5), deque[Odometry](maxlen=1 + LATE_TICKS)
        self._publishers = {
            name: client.node.create_publisher(Odometry, f"relayed/{name}", SENSOR_DATA)
            for name in INPUTS
        }
        for name in INPUTS:
            client.node.create_subscription(
                Odometry, name, lambda message, name=name: self._pass(name, message), SENSOR_DATA
            )

    def _pass(self, name: str, message: Odometry) -> None:
        now = stamp(message)
        if name == "ball":
            self._balls.append(message)
            message = self._balls[0] if self.poor else message
        if name in self.silent or (self.poor and self._random.random() < DROPOUTS):
            return
        self.last[name] = now
        self._publishers[name].publish(message)


@pytest.fixture(scope="module")
def arena(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Arena]:
    with arena_with(tmp_path_factory.mktemp("logs"), SETTINGS) as made:
        made.start("simulation", "executor", "refinement")
        yield made


@pytest.fixture(scope="module")
def relay(arena: Arena) -> Relay:
    return Relay(arena.observer)


@pytest.fixture(autouse=True)
def recovery(arena: Arena, relay: Relay) -> Iterator[None]:
    """Restore nodes and inputs; assert that a new goal succeeds and that the invariants held."""
    yield
    relay.silent.clear()
    relay.poor = False
    for node in arena.nodes.values():
        node.send(signal.SIGCONT)
    arena.new_client().succeed()
    arena.check()


@pytest.mark.parametrize("stage", few(MOVING, dribble))
@pytest.mark.parametrize("name", INPUTS)
def test_an_input_stops(arena: Arena, relay: Relay, name: str, stage: Stage) -> None:
    client = arena.new_client()
    sent = stage(arena, client)
    stops = len(arena.stops())
    relay.silent.add(name)
    outcome = client.ended(sent).outcome
    client.ros.eventually(lambda: len(arena.stops()) > stops, "the robot stands")
    assert outcome.code == Outcome.INPUT_LOST
    assert f"{name} is missing" in outcome.reason
    _, stopped = arena.stops()[stops]
    assert stopped - relay.last[name] <= STOP_DEADLINE + 1e-6


@pytest.mark.long
def test_a_chain_succeeds_with_lost_messages_and_a_late_ball(arena: Arena, relay: Relay) -> None:
    client = arena.new_client()
    relay.poor = True
    outcome = client.ended(dribble(arena, client)).outcome
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason


@pytest.mark.long
@pytest.mark.parametrize("stage", few(STAGES, dribble))
def test_the_executor_freezes(arena: Arena, stage: Stage) -> None:
    client = arena.new_client()
    sent = stage(arena, client)
    stops = len(arena.stops())
    arena.nodes["executor"].send(signal.SIGSTOP)
    frozen = client.ros.time()
    client.ros.eventually(lambda: client.ros.time() > frozen + 2.0, "two seconds pass")
    if stage in MOVING:
        assert len(arena.stops()) > stops
    arena.nodes["executor"].send(signal.SIGCONT)
    if stage is waiting:
        client.place()
    client.ended(sent)


def recovers(arena: Arena, name: str) -> None:
    arena.nodes["refinement"].send(signal.SIGCONT)
    arena.start(name)
    arena.new_client().succeed()


@pytest.mark.long
@pytest.mark.parametrize("stage", few(STAGES, dribble))
def test_the_executor_is_killed(arena: Arena, stage: Stage) -> None:
    client = arena.new_client()
    stage(arena, client)
    stops = len(arena.stops())
    arena.nodes["executor"].kill()
    if stage in MOVING:
        client.ros.eventually(lambda: len(arena.stops()) > stops, "the robot stands")
    recovers(arena, "executor")


@pytest.mark.long
@pytest.mark.parametrize("stage", few(STAGES, dribble))
def test_the_simulation_is_killed(arena: Arena, stage: Stage) -> None:
    client = arena.new_client()
    sent = stage(arena, client)
    arena.nodes["simulation"].kill()
    outcome = client.ended(sent).outcome
    assert outcome.code == Outcome.INPUT_LOST
    assert "odom is missing" in outcome.reason
    recovers(arena, "simulation")


@pytest.mark.long
@pytest.mark.parametrize("stage", few(STAGES, refining))
@pytest.mark.parametrize("frozen", [False, True])
def test_refinement_is_killed_or_freezes(arena: Arena, stage: Stage, frozen: bool) -> None:
    client = arena.new_client()
    sent = stage(arena, client)
    arena.nodes["refinement"].send(signal.SIGSTOP if frozen else signal.SIGKILL)
    if stage is waiting:
        client.place()
    result = client.ended(sent)
    assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
    if stage is refining:
        assert "refinement failed: no answer within 3 s" in result.record.refinement
    if not frozen:
        recovers(arena, "refinement")


ORDERS = list(itertools.permutations(["executor", "refinement", "simulation"]))


@pytest.mark.long
@pytest.mark.parametrize("order", few(ORDERS, ORDERS[0]))
def test_nodes_start_in_any_order(order: tuple[str, ...], tmp_path: Path) -> None:
    with arena_with(tmp_path) as arena:
        for name in order:
            arena.start(name)
        client = arena.new_client()
        client.place()
        result = client.ended(client.send(CHAIN[:1], refine=True))
        assert result.outcome.code == Outcome.SUCCEEDED, result.outcome.reason
        assert "refinement failed" not in result.record.refinement
        arena.check()


@pytest.mark.long
@pytest.mark.parametrize("seed", few(range(6), 0, 1))
def test_goals_are_canceled_and_preempted_at_any_moment(arena: Arena, seed: int) -> None:
    """Send goals, each canceled or preempted after a random time; the last one succeeds."""
    draw = random.Random(seed)
    client = arena.new_client()
    client.place()
    sent, canceled = [], set()
    for number in range(draw.randint(3, 6)):
        sent.append(client.send([*CHAIN, *CHAIN[1:]], refine=draw.random() < 0.3))
        time.sleep(draw.choice((0.0, 0.01, draw.uniform(0.0, 0.8))))
        if draw.random() < 0.4 and sent[-1].cancel():
            canceled.add(number)
    client.succeed()
    for number, goal in enumerate(sent):
        outcome = client.ended(goal).outcome
        allowed = {Outcome.CANCELED} if number in canceled else {Outcome.PREEMPTED}
        # The next chain starts where the last one was aborted: it may fail early.
        assert outcome.code in allowed | {Outcome.REFUSED, Outcome.FAILED, Outcome.OBJECT_LOST}, (
            outcome.reason
        )
    arena.check()
