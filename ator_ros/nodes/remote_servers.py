"""All action servers of others that a domain names."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from itertools import chain

from rclpy.node import Node

from ator_ros.actions.remote import RemoteCall, UnreachableAction
from ator_ros.actions.specification import ActionFactory
from ator_ros.domains.domain import Domain
from ator_ros.nodes.remote_action import RemoteAction
from ator_ros.nodes.remote_server import RemoteServer
from ator_ros.robot.description import Robot
from ator_ros.tops.library import TopLibrary


class RemoteServers:
    """The servers of a domain's remote actions; those that cannot be used are logged once.

    Parameters
    ----------
    node : Node
        On whose behalf.
    domain : Domain
        Its actions.
    frame : str
        The frame that states are estimated in.
    clock : callable, optional
        Returns the real time in s.
    """

    def __init__(
        self, node: Node, domain: Domain, frame: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._domain = domain
        callers: dict[RemoteCall, set[str]] = {}
        for spec in chain.from_iterable(domain.action_sets.values()):
            if spec.remote is not None:
                callers.setdefault(spec.remote, set()).add(spec.name)
        self._callers = callers
        self._servers: dict[RemoteCall, RemoteServer] = {
            call: RemoteServer(node, call, frame, clock) for call in sorted(callers, key=repr)
        }
        for fault in self._faults():
            node.get_logger().warning(fault)

    def _faults(self) -> list[str]:
        """Return which servers cannot be used as declared, and the actions that are lost with them."""
        return [
            f"{server.fault}; without it {', '.join(sorted(self._callers[call]))} cannot be executed"
            for call, server in self._servers.items()
            if server.fault
        ]

    @property
    def problem(self) -> str:
        """What is wrong with servers as declared; empty where nothing is."""
        return "; ".join(self._faults())

    def libraries(self, robot: Robot) -> dict[str, TopLibrary]:
        """Return the libraries of all action sets, in which remote actions are executed by their servers."""
        return {
            action_set: self._domain.library(robot, action_set, self._factories(action_set))
            for action_set in self._domain.action_sets
        }

    def _factories(self, action_set: str) -> dict[str, ActionFactory]:
        specs = self._domain.actions(action_set)
        return {name: self._factory(spec.remote) for name, spec in specs.items() if spec.remote is not None}

    def _factory(self, call: RemoteCall) -> ActionFactory:
        server = self._servers[call]
        if server.fault:
            return partial(UnreachableAction, why=server.fault)
        return partial(RemoteAction, server=server)

    def ending(self) -> bool:
        """Return whether a server may still move the robot though its goal was canceled."""
        return any(server.ending() for server in self._servers.values())

    def remarks(self) -> list[str]:
        """Return, once, which servers have ignored a cancellation."""
        return list(filter(None, (server.remark() for server in self._servers.values())))
