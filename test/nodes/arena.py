"""The three nodes, any of which may fail, and the checks that must hold for any failure."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from chain_client import ChainClient, SentChain, call
from process import Process, Processes
from ros_client import Client

from ator_interfaces.action import ExecuteChain
from ator_interfaces.msg import Outcome
from ator_ros.geometry import Pose
from ator_ros.nodes.network import free_domain
from ator_ros.world.state import STOP

START = Pose(-1.2, 0.0, 0.0)
STOP_DEADLINE = 0.5
"""Simulated seconds from the last command to move until the robot stands."""
LONG_START = 60.0
"""Real seconds that a node may need to start on a loaded machine."""

READY = {
    "simulation": "simulating pioneer",
    "executor": "ready for chains",
    "refinement": "refining chains",
}
SETTINGS: dict[str, dict[str, object]] = {
    # Faster than real time, the simulation waits for commands, so that load changes only the
    # duration.
    "simulation": {"real_time_factor": 2.0, "command_wait": 0.5, "log_level": "debug"},
    "executor": {"odom_timeout": 1.5, "refinement_timeout": 3.0, "start_timeout": 20.0},
    "refinement": {},
}
_STANDS = "robot stands"
_STATUS = re.compile(rf"(\S+) s: ({_STANDS}|Command\(vx=\S+, vy=\S+, w=\S+\))")


class ArenaClient(ChainClient):
    """A client that was created after the last node had started.

    Discovery drops a killed node after seconds only; a new participant does not discover it.
    """

    def place(self, robot: Pose = START) -> None:
        """Place robot and ball at the start of the tests' chain."""
        super().place(robot)

    def ended(self, sent: SentChain) -> ExecuteChain.Result:
        """Wait for the end of a goal.

        Assert that it has a reason and that its record is published once.
        """
        result = sent.result()
        assert result.outcome.code
        assert result.outcome.reason
        assert result.record.outcome.code == result.outcome.code

        def published() -> int:
            return [each.chain_id for each in self.chains].count(result.record.chain_id)

        self.ros.eventually(published, "the chain's record")
        assert published() == 1
        return result

    def succeed(self) -> None:
        """Show that a new goal works."""
        self.place()
        outcome = self.ended(self.send([call("goToPose", START.ahead(0.15))])).outcome
        assert outcome.code == Outcome.SUCCEEDED, outcome.reason


class Arena:
    """The three nodes on a domain of their own.

    `logs` is the folder for their output; `settings` are parameters by node, which replace those of
    `SETTINGS`.
    """

    def __init__(
        self, domain: int, logs: Path, settings: dict[str, dict[str, object]] | None = None
    ) -> None:
        self._settings = {
            name: own | (settings or {}).get(name, {}) for name, own in SETTINGS.items()
        }
        self.domain = domain
        self._processes = Processes(domain, logs)
        self.observer = Client(domain)
        self._client: ArenaClient | None = None
        self._started: dict[str, list[Process]] = {name: [] for name in SETTINGS}
        self.nodes: dict[str, Process] = {}

    def start(self, *names: str) -> None:
        """Start nodes in parallel, and wait until they are ready."""
        self._leave()
        for name in names:
            self.nodes[name] = self._processes.start(name, **self._settings[name])
            self._started[name].append(self.nodes[name])
        for name in names:
            self.observer.eventually(lambda n=name: self._ready(n), f"{name} is ready", LONG_START)

    def _ready(self, name: str) -> bool:
        node = self.nodes[name]
        assert node.running, node.output
        return READY[name] in node.output

    def new_client(self) -> ArenaClient:
        """Return a client created after the last node start."""
        if self._client is None:
            self._client = ArenaClient(Client(self.domain))
        return self._client

    def _leave(self) -> None:
        if self._client is not None:
            self._client.ros.close()
            self._client = None

    def check(self) -> None:
        """Assert that the robot, which has been driven, always stopped in time."""
        self.observer.eventually(
            self.stops, "a command to move and a stop in the logs of the simulation"
        )
        late = [stop for stop in self.stops() if stop[1] - stop[0] > STOP_DEADLINE + 1e-6]
        assert not late, (
            f"expected the robot to stand within {STOP_DEADLINE} s, (sent, stood): {late}"
        )
        nodes = [node for nodes in self._started.values() for node in nodes]
        assert not [node.output for node in nodes if "Traceback" in node.output]

    def stops(self) -> list[tuple[float, float]]:
        """Return the times of the last command to move and of the stop, by the logs."""
        stops = []
        for node in self._started["simulation"]:
            sent = None
            for time, status in _STATUS.findall(node.output):
                if status not in (_STANDS, str(STOP)):
                    sent = float(time)
                elif status == _STANDS and sent is not None:
                    stops.append((sent, float(time)))
                    sent = None
        return stops

    def close(self) -> None:
        self._leave()
        self.observer.close()
        self._processes.kill()


@contextmanager
def arena_with(logs: Path, settings: dict[str, dict[str, object]] | None = None) -> Iterator[Arena]:
    with free_domain() as domain:
        arena = Arena(domain, logs, settings)
        try:
            yield arena
        finally:
            arena.close()
