"""The action of somebody else's action server, as one of ours: started, stepped and ended."""

from __future__ import annotations

from ator_ros.actions.base import Action, ActionError, Goal, Status, Step, finished
from ator_ros.nodes.remote_goal import RemoteGoal
from ator_ros.nodes.remote_server import RemoteServer
from ator_ros.robot.description import Robot
from ator_ros.world.state import STOP, World


class RemoteAction(Action):
    """Lets an action server move the robot.

    The goal is sent once the robot stands and has been commanded to: from then on no velocity is commanded,
    until the server has ended. No method waits; the times of `Timeouts` are checked in each tick.

    Parameters
    ----------
    robot : Robot
        As for all actions.
    server : RemoteServer
        The server, with its clock.
    """

    name = "remote"

    def __init__(self, robot: Robot, server: RemoteServer) -> None:
        super().__init__(robot)
        self._server = server
        self._goal: Goal | None = None
        self._sent: RemoteGoal | None = None
        self._stopped = False
        self._since = 0.0
        """Real time in s from which the server's present answer is awaited."""
        self._accepted: float | None = None
        """Stamp in s of the state in which the goal was first known to be accepted."""

    def start(self, world: World, goal: Goal) -> None:  # noqa: ARG002
        """Commit to `goal`; it is sent in a later tick."""
        fault = self._server.fault
        if fault:
            raise ActionError(fault)
        self._goal, self._since = goal, self._server.clock()

    def step(self, world: World) -> Step:
        """Return None for a command from the tick on in which the goal is sent."""
        if self._sent is None:
            return self._before(world)
        return self._failed() or self._answered(world, self._sent)

    def end(self, reason: str) -> None:  # noqa: ARG002
        """Cancel the goal, if the server may still be at it; the server says when that is over."""
        if self._sent is not None:
            self._server.release(self._sent)

    def _before(self, world: World) -> Step:
        """Stop, find the server, send the goal."""
        server, now = self._server, self._server.clock()
        commanded, self._stopped = self._stopped, True
        if not (commanded and world.robot.is_standing):
            self._since = now
            return Step(STOP, Status.RUNNING, f"stopping, before {server.name} takes over")
        unusable = server.unusable(now)
        if unusable:
            late = now - self._since > server.timeouts.server
            return finished(Status.FAILED, unusable) if late else Step(STOP, Status.RUNNING, unusable)
        assert self._goal is not None
        self._sent, self._since = server.send(self._goal), now
        return Step(None, Status.RUNNING, f"sent to {server.name}")

    def _failed(self) -> Step | None:
        """Return the end where the server is gone, or what it answers cannot be used."""
        server = self._server
        if self._sent is not None and self._sent.fault:
            return finished(Status.FAILED, f"{server.name}: {self._sent.fault}")
        if self._sent is not None and self._sent.result is None and server.lost(server.clock()):
            gone = (
                f"{server.name} is gone: its action server has been missing for {server.timeouts.server:g} s"
            )
            return finished(Status.FAILED, gone)
        return None

    def _answered(self, world: World, sent: RemoteGoal) -> Step:
        server, limits = self._server, self._server.timeouts
        if sent.accepted is None:
            if server.clock() - self._since > limits.acceptance:
                silent = (
                    f"{server.name} did not answer the goal: expected that within {limits.acceptance:g} s"
                )
                return finished(Status.FAILED, silent)
            return Step(None, Status.RUNNING, f"waiting for {server.name} to accept")
        if not sent.accepted:
            return finished(Status.FAILED, f"{server.name} rejected the goal")
        if self._accepted is None:
            self._accepted = world.time
            server.accepted(server.clock())
        if sent.result is not None:
            failure = server.failure_of(sent)
            if failure is None:
                return finished(Status.SUCCEEDED, f"{server.name} succeeded")
            return finished(Status.FAILED, f"{server.name} failed: {failure}")
        if server.silent(server.clock()):
            within = f"expected a sign of life within {limits.silence:g} s, got none"
            return finished(Status.FAILED, f"{server.name} is gone or hangs: {within}")
        if world.time - self._accepted > limits.result:
            late = f"{server.name} took too long: expected a result within {limits.result:g} s, got none"
            return finished(Status.FAILED, late)
        return Step(None, Status.RUNNING, f"executed by {server.name}")
