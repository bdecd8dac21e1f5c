"""Inputs fall silent, time jumps back, processes freeze: the robot stands, and the goal says why."""

from __future__ import annotations

import math
import random
import signal
from collections import deque
from collections.abc import Iterator

import pytest
from arena import LONGEST_STOP, Arena, arena_with
from nav_msgs.msg import Odometry
from ros_client import Client, stamp
from selection import few
from stages import MOVING, STAGES, Stage, dribble, waiting

from ator_interfaces.msg import Outcome
from ator_ros.nodes.qos import SENSOR_DATA

pytestmark = pytest.mark.node

INPUTS = ("odom", "ball")
SETTINGS: dict[str, dict[str, object]] = {
    "executor": {"remap": {name: f"relayed/{name}" for name in INPUTS}},
}
DROPOUTS, LATE_TICKS = 0.05, 2


class Relay:
    """Stands between the simulation and the executor, and passes on what it is not told to keep back.

    `silent` gives for how many seconds, of stamps, an input is kept back since its last message that passed;
    `poor` has messages lost at random and the ball late, as a camera's. `frozen` repeats the last odometry
    with new stamps, and stamps of odometry are `ahead` by so many seconds.
    """

    def __init__(self, client: Client) -> None:
        self.silent: dict[str, float] = {}
        self.poor = self.frozen = False
        self.ahead = 0
        self._kept: Odometry | None = None
        self.last: dict[str, float] = {}
        self.longest: dict[str, float] = {}
        self._random, self._balls = random.Random(5), deque[Odometry](maxlen=1 + LATE_TICKS)
        self._publishers = {
            name: client.node.create_publisher(Odometry, f"relayed/{name}", SENSOR_DATA) for name in INPUTS
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
        if name == "odom":
            message = self._changed(message)
        if name in self.silent and now - self.last[name] > self.silent[name]:
            self.silent.pop(name)
        if name in self.silent or (self.poor and self._random.random() < DROPOUTS):
            return
        self.longest[name] = max(self.longest.get(name, 0.0), now - self.last.get(name, now))
        self.last[name] = now
        self._publishers[name].publish(message)

    def _changed(self, message: Odometry) -> Odometry:
        if not self.frozen:
            self._kept = None
        elif self._kept is None:
            self._kept = message
        told = Odometry(header=message.header, child_frame_id=message.child_frame_id)
        told.pose, told.twist = (self._kept or message).pose, (self._kept or message).twist
        told.header.stamp.sec += self.ahead
        return told


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
    """Mend what a test has broken; then a new goal works, and what must hold always has held."""
    yield
    relay.silent.clear()
    relay.poor = relay.frozen = False
    relay.ahead = 0
    for node in arena.nodes.values():
        node.send(signal.SIGCONT)
    arena.visit().succeed()
    arena.check()


@pytest.mark.parametrize("stage", few(MOVING, dribble))
@pytest.mark.parametrize("name", INPUTS)
def test_an_input_falls_silent(arena: Arena, relay: Relay, name: str, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    stops = len(arena.stops())
    relay.silent[name] = math.inf
    outcome = visit.ended(sent).outcome
    visit.ros.eventually(lambda: len(arena.stops()) > stops, "the robot stands")
    assert outcome.code == Outcome.INPUT_LOST
    assert f"{name} is missing" in outcome.reason
    _, stood = arena.stops()[stops]
    assert stood - relay.last[name] <= LONGEST_STOP + 1e-6


@pytest.mark.long
def test_a_chain_succeeds_with_lost_messages_and_a_late_ball(arena: Arena, relay: Relay) -> None:
    visit = arena.visit()
    relay.poor = True
    outcome = visit.ended(dribble(arena, visit)).outcome
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason


@pytest.mark.parametrize("stage", few(STAGES, dribble))
def test_the_executor_freezes(arena: Arena, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    stops = len(arena.stops())
    arena.nodes["executor"].send(signal.SIGSTOP)
    frozen = visit.ros.time()
    visit.ros.eventually(lambda: visit.ros.time() > frozen + 2.0, "two seconds pass")
    if stage in MOVING:
        assert len(arena.stops()) > stops
    arena.nodes["executor"].send(signal.SIGCONT)
    if stage is waiting:
        visit.place()
    visit.ended(sent)
