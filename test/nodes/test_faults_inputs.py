"""Inputs fall silent, time jumps back, processes freeze: the robot stands, and the goal says why."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest
from arena import Arena, arena_with
from nav_msgs.msg import Odometry
from ros_client import Client, stamp
from stages import Stage, approach, dribble, refining, waiting
from std_srvs.srv import Trigger

from ator_interfaces.msg import Outcome
from ator_ros.nodes.node_support import SENSOR_DATA

pytestmark = pytest.mark.node

INPUTS = ("odom", "ball")
SETTINGS: dict[str, dict[str, object]] = {
    # A command comes at most as late as the machine is slow: at 1, that is as late in simulated time.
    "simulation": {"real_time_factor": 1.0},
    "executor": {"remap": {name: f"relayed/{name}" for name in INPUTS}},
}
LATE = 0.5
"""Seconds that a command may be under way on a loaded machine."""
BALL_TIMEOUT = 0.3
"""The executor's default, in s of the stamps."""


class Relay:
    """Stands between the simulation and the executor, and passes on what it is not told to keep back."""

    def __init__(self, client: Client) -> None:
        self.silent: set[str] = set()
        self.last: dict[str, float] = {}
        self._publishers = {
            name: client.node.create_publisher(Odometry, f"relayed/{name}", SENSOR_DATA) for name in INPUTS
        }
        for name in INPUTS:
            client.node.create_subscription(
                Odometry, name, lambda message, name=name: self._pass(name, message), SENSOR_DATA
            )

    def _pass(self, name: str, message: Odometry) -> None:
        if name not in self.silent:
            self.last[name] = stamp(message)
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
    """Mend what a test has broken; then a new goal works, and what must hold always has held."""
    yield
    relay.silent.clear()
    for node in arena.nodes.values():
        node.send(signal.SIGCONT)
    arena.visit().succeed()
    arena.check()


@pytest.mark.parametrize("stage", [approach, dribble])
@pytest.mark.parametrize(("name", "noticed"), [("odom", 0.0), ("ball", BALL_TIMEOUT)])
def test_an_input_falls_silent(arena: Arena, relay: Relay, name: str, noticed: float, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    stops = len(arena.stops())
    relay.silent.add(name)
    outcome = visit.ended(sent).outcome
    visit.ros.eventually(lambda: len(arena.stops()) > stops, "the robot stands")
    assert outcome.code == Outcome.INPUT_LOST
    assert f"{name} is missing" in outcome.reason
    told_last, _ = arena.stops()[stops]
    assert told_last - relay.last[name] < noticed + LATE


@pytest.mark.parametrize("stage", [refining, approach, dribble])
def test_time_jumps_back(arena: Arena, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    assert visit.ros.call(Trigger, "reset").success
    outcome = visit.ended(sent).outcome
    assert visit.ros.robot().v < 0.02
    assert outcome.code == Outcome.INPUT_LOST
    assert "time went back" in outcome.reason


def test_a_goal_that_waits_does_not_mind_that_time_jumps_back(arena: Arena) -> None:
    visit = arena.visit()
    sent = waiting(arena, visit)
    assert visit.ros.call(Trigger, "reset").success  # which brings the ball, too
    outcome = visit.ended(sent).outcome
    assert outcome.code == Outcome.SUCCEEDED, outcome.reason


@pytest.mark.parametrize("stage", [waiting, approach, dribble])
def test_the_executor_freezes(arena: Arena, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    stops = len(arena.stops())
    arena.nodes["executor"].send(signal.SIGSTOP)
    time = visit.ros.time()
    visit.ros.eventually(lambda: visit.ros.time() > time + 2.0, "two seconds pass")
    if stage is not waiting:
        assert len(arena.stops()) > stops
    arena.nodes["executor"].send(signal.SIGCONT)
    if stage is waiting:
        visit.place()
    visit.ended(sent)


@pytest.mark.parametrize("stage", [refining, approach, dribble])
def test_the_simulation_freezes(arena: Arena, stage: Stage) -> None:
    visit = arena.visit()
    sent = stage(arena, visit)
    arena.nodes["simulation"].send(signal.SIGSTOP)
    outcome = visit.ended(sent).outcome
    assert outcome.code == Outcome.INPUT_LOST
    assert "odom is missing" in outcome.reason
